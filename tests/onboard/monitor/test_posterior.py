"""The bank of hypotheses against an enumeration of its rows with normal densities, and its marginals."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.evidence.hypotheses import LOSS_GRID, Comparison, Verdict
from tpmsd.onboard.monitor.evidence.posterior import Posterior, Window, posterior
from tpmsd.onboard.monitor.evidence.sizes import TyreSizeChange, size_rows, subsets, with_sizes
from tpmsd.onboard.monitor.settings import DRIVE_EVIDENCE, JUDGE

RADIUS_M, THRESHOLD, LIMIT = 0.31, 0.0025, 0.008
REAR, ALL = (2, 3), (0, 1, 2, 3)


def verdict(
    wheels: tuple[int, ...],
    change_m: FloatArray,
    covariance_m2: FloatArray,
    sizes: TyreSizeChange | None = None,
) -> Verdict:
    """Of one account of the change, beside every size."""
    radius, sizes = np.full(len(wheels), RADIUS_M), sizes or size_rows(wheels)
    against = Comparison(radius, THRESHOLD, sizes=sizes, limit=LIMIT)
    return against.compare_hypotheses(
        with_sizes(change_m[None], covariance_m2[None], np.zeros(1), radius, sizes)
    )


def since(
    wheels: tuple[int, ...], change_m: FloatArray, covariance_m2: FloatArray, lost: float = 0.0
) -> TyreSizeChange:
    """Rows of a window before which this change was seen."""
    sizes, radius = size_rows(wheels), np.full(len(wheels), RADIUS_M)
    seen = with_sizes(change_m[None], covariance_m2[None], np.zeros(1), radius, sizes, every=True)
    return sizes.rows_of_window(seen, lost)


def test_a_window_knows_no_sizes_after_a_loss() -> None:
    """Before the window rr was 6 mm larger than the others. Where nothing was lost, rr has that size; as far
    as the others had lost air, the window has the sizes of the prior."""
    spread, sizes = np.full((4, 4), 1e-3**2) + np.eye(4) * 2e-4**2, size_rows(ALL)
    change = np.array([0.0, 0.0, 0.0, 6e-3])
    sound, lost = since(ALL, change, spread), since(ALL, change, spread, 1.0)
    assert sound.log_prior[4] > -1e-3
    assert lost.log_prior[: lost.came + 1] == pytest.approx(sizes.log_prior, abs=1e-9)
    assert lost.mean[: lost.came + 1] == pytest.approx(sizes.mean, abs=1e-12)
    assert lost.variance[: lost.came + 1] == pytest.approx(sizes.variance, abs=1e-15)
    judged = verdict(ALL, np.array([0.0, 0.0, -6e-3, 0.0]), spread)
    assert judged.table.lost_probability == pytest.approx(1.0 - judged.none, abs=1e-2)


def members(d: int) -> FloatArray:
    """(s, d) 1 for the wheels of each subset."""
    return np.array([[float(wheel in one) for wheel in range(d)] for one in subsets(d)])


def enumerated(
    seen: tuple[FloatArray, FloatArray], spread: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Probability of a deflation of each rear wheel, and of each row of sizes, by the joint density of what
    was seen before a window and in it: a loss began before both or with the window, and so did a size."""
    sizes, d = size_rows(REAR), 2
    intact = 1.0 - sum(JUDGE.prior_by_size[len(one) - 1] for one in subsets(d))
    noise = block_diag(*spread)
    every = np.concatenate(seen)

    def density(row: int, came: bool, lost: FloatArray, now: bool) -> float:
        pattern = np.concatenate([sizes.pattern[row] * (not came), sizes.pattern[row]]) * RADIUS_M
        mean = sizes.mean[row] * pattern - np.concatenate([lost * (not now), lost]) * RADIUS_M
        own = noise + sizes.variance[row] * np.outer(pattern, pattern)
        return float(multivariate_normal.pdf(every, mean, own))

    deflated, rows, total = np.zeros(d), np.zeros(2), 0.0
    for row, came in ((0, False), (1, False), (1, True)):
        prior = np.exp(sizes.log_prior[row])
        if came:
            prior *= np.exp(sizes.log_prior[0]) * DRIVE_EVIDENCE.resized_while_driving
        nothing = intact * prior * density(row, came, np.zeros(d), False)
        rows[row] += nothing * (not came)
        total += nothing / (1.0 + came)
        for (k, one), loss, now in itertools.product(enumerate(members(d)), LOSS_GRID, (True, False)):
            if came and not now:
                continue
            of_loss = JUDGE.prior_by_size[len(subsets(d)[k]) - 1] / LOSS_GRID.size / 2
            mass = of_loss * prior * density(row, came, loss * one, now)
            deflated += mass * min(loss / THRESHOLD, 1.0) * one
            rows[row] += mass
            total += mass
    return deflated / total, rows / rows.sum()


@pytest.mark.parametrize("now_mm", [(-0.9, 0.1), (-0.2, 0.0), (4.0, 5.6), (-0.8, -0.9)])
@pytest.mark.parametrize("before_mm", [(0.1, -0.1), (5.0, 5.2), (-1.2, 0.0)])
@pytest.mark.parametrize("min_mm", [0.2, 0.6])
def test_the_bank_is_the_enumeration_of_its_rows(
    now_mm: tuple[float, float], before_mm: tuple[float, float], min_mm: float
) -> None:
    """Of two wheels, with a size of both and two windows, every row by the joint normal density of all that
    was seen: nothing is counted twice."""
    now, before = 1e-3 * np.array(now_mm), 1e-3 * np.array(before_mm)
    now_m2 = np.full((2, 2), 6e-4**2) + np.eye(2) * 3e-4**2
    before_m2 = np.full((2, 2), 5e-4**2) + np.eye(2) * (1e-3 * min_mm) ** 2
    both_m2 = np.linalg.inv(np.linalg.inv(now_m2) + np.linalg.inv(before_m2))
    both = both_m2 @ (np.linalg.solve(now_m2, now) + np.linalg.solve(before_m2, before))
    every, sizes = members(2), since(REAR, before, before_m2)
    found = posterior(
        [
            Window("now", verdict(REAR, now, now_m2, sizes), every, every, sizes.came),
            Window("minutes", verdict(REAR, both, both_m2), every, every),
        ]
    )
    deflated, rows = enumerated((before, now), (before_m2, now_m2))
    assert found.deflated == pytest.approx(deflated, abs=2e-5)
    assert found.sizes == pytest.approx(rows, abs=2e-5)


@pytest.mark.parametrize("change_mm", [(-0.8, -0.9, 2.6, 0.3), (0.0, -1.9, 1.2, 0.0), (0.1, 0.0, -0.1, 0.0)])
def test_a_bank_of_one_window_is_its_table(change_mm: tuple[float, ...]) -> None:
    """Also where a wheel is larger by less than its row of sizes expects: the odds of a loss beside it are
    against all of that row."""
    spread = np.full((4, 4), 5e-4**2) + np.eye(4) * 1.5e-4**2
    judged = verdict(ALL, 1e-3 * np.array(change_mm), spread)
    found = posterior([Window("minutes", judged, members(4), members(4))])
    assert found.deflated == pytest.approx(judged.deflated, abs=1e-9)
    as_learned = np.exp(np.append(judged.table.lost[0], judged.table.none[0]) - judged.table.log_total)
    assert found.sizes[0] == pytest.approx(float(as_learned.sum()), abs=1e-9)


def at_once(change_mm: FloatArray, believed: FloatArray) -> Posterior:
    """Of four wheels that are known to 0.15 mm each, and to 0.2 mm in common, in one young window."""
    spread = np.full((4, 4), 2e-4**2) + np.eye(4) * 1.5e-4**2
    return posterior([Window("now", verdict(ALL, 1e-3 * change_mm, spread), believed, believed)])


def test_what_is_not_believed_passes_and_keeps_an_alarm() -> None:
    """Both front tyres are 1.8 mm smaller. Where an axle may be soft both have lost air; where it is not,
    neither has, and both may have: an alarm that stands is not cleared."""
    change, every = np.array([-1.8, -1.8, 0.0, 0.0]), members(4)
    alone = every * (every.sum(axis=1) == 1.0)[:, None]
    sure, unsure = at_once(change, every), at_once(change, alone)
    assert sure.deflated[:2].min() > 0.99
    assert unsure.deflated.max() < 0.01
    assert unsure.possible[:2].min() > 0.99
    assert unsure.possible[2:].max() < 0.01


def test_windows_of_the_same_data_say_what_one_of_them_says() -> None:
    """A window that is there twice shares its prior with itself."""
    change, every = 1e-3 * np.array([-0.8, 0.0, 0.1, 0.0]), members(4)
    spread = np.full((4, 4), 3e-4**2) + np.eye(4) * 2e-4**2
    reported = verdict(ALL, change, spread)
    once = posterior([Window("minutes", reported, every, every)])
    twice = posterior([Window("now", reported, every, every), Window("minutes", reported, every, every)])
    assert twice.lost == pytest.approx(once.lost, abs=1e-3)
    assert twice.deflated == pytest.approx(once.deflated, abs=1e-3)
    assert twice.deviates == pytest.approx(once.deviates, abs=1e-9)


@pytest.mark.parametrize("larger_mm", [0.0, 5.0, 9.0])
def test_a_loss_that_began_now_is_seen_beside_a_size_from_before(larger_mm: float) -> None:
    """Over minutes all wheels were larger alike; now fl is 1.8 mm smaller than that."""
    every = members(4)
    spread = np.full((4, 4), 3e-4**2) + np.eye(4) * 1.5e-4**2
    before = np.full(4, 1e-3 * larger_mm)
    now = before - np.array([1.8e-3, 0.0, 0.0, 0.0])
    sizes = since(ALL, before, spread / 3.0)
    found = posterior(
        [
            Window("now", verdict(ALL, now, spread, sizes), every, every, sizes.came),
            Window("minutes", verdict(ALL, before, spread / 3.0), every, every),
        ]
    )
    assert found.deflated[0] > 0.99
    assert found.deflated[1:].max() < 0.01
    assert found.onsets["now"] > 0.99
    assert (found.sizes[0] > 0.9) == (larger_mm == 0.0)


def test_to_ask_changes_nothing() -> None:
    """The tables of the windows are as they were, and the second answer is the first."""
    every = members(4)
    reported = verdict(ALL, 1e-3 * np.array([-1.0, 0.0, 0.0, 0.0]), np.eye(4) * 2e-4**2)
    window = Window("minutes", reported, every, every)
    before = reported.table.lost.copy()
    first, second = posterior([window]), posterior([window])
    assert np.array_equal(before, reported.table.lost)
    assert np.array_equal(first.deflated, second.deflated)
    assert 0.0 <= first.none <= 1.0
    assert first.changed <= 1.0 - first.none + 1e-9
