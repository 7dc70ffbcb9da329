"""NEES and coverage by cell: means over drives with their intervals."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import pytest

from bench.campaigns.onboard import intervals
from bench.registry import UsageError


def row(method: str, seed: int, nees_pair: float, **more: Any) -> dict[str, Any]:
    return {
        "scenario": "balanced",
        "receiver": "white",
        "seed": seed,
        "method": method,
        "front": False,
        "nees_pair": nees_pair,
        "nees_four": math.nan,
        "nees_difference": 1.0,
        "cover_radius": 0.95,
        "cover_difference": 1.0,
        "diverged": "",
        **more,
    }


def test_a_mean_has_the_interval_of_student() -> None:
    """Of 1, 2, 3: mean 2, and 4.303 standard errors of 1/sqrt(3) either side; of one drive there is none."""
    mean, half = intervals.spread([1.0, 2.0, 3.0])
    assert (2.0, 4.302653 / math.sqrt(3.0)) == (mean, pytest.approx(half, rel=1e-6))
    assert math.isnan(intervals.spread([1.0])[1])


def test_nees_is_per_radius() -> None:
    """That of a pair is halved, that of four wheels a quarter, so that 1 is honest everywhere."""
    rows = [row("mpf-pn", k, 2.0) for k in range(3)]
    rows += [row("mpf-pn", k, 9.0, front=True, nees_four=4.0) for k in range(2)]
    pair, four = intervals.cells(rows)
    assert ((2, 3, 1.0), (4, 2, 1.0)) == tuple(
        (cell["wheels"], cell["drives"], cell["nees"][0]) for cell in (pair, four)
    )
    assert "2 of 2 cells are within 0.7 to 1.4, and 2 cover a radius in 90 to 98 %" in intervals.markdown(
        [pair, four]
    )


def test_each_cell_is_played_by_both_filters() -> None:
    """Two filters on two drives, with two wheels and with four, of one kind."""
    tasks = intervals.plan(2, 400, ["balanced"], ["white"])
    assert 8 == len(tasks) == len(set(tasks))
    assert {"gaussian-sum", "mpf-pn"} == {task.method for task in tasks}
    assert {"all"} == {task.inputs for task in tasks}


def test_an_unknown_kind_of_drive_is_told(tmp_path: Path) -> None:
    """One line, before anything is played."""
    parser = argparse.ArgumentParser()
    intervals.options(parser)
    with pytest.raises(UsageError, match="unknown: sideways"):
        intervals.main(parser.parse_args(["--scenarios", "sideways", "--out", str(tmp_path)]))
