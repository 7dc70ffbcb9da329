"""The plan of a run, its resumption, and the list of what went wrong."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from pathlib import Path

from bench.campaigns.offline.diagnosis import run as bench
from bench.campaigns.offline.diagnosis.report import failing, markdown, summary
from bench.runner import code_state, read


def options(**changed: object) -> argparse.Namespace:
    usual = {
        "only": "",
        "each": False,
        "strengths": "0.25,0.5,1,2",
        "seed": 1,
        "full": True,
        "clean": 200,
        "per": 20,
    }
    return argparse.Namespace(**{**usual, **changed})


def test_the_full_plan_holds_what_the_proof_asks_for() -> None:
    """200 null drives, 20 per effect and strength, none twice."""
    plan = bench.plan(options())
    counts = Counter((kind, strength) for kind, strength, _ in plan)

    assert len(plan) == len(set(plan))
    assert 200 == counts["nothing", 0.0]
    assert {20} == {counts["gnss_latency", strength] for strength in (0.25, 0.5, 1.0, 2.0)}
    assert 40 == counts["mb/nothing", 0.0]


def test_a_run_cut_short_has_seen_all_kinds() -> None:
    """The first tenth of the plan holds every kind."""
    plan = bench.plan(options())

    assert {kind for kind, _, _ in plan} == {kind for kind, _, _ in plan[: len(plan) // 10]}


def test_results_of_this_state_of_the_program_are_not_made_again(
    tmp_path: Path,
) -> None:
    """A line that was cut off is passed over; one of another state of the program does not count."""
    program = tmp_path / "program"
    (program / "tpmsd").mkdir(parents=True)
    (program / "tpmsd" / "__init__.py").write_text("", encoding="utf-8")
    state = code_state(program / "tpmsd")
    rows = [{"kind": "nothing", "strength": 0.0, "seed": seed} for seed in (1, 2)]
    entries = [{"unit": ["nothing", 0.0, row["seed"]], "state": state, "result": row} for row in rows]
    lines = [json.dumps(entry) for entry in [*entries, {**entries[0], "state": "old", "result": {}}]]
    (tmp_path / "results.jsonl").write_text("\n".join(lines) + '\n{"unit": ["noth', encoding="utf-8")
    args = options(
        out=tmp_path, program=program, any_code=False, jobs=1, alarms=0, minutes=None, failures=None
    )

    assert rows == bench.run(args, [("nothing", 0.0, 1), ("nothing", 0.0, 2)])
    assert 3 == len(read(tmp_path / "results.jsonl"))


def test_a_drive_that_fails_is_a_row_and_not_the_end() -> None:
    """A kind that is not known stands for a fault of the benchmark itself."""
    row = bench.guarded(("phlogiston", 1.0, 3), Path("none"), Path("none"))

    assert ("phlogiston", 3, True) == (row["kind"], row["seed"], row["benchmark_fault"])
    assert "phlogiston is no kind that is known" in row["error"]


ROW = {
    "kind": "gnss_latency",
    "strength": 1.0,
    "seed": 7,
    "world": "kinematic",
    "error": "",
    "reason": "",
    "names": ["lateral_slip"],
    "wanted": ["gnss_latency"],
    "detectable": 1,
    "detectable_found": 0,
    "first": False,
    "false": ["lateral_slip"],
    "sure_wrong": True,
    "errors": [],
    "place": [],
    "gains": [99.0],
    "duration_s": 900.0,
    "cpu_s": 9.0,
    "receiver": [1.0, True, 0.0],
    "alarms": None,
    "f1": 0.0,
}


def test_the_report_counts_a_wrong_name_as_missed_and_false() -> None:
    """One drive, wrong: none of one right, one false discovery of one finding."""
    figures = summary([ROW])

    assert (0, 1) == (figures["first_by_strength"]["1"]["hits"], figures["first_by_strength"]["1"]["of"])
    assert (1, 1) == (figures["false_discoveries"]["hits"], figures["false_discoveries"]["of"])
    assert "| times faster than real time, one core, reading included | median 100" in markdown(figures)


def test_the_report_has_a_row_for_kinds_with_a_miss_alone() -> None:
    """A kind that is found without a false name is in the list, one that no drive identifies in the other."""
    right = {**ROW, "kind": "habit", "names": [], "first": True, "detectable_found": 1, "false": []}
    text = markdown(summary([ROW, right, {**right, "kind": "small", "detectable": 0, "detectable_found": 0}]))

    assert "| gnss_latency | 1 | 1/1 | 0/1 | 0/1 | 1 | 99 |" in text
    assert "first on all 1 other drives that identify it, of 1 kinds.\nNo drive identifies: small 1." in text


def test_a_failure_is_listed_with_the_command_that_makes_its_drive_again() -> None:
    """Kind, strength and seed."""
    text = failing([ROW], "abc")

    assert "false: lateral_slip | missed" in text
    assert "--write CASE --kind gnss_latency --strength 1 --seed 7" in text
