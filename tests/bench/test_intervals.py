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
        "stated": {
            "nees_pair": 2.0 * nees_pair,
            "nees_four": 2.0 * more.get("nees_four", math.nan),
            "nees_difference": 2.0,
            "cover_radius": 0.85,
            "cover_difference": 0.9,
        },
        "drift": "drift",
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
        (cell["wheels"], cell["drives"], cell["all"]["nees"][0]) for cell in (pair, four)
    )
    assert "| balanced | white | 2 |  |  | 2.00±0.00, 85 | 2.00±0.00, 90 |" in intervals.markdown([pair])
    text = intervals.tables(rows)
    assert "| `mpf-pn` | all hypotheses | 1.00, 1.00, 1.00 | 2 of 2 | " in text
    assert "| `mpf-pn` | as stated | 2.00, 2.00, 2.00 | 0 of 2 | 85, 85.0, 85 | 0 of 2 |" in text


def test_each_cell_is_played_by_both_filters() -> None:
    """Two filters on two drives, with two wheels and with four, of one kind."""
    units = intervals.plan(2, 400, ["balanced"], ["white"], ["drift", "none"])
    assert 16 == len(units) == len(set(units))
    assert {"gaussian-sum", "mpf-pn"} == {unit.task.method for unit in units}
    assert {"all"} == {unit.task.inputs for unit in units}


def test_each_kind_of_drift_has_a_table_of_its_own() -> None:
    """Cells of drawn drift are not averaged with those of none."""
    rows = [row("mpf-pn", k, 2.0) for k in range(2)] + [row("mpf-pn", k, 8.0, drift="none") for k in range(2)]
    drawn, none = intervals.tables(rows).split("## No drift")
    assert "## Drift drawn from the filter's prior" in drawn
    assert "| 1.00, 1.00, 1.00 |" in drawn and "4.00" not in drawn
    assert "| 4.00, 4.00, 4.00 |" in none


def test_an_unknown_kind_of_drive_is_text(tmp_path: Path) -> None:
    """One line, before anything is played."""
    parser = argparse.ArgumentParser()
    intervals.options(parser)
    with pytest.raises(UsageError, match="unknown: sideways"):
        intervals.main(parser.parse_args(["--scenarios", "sideways", "--out", str(tmp_path)]))
