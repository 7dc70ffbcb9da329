"""Both filters on single drives: what counts as found, and radii moved to the same speed."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import pytest

from bench.campaigns.onboard import filter_drives
from bench.campaigns.onboard.estimators.tasks import driven
from bench.campaigns.onboard.filters import METHODS


def demo(method: str, delay_s: float | None, others: list[Any]) -> dict[str, Any]:
    return {"what": "demo", "name": "1", "method": method, "delay_s": delay_s, "others": others}


def test_late_and_wrong_announcements_do_not_count() -> None:
    """Of four seeds one is found in time and alone; the others are late, missed, or beside a wrong wheel."""
    rows = [
        demo(METHODS[0], 59.0, []),
        demo(METHODS[0], 61.0, []),
        demo(METHODS[0], None, []),
        demo(METHODS[0], 20.0, [("deflation", "fr", 200.0)]),
    ]
    text = filter_drives.markdown(rows)
    assert "| `gaussian-sum` | 1 of 4 seeds | 59, 61, -, 20 |" in text
    assert "| `mpf-pn` | 0 of 0 seeds |  |" in text


def test_a_recording_without_alarm_and_figure_is_in_a_sentence() -> None:
    """One with a lost pose has a row."""
    basis = {"what": "recording", "method": METHODS[0], "said": [], "steady": [], "hours": 0.05}
    rows = [{**basis, "name": "oval", "lost_pose": 0}, {**basis, "name": "hills", "lost_pose": 2}]
    text = filter_drives.markdown(rows)

    assert "| hills | `gaussian-sum` | none | 2 | - |" in text
    assert "No alarm, no pose lost: oval with `gaussian-sum`." in text


def test_an_announcement_before_the_puncture_is_a_wrong_one() -> None:
    """At 100 s nothing is soft yet; at 170 s it is, for 20 s; a malfunction names no tyre."""
    said = [("deflation", "rl", 100.0), ("malfunction", "", 120.0), ("deflation", "rl", 170.0)]
    found = filter_drives.judged({"said": said}, "rl")
    assert 20.0 == found["delay_s"]
    assert [said[0]] == found["others"]


def test_the_demonstrations_drive_is_played_by_both(monkeypatch: pytest.MonkeyPatch) -> None:
    """The drive is written, read and replayed with either filter; a minute of it holds no alarm."""
    monkeypatch.setattr(filter_drives, "DURATION_S", 60.0)
    rows = filter_drives.work(("demo", "rl", 1))
    assert list(METHODS) == [row["method"] for row in rows]
    assert [[], []] == [row["said"] for row in rows]
    assert [0, 0] == [row["lost_pose"] for row in rows]


def test_radii_are_compared_at_the_same_speed() -> None:
    """1.0 and 2.0 mm at 30 m/s against 0.5 and 1.4 mm at 20 m/s: 0.5 mm is growth, by 0.001 mm s2/m2."""
    row = {"name": "a", "steady": [1.0, 2.0, 0.1, 0.1, 900.0]}
    calibrated = [{"name": "a", "radii_mm": [0.5, 1.4], "growth": 0.001, "speed_mps": 20.0}]
    assert [0.0, 0.1] == pytest.approx(filter_drives.radius_difference_mm(row, calibrated), abs=1e-12)
    assert [] == filter_drives.radius_difference_mm(row, [])
    assert [] == filter_drives.radius_difference_mm({"name": "a", "steady": []}, calibrated)


def test_the_plan_names_every_recording(tmp_path: Path) -> None:
    """Folders with a vehicle.toml, each replayed and calibrated once; the seeds of the demonstration."""
    for name in ("b", "a", "c"):
        (tmp_path / name).mkdir()
        if name != "c":
            (tmp_path / name / "vehicle.toml").write_text("")
    parser = argparse.ArgumentParser()
    filter_drives.options(parser)
    units = filter_drives.plan(parser.parse_args(["--recordings", str(tmp_path), "--seeds", "2"]))
    kinds = [unit[0] for unit in units]
    assert (2, 2, 2, 2) == tuple(kinds.count(what) for what in ("demo", "recording", "calibrated", "cost"))
    assert ["a", "b"] == [Path(unit[1]).name for unit in units if unit[0] == "calibrated"]


def test_a_tick_is_timed_for_both_filters_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every piece of the drive is played by both; the ratio is the particles' time over the default's."""
    drive = driven("puncture", "correlated", 1)
    monkeypatch.setattr(filter_drives, "driven", lambda *what: argparse.Namespace(ticks=drive.ticks[:600]))
    (row,) = filter_drives.costs(2)
    assert "2 wheels" == row["name"]
    assert min(row["ms"]) > 0.0
    assert row["ratio"] > 1.0
