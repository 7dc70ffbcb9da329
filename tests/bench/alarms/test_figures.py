"""Rows become figures, bars and text; a run is planned, resumed and reported."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

import pytest

from bench.campaigns.onboard.alarms import run as bench
from bench.campaigns.onboard.alarms.figures import bars, detection, figures, rate
from bench.campaigns.onboard.alarms.play import Said
from bench.campaigns.onboard.alarms.score import incidents_of
from bench.campaigns.onboard.alarms.text import markdown, page
from bench.cli import main, parse
from bench.statistics import percent


def case(number: int, **changed: Any) -> dict[str, Any]:
    usual = {
        "what": "case",
        "name": f"development/1/r141-puncture-fl-fast-city{number}",
        "standard": "r141-puncture",
        "onset": "fast",
        "road": "city",
        "wheels": ["fl"],
        "season": "mild",
        "reloaded": False,
        "trailer": False,
        "detected": True,
        "fast_s": 10.0 * number,
        "early": False,
        "right_wheel": True,
        "named": ["fl"],
        "false_before": [],
        "reason": "",
        "lost_mm": {"fl": 1.4},
        "stated_mm": {"fl": [-1.3, 0.2]},
        "car": "small",
        "receiver_hz": 5.0,
        "signal": "counts",
        "cpu_s": 1.0,
    }
    return {**usual, **changed}


def leg(tags: list[str], km: float, **changed: Any) -> dict[str, Any]:
    none: dict[str, Any] = {"deflation": [], "radius_deviation": [], "malfunction": []}
    usual = {
        "what": "leg",
        "name": "development/life/1/1",
        "tags": tags,
        "km": km,
        "hours": 1.0,
        "learned": True,
    }
    return {**usual, **none, "cpu_s": 1.0, **changed}


def test_a_rate_bears_its_exact_poisson_interval() -> None:
    """No event in 30,000 km: at most 3.689 events are thinkable; three events: 0.619 to 8.767 (Garwood)."""
    none, three = rate(0, 30_000.0), rate(3, 10_000.0)

    assert (0.0, 0.0) == (none["rate"], none["low"])
    assert 3.689 / 3.0 == pytest.approx(none["high"], abs=1e-3)
    assert (3.0, 0.619, 8.767) == pytest.approx((three["rate"], three["low"], three["high"]), abs=1e-3)


def test_a_confounder_does_not_answer_for_a_wheel_of_another_size() -> None:
    """A spare in winter counts for the spare: 100 km of winter without it have no alarm."""
    spare = leg(["spare", "season"], 40.0, deflation=[[20.0, ["fl"], "smaller"]])
    by_tag = figures([leg(["season"], 100.0), spare])["false"]["by_tag"]

    assert (0, 100.0) == (by_tag["season"]["deflation"]["events"], by_tag["season"]["deflation"]["km"])
    assert (1, 40.0) == (by_tag["spare"]["deflation"]["events"], by_tag["spare"]["deflation"]["km"])


def test_times_of_undetected_cases_are_longer_than_all_others() -> None:
    """Of ten cases of which one is missed: the median is the fifth, the 95 % are not reached."""
    cases = [case(k) for k in range(1, 10)] + [case(10, detected=False, fast_s=None, named=[])]
    found = detection(cases)

    assert 50.0 == found["median_s"]
    assert found["p95_s"] is None
    assert (9, 10) == (found["detected"]["hits"], found["detected"]["of"])
    assert 9 == found["right_wheel"]["of"]


def test_bars_are_held_missed_or_not_measured() -> None:
    """Ten prompt cases hold the bars of one wheel; nothing is said of what was not measured."""
    good = {bar["bar"]: bar["held"] for bar in figures([case(k) for k in range(10)])["bars"]}
    rows = [case(k) for k in range(9)] + [case(10, detected=False, fast_s=700.0, right_wheel=False)]
    bad = {bar["bar"]: bar["held"] for bar in bars(figures(rows))}

    assert [True, True, True, None, True, None, None] == list(good.values())
    assert [False, True, False, None, False, None, None] == list(bad.values())


def test_wheels_of_another_size_count_apart() -> None:
    """An alarm on a spare wheel is shown in its own row, and not in the rate over all."""
    alarm = [[10.0, ["fl"], "smaller"]]
    rows = [
        leg(["spare"], 100.0, deflation=alarm),
        leg(["ice", "sun"], 300.0, deflation=alarm),
        leg(["plain"], 600.0),
    ]
    false = figures(rows)["false"]

    assert (1, 900.0) == (false["deflation"]["events"], false["deflation"]["km"])
    assert 1 == false["by_tag"]["spare"]["deflation"]["events"]
    assert (1, 300.0) == (
        false["by_tag"]["sun"]["deflation"]["events"],
        false["by_tag"]["sun"]["deflation"]["km"],
    )


def test_alarms_close_to_each_other_are_one_incident() -> None:
    """All four wheels within a minute: one; again ten minutes later: another."""
    said = [
        Said(t, "deflation", wheel, "raised", "why")
        for t, wheel in ((5.0, "fl"), (40.0, "rr"), (640.0, "fl"))
    ]

    assert [[5.0, ["fl", "rr"], "why"], [640.0, ["fl"], "why"]] == incidents_of(said)


def test_the_text_names_what_was_missed_and_why() -> None:
    """Bars, the missed case with its reason, and the false alarm with its confounder."""
    rows = [
        case(1),
        case(2, detected=False, fast_s=None, named=[], reason="the change is hidden in the estimate: fl"),
        leg(["ferry"], 100.0, deflation=[[10.0, ["fl"], "smaller"]]),
        {"what": "recording", "name": "van", "km": 10.0, "tyre_alarms": [], "cpu_s": 1.0},
    ]
    text = markdown(figures(rows))

    assert "R141 and FMVSS 138 cases detected in time: 97 % | 1/2 = 50.0 % [1.3, 98.7] | **missed**" in text
    assert "city2`: the change is hidden in the estimate: fl" in text
    assert "(ferry): deflation of fl at 10 s" in text
    assert percent(detection(rows[:2])["detected"]) in text


def test_the_page_has_misses_by_cause_and_confounders_without_alarms_in_one_line() -> None:
    """One miss of two cases; one false alarm on 100 km with a ferry, none on 300 km with ice."""
    rows = [
        case(1),
        case(2, detected=False, fast_s=None, named=[], reason="the change is hidden in the estimate: fl"),
        leg(["ferry"], 100.0, deflation=[[10.0, ["fl"], "smaller"]], malfunction=[[5.0, [], "why"]]),
        leg(["ice"], 300.0),
    ]
    text = page(figures(rows))

    assert "| r141-puncture | 1/2 = 50.0 % [1.3, 98.7] | 10 | - | 10 | 1/1 [2.5, 100.0] % |" in text
    assert (
        "Missed, the change is hidden in the estimate: `development/1/r141-puncture-fl-fast-city2`." in text
    )
    assert "| ferry | the car stands, its position moves | 1 in 100 km = 100.0 [2.5, 557.2] |" in text
    assert "None on drives with ice (300 km)." in text
    assert "`radius_deviation`: none." in text
    assert "`malfunction`: ferry 1." in text


def arguments(**changed: Any) -> argparse.Namespace:
    args = parse(["run", "alarms"])
    return argparse.Namespace(
        **{**vars(args), "cars": 3, "km": 4 * bench.LIFE_KM, "kinds": 0, "jobs": 1, **changed}
    )


def test_the_held_out_half_is_another_plan() -> None:
    """Other units, and no recordings, for those are known."""
    usual, other = bench.plan(arguments()), bench.plan(arguments(held_out=True))

    assert {"development"} == {pool for what, pool, _, _ in usual if what != "recordings"}
    assert {"held-out"} == {pool for _, pool, _, _ in other}
    assert (3, 4) == (sum(u[0] == "cases" for u in other), sum(u[0] == "life" for u in other))


def test_a_short_run_meets_every_confounder_too() -> None:
    """One unit of the default plan is a car that meets each of them alone."""
    plan = bench.plan(arguments(kinds=parse(["run", "alarms"]).kinds))

    assert [("kinds", "development", 1000, 0)] == [unit for unit in plan if unit[0] == "kinds"]


def test_units_of_this_state_of_the_program_are_not_played_again(tmp_path: Path) -> None:
    """A line that was cut off is passed over; one of another state does not count."""
    args = arguments(cars=1, km=0.0, out=tmp_path, held_out=True)
    unit = bench.plan(args)[0]
    lines = [{"unit": unit, "state": bench.state_of_code(), "result": [case(1)]}]
    lines.append({"unit": unit, "state": "old", "result": [case(2)]})
    (tmp_path / "results.jsonl").write_text("\n".join(map(json.dumps, lines)) + '\n{"unit": ["ca')

    assert [case(1)] == bench.run(args)


def test_a_unit_that_fails_is_a_row_and_ends_nothing(tmp_path: Path) -> None:
    """A pool that is not there: the row says so."""
    (row,) = bench.work(("life", "nowhere", 1, 0))

    assert "failed" == row["what"]
    assert "KeyError" in row["error"]


def test_the_command_writes_summary_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From results that are there: JSON, Markdown and a PNG."""
    rows = [case(1), case(2, detected=False, fast_s=None, named=[]), leg(["ice"], 50.0)]
    folder = tmp_path / "development"
    folder.mkdir()
    entry = {"unit": ["cases", "development", 1, 10], "state": "x", "result": rows}
    (folder / "results.jsonl").write_text(json.dumps(entry) + "\n")

    assert 0 == main(["run", "alarms", "--report-only", "--out", str(tmp_path)])
    assert json.loads((folder / "summary.json").read_text())["cases"] == 2
    assert (folder / "summary.md").read_text() in capsys.readouterr().out
    assert (folder / "alarms.png").read_bytes().startswith(b"\x89PNG")
    assert math.isfinite((folder / "alarms.png").stat().st_size)


@pytest.mark.parametrize(
    "name",
    ["nothing", "nowhere/1/x", "development/life/one/2", "development/lives/1/2", "development/1/unknown"],
)
def test_a_name_that_is_none_is_reported_in_one_line(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2, and no traceback."""
    with pytest.raises(SystemExit) as end:
        main(["run", "alarms", "--one", name])

    assert 2 == end.value.code
    assert name in capsys.readouterr().err.splitlines()[-1]
