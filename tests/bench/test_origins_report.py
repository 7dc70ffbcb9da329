"""The tables of the drives of every origin."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest

from bench.campaigns.offline.origins_report import markdown, p_of_the_rest
from bench.cli import into_page, main
from bench.registry import UsageError


def finding(effect: str, confidence: float = 0.99, **more: Any) -> dict[str, Any]:
    where = {"wheels": ["rl", "rr"], "channel": "wheel", "covariate": "speed"}
    basis = {"status": "finding", "p_value": None, "where": where, "parameters": {}, "gain": 9.0}
    return {"effect": effect, "confidence": confidence, **basis, **more}


def row(origin: str, seed: int, *findings: dict[str, Any], kind: str = "null", **more: Any) -> dict[str, Any]:
    basis = {"verdict": "consistent", "suspicions": [], "tags": [], "error": "", "duration_s": 900.0}
    return {
        "origin": origin,
        "kind": kind,
        "seed": seed,
        "findings": list(findings),
        "cpu_s": 9.0,
        **basis,
        **more,
    }


def test_null_drives_are_counted_by_origin_with_their_interval() -> None:
    """A finding of four drives; drives with too little data are not judged; the real ones are apart."""
    rows = [row("kinematic", k) for k in range(3)] + [row("kinematic", 4, finding("unknown"))]
    rows += [row("kinematic", 5, verdict="insufficient_data"), row("real", 1, finding("gnss_latency"))]
    lines = markdown(rows).splitlines()

    kinematic = next(line for line in lines if line.startswith("| kinematic"))
    assert kinematic.startswith("| kinematic | 1/4 = 25.0 % [0.6, 80.6] | - |")
    assert any(line.startswith("| all simulated | 1/4") for line in lines)
    remarks = "Too little data: kinematic 1; a suspicion alone: none; false names: "
    assert f"{remarks}unknown (kinematic) 1, gnss_latency (real) 1." in lines
    assert "100 times faster than real time" in lines[-1]


def test_conditions_without_a_finding_are_in_a_sentence() -> None:
    """A condition with a finding on either side has a row, with both shares; the origins are held apart."""
    rows = [row("awkward", 1, finding("unknown"), tags=["tight"]), row("awkward", 2, tags=[])]
    text = markdown([*rows, row("wheels", 1, tags=["averaged"])])

    assert "| awkward | tight | 1/1 [2.5, 100.0] % | 0/1 [0.0, 97.5] % |" in text
    assert "No finding on null drives with or without any other condition.\n" in text
    assert "An origin against the others, p: awkward 1, wheels 1.\n" in text


def test_what_a_multibody_cars_own_tyres_do_is_no_false_finding() -> None:
    """Slip on that origin is true; on another it is false, and so is a latency on that one."""
    rows = [row("multibody", 1, finding("longitudinal_slip")), row("mems", 1, finding("longitudinal_slip"))]
    rows += [row("multibody", 2, finding("gnss_latency"))]
    lines = markdown(rows).splitlines()

    assert "| 1/2 = " in next(line for line in lines if line.startswith("| multibody"))
    assert "| 1/1 [" in next(line for line in lines if line.startswith("| mems"))


def test_the_lag_that_a_receiver_was_drawn_with_is_no_false_finding() -> None:
    """90 ms found as 89 is true; where there is none, or half as much, it is false, but for the age of wheel
    speeds."""
    lag = finding("velocity_lag", parameters={"lag_s": [0.089, 0.004]})
    rows = [row("traffic", k, lag, velocity_lag_s=true) for k, true in enumerate([0.09, 0.0, 0.045])]
    rows.append(row("traffic", 3, lag, velocity_lag_s=0.06, wheel_age_s=0.02))
    lines = markdown(rows).splitlines()

    assert "| 2/4 = " in next(line for line in lines if line.startswith("| traffic"))
    assert any(line.endswith("false names: velocity_lag (traffic) 2.") for line in lines)


def test_halves_are_reported_apart() -> None:
    """Seeds from 50000 on are the held-out half."""
    text = markdown([row("mems", 1), row("mems", 50_001, finding("unknown"))])
    development, held_out = text.split("### Held-out seeds")

    assert "0/1" in development
    assert "1/1" in held_out


def test_an_event_is_right_by_name_wheels_and_span() -> None:
    """One right, one with a span that is off, one with another name for sure, one missed."""
    truth = {"wheels": ["rl", "rr"], "slip": 0.01, "onset_s": 100.0, "duration_s": 30.0}

    def spun(onset: float) -> dict[str, Any]:
        return finding("wheel_spin", parameters={"onset_s": [onset, 1.0], "duration_s": [30.0, 1.0]})

    found: list[list[dict[str, Any]]] = [[spun(101.0)], [spun(140.0)], [finding("track_width_error")], []]
    rows = [row("awkward", k, *each, kind="spin_on_ice", truth=truth) for k, each in enumerate(found)]
    line = next(line for line in markdown(rows).splitlines() if line.startswith("| spin_on_ice"))
    cells = [cell.strip().split(" ")[0] for cell in line.strip("|").split("|")]

    assert ["4", "2/4", "2/4", "1/4", "0/4", "1/4", "1/4"] == cells[1:]


def test_small_p_values_of_null_drives_are_reported() -> None:
    """The test of Kolmogorov and Smirnov in the origin's row."""
    rest = {"gain": 5.0, "p_value": 0.05, "exceeded": 0, "replicates": 19}
    rows = [row("traffic", k, remaining=rest) for k in range(1, 9)]
    line = next(line for line in markdown(rows).splitlines() if line.startswith("| traffic"))

    assert float(line.split("|")[3].split(" of ")[0]) < 1e-3


def test_p_values_by_early_stopping_are_uniform_where_drive_and_replicates_are_equal() -> None:
    """Drawing until three of at most nineteen exceed the drive's own value (Besag and Clifford 1991)."""
    rng = np.random.default_rng(4)
    values = []
    for seed in range(2000):
        beyond = rng.random(19) < rng.random()
        drawn = next((n for n in range(3, 20) if beyond[:n].sum() == 3), 19)
        rest = {"exceeded": int(beyond[:drawn].sum()), "replicates": drawn}
        values.append(p_of_the_rest(row("traffic", seed, remaining=rest)))

    assert kstest(values, "uniform").pvalue > 0.01


def test_a_report_is_put_between_the_marks_of_its_page() -> None:
    """What stood there goes, what is around stays; without marks nothing is written."""
    page = "a\n<!-- python -m bench report x -->\nold\n<!-- end of x -->\nb\n"
    written = into_page(page, "x", "new\n")

    assert "a\n<!-- python -m bench report x -->\n\nnew\n\n<!-- end of x -->\nb\n" == written
    assert written == into_page(written, "x", "new")
    with pytest.raises(UsageError, match="no marks"):
        into_page("a", "x", "new")


def test_the_command_prints_what_stands_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of each drive the latest result, by state of the program; nothing there is wrong usage."""
    states = ((1, "a"), (2, "a"), (3, "a"), (2, "b"))
    entries = [{"unit": [k], "state": state, "result": row("mems", k)} for k, state in states]
    (tmp_path / "rows.jsonl").write_text("\n".join(map(json.dumps, entries)) + "\n")

    assert 0 == main(["report", "origins", "--out", str(tmp_path)])
    reported = capsys.readouterr().out
    assert "| mems | 0/3 [" in reported
    assert "Drives by state of the program: 2, 1." in reported
    with pytest.raises(SystemExit) as end:
        main(["report", "origins", "--out", str(tmp_path / "nowhere")])
    assert 2 == end.value.code
