"""Scores, verdicts and tables, against figures worked out by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from bench.campaigns.onboard.estimators.methods import POSITIONS, TEXTBOOK
from bench.campaigns.onboard.estimators.play import LOST_S, Played, longest, score
from bench.campaigns.onboard.estimators.run import spread
from bench.campaigns.onboard.estimators.speed import linearity, owners
from bench.campaigns.onboard.estimators.summary import diverged, paper_claims, pick, ratios
from bench.campaigns.onboard.estimators.survive import verdict

TICK_S = 0.1
COUNT = 3000
COVARIANCE = np.array([[4.0, 1.0], [1.0, 2.0]]) * 1e-6


def played(error_m: tuple[float, float], lost: int = 0) -> Played:
    rear = np.tile(np.array(error_m), (COUNT, 1))
    return Played(rear, np.tile(COVARIANCE, (COUNT, 1, 1)), np.zeros((COUNT, 2)), lost, 3.0)


TRUTH = np.zeros((COUNT, 2))
PLACE = np.zeros((COUNT, 2))


def test_scores_of_a_constant_error_are_the_closed_forms() -> None:
    """e = (2, -1) mm: difference 3 mm with variance 4 mm2, NEES 9/4, and e' P^-1 e = 16/7."""
    result = score(played((2e-3, -1e-3)), TRUTH, PLACE, TICK_S)
    assert pytest.approx(3e-3) == result.rmse_difference_m
    assert pytest.approx(math.sqrt(2.5) * 1e-3) == result.rmse_radius_m
    assert pytest.approx(9 / 4) == result.nees_difference
    expected = np.array([2e-3, -1e-3]) @ np.linalg.inv(COVARIANCE) @ np.array([2e-3, -1e-3])
    assert pytest.approx(expected) == result.nees_pair
    assert result.cover_difference == 1.0
    assert pytest.approx(1.0) == result.cpu_ms
    assert result.diverged == ""


def test_an_interval_that_misses_is_not_counted() -> None:
    """5 mm off at a standard deviation of 2 mm."""
    assert score(played((5e-3, 0.0)), TRUTH, PLACE, TICK_S).cover_difference == 0.0


@pytest.mark.parametrize(
    ("run", "why"),
    [
        (played((math.nan, 0.0)), "not finite"),
        (played((0.0, 0.0), lost=1), "pose given up"),
        (played((6e-3, 0.0)), "radius lost"),
    ],
)
def test_a_diverged_run_says_why(run: Played, why: str) -> None:
    """Each of the definition's clauses alone."""
    assert why == score(run, TRUTH, PLACE, TICK_S).diverged


@pytest.mark.parametrize(("seconds", "why"), [(LOST_S - 0.1, ""), (LOST_S + 0.1, "place lost")])
def test_a_place_is_lost_after_ten_seconds(seconds: float, why: str) -> None:
    """And not before."""
    away = PLACE.copy()
    away[500 : 500 + round(seconds / TICK_S), 0] = 31.0
    assert why == score(played((0.0, 0.0)), TRUTH, away, TICK_S).diverged


def test_the_longest_run_is_counted() -> None:
    """Also one that goes on to the end."""
    assert longest(np.array([True, False, True, True, True])) == 3
    assert longest(np.zeros(4, dtype=bool)) == 0


def row(method: str, particles: int, rmse_mm: float, why: str = "", **more: Any) -> dict[str, Any]:
    return {
        "scenario": "puncture",
        "receiver": "white",
        "front": False,
        "inputs": POSITIONS,
        "seed": 0,
        "method": method,
        "particles": particles,
        "rmse_difference_m": 1e-3 * rmse_mm,
        "rmse_radius_m": 2e-3 * rmse_mm,
        "diverged": why,
    } | more


def claims(rows: list[dict[str, Any]]) -> dict[str, bool | None]:
    return {claim.text.split(" (")[0]: claim.holds for claim in paper_claims(rows, None, [])}


def test_claims_hold_or_fall_with_the_figures() -> None:
    """The same table, once as the paper has it and once turned round."""
    paper = [
        row(TEXTBOOK, 100, 0.2),
        row("aug-pf", 100, 0.4),
        row("aug-pf", 500, 0.2),
        row("aug-ekf", 0, 0.5),
    ]
    assert all(claims(paper).values())
    here = [row(TEXTBOOK, 100, 0.3, "place lost"), row("aug-pf", 500, 0.2), row("aug-ekf", 0, 0.1)]
    assert not any(claims(here).values())


def test_runs_that_diverged_are_counted() -> None:
    """Over those picked."""
    rows = [
        row("aug-pf", 100, 1.0, "place lost"),
        row("aug-pf", 100, 0.5),
        row("aug-pf", 500, 0.5, "not finite"),
    ]
    assert diverged(pick(rows, particles=100)) == (1, 2)


def test_ratios_are_of_the_seeds_that_both_have() -> None:
    """A seed that only the default has does not count; RMSEs are pooled as squares."""
    rows = [
        row(TEXTBOOK, 500, 0.5, receiver="white"),
        row("gaussian-sum", 0, 0.1, receiver="white"),
        row("gaussian-sum", 0, 9.0, receiver="white", seed=1),
        row("limit", 0, 0.0) | {
            "causal": {"rmse_difference_m": 0.05e-3, "rmse_radius_m": 0.1e-3},
            "smoother": {"rmse_difference_m": 0.02e-3, "rmse_radius_m": 0.1e-3},
        },
    ]  # fmt: skip
    line = next(r for r in ratios(rows, "white") if r["scenario"] == "all")
    assert pytest.approx(0.2) == line["difference_to_book"]
    assert pytest.approx(5.0) == line["difference_to_smoother"]


def test_a_straight_line_is_found_linear() -> None:
    """0.1 ms and 0.2 ms per 1000."""
    found = linearity({str(n): 0.1 + 0.2e-3 * n for n in (100, 500, 1000, 5000)})
    assert pytest.approx(0.1) == found["fixed_ms"]
    assert pytest.approx(0.2) == found["per_1000_ms"]
    assert found["worst_misfit"] < 1e-9


def test_time_of_a_library_is_put_down_to_those_who_call_it() -> None:
    """By the share that each caller caused."""
    caller = ("/x/tpmsd/onboard/estimators/published/niw.py", 1, "learn")
    other = ("/x/numpy/core.py", 1, "mean")
    entry = (3, 3, 0.5, 0.5, {caller: (1, 1, 0.4, 0.4), other: (2, 2, 0.1, 0.1)})
    assert owners(("~", 0, "<built-in>"), entry) == {"niw": 0.4, "NumPy's own Python": 0.1}
    assert owners(caller, entry) == {"niw": 0.5}


def hour(rmse: float = 0.1, std: float = 0.1, size: float = 1000.0) -> dict[str, float]:
    return {"rmse_difference_mm": rmse, "std_difference_mm": std, "state_bytes": size}


@pytest.mark.parametrize(
    ("hours", "finite", "faults"),
    [
        ([hour()] * 10, True, 0),
        ([hour()] * 10, False, 1),
        ([hour()] * 5 + [hour(rmse=0.5)] * 5, True, 1),
        ([hour()] * 5 + [hour(std=0.03)] * 5, True, 0),
        ([hour(std=0.5)] * 5 + [hour(std=0.01)] * 5, True, 1),
        ([hour()] * 9 + [hour(size=1500.0)], True, 1),
        ([hour(size=900.0)] + [hour()] * 9, True, 0),
        ([hour()] * 6 + [hour(rmse=1.0)] + [hour()] * 3, True, 1),
        ([hour(rmse=1.0)] + [hour()] * 9, True, 0),
    ],
)
def test_survival_is_judged_by_what_changes_with_the_hours(
    hours: list[dict[str, float]], finite: bool, faults: int
) -> None:
    """NaN, a growing error, an hour astray, a stated error that goes away, a growing state: each once."""
    result = verdict(hours, finite)
    assert faults == len(result["faults"])
    assert (faults == 0) == result["survived"]


def test_work_ends_when_its_time_is_up() -> None:
    """What was begun is kept, in the order asked for; what was not is left out."""
    assert spread([3, 1, 2], abs, str, 2) == [3, 1, 2]
