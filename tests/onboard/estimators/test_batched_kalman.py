"""Scalar updates of many Kalman filters against the matrix form of the textbook."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.bank.batched_kalman import scalar_update, symmetrise
from tpmsd.onboard.estimators.settings import SETTINGS

ROBUST_FROM = SETTINGS.robust_from


def filters(count: int, size: int, seed: int) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((count, size, size))
    return rng.standard_normal((count, size)), root @ root.swapaxes(1, 2) + 0.1 * np.eye(size)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.integers(1, 5), st.integers(1, 6), st.integers(0, 10_000), st.floats(0.01, 100.0), st.booleans())
def test_within_the_robust_zone_it_is_the_textbook(
    count: int, size: int, seed: int, variance: float, per_particle: bool
) -> None:
    """After an ordinary reading mean and covariance are those of K = P h / (h P h + r), in Joseph's form."""
    mean, cov = filters(count, size, seed)
    rng = np.random.default_rng(seed + 1)
    rows = rng.standard_normal((count, size)) if per_particle else rng.standard_normal(size)
    each = rows if per_particle else np.tile(rows, (count, 1))
    total = np.array([h @ p @ h + variance for h, p in zip(each, cov, strict=True)])
    innovation = rng.uniform(-1, 1, count) * ROBUST_FROM * np.sqrt(total)
    new_mean, new_cov = mean.copy(), cov.copy()
    scalar_update(new_mean, new_cov, innovation, rows, variance)
    for k in range(count):
        gain = cov[k] @ each[k] / total[k]
        joseph = np.eye(size) - np.outer(gain, each[k])
        expected = joseph @ cov[k] @ joseph.T + variance * np.outer(gain, gain)
        assert mean[k] + gain * innovation[k] == pytest.approx(new_mean[k], rel=1e-9, abs=1e-9)
        assert expected == pytest.approx(new_cov[k], rel=1e-7, abs=1e-9)


def test_outliers_lose_influence() -> None:
    """The pull on the mean grows up to 2.5 sigma and falls beyond, as one over the innovation."""
    variance = 4.0
    pulls = []
    for sigmas in (1.0, ROBUST_FROM, 5.0, 50.0):
        mean, cov = np.zeros((1, 1)), np.full((1, 1, 1), 1e-8)
        scalar_update(mean, cov, np.array([sigmas * 2.0]), np.ones(1), variance)
        pulls.append(float(mean[0, 0]))
    edge = 1e-8 * ROBUST_FROM * 2.0 / variance
    assert edge * 1.0 / ROBUST_FROM == pytest.approx(pulls[0], rel=1e-3)
    assert edge == pytest.approx(pulls[1], rel=1e-3)
    assert edge * ROBUST_FROM / 5.0 == pytest.approx(pulls[2], rel=1e-3)
    assert edge * ROBUST_FROM / 50.0 == pytest.approx(pulls[3], rel=1e-3)


def test_an_outlier_leaves_the_covariance_almost_as_it_was() -> None:
    """What is rejected does not narrow the covariance."""
    mean, cov = np.zeros((1, 1)), np.ones((1, 1, 1))
    scalar_update(mean, cov, np.array([200.0]), np.ones(1), 1.0)
    assert cov[0, 0, 0] > 0.99


@settings(derandomize=True, deadline=None)
@given(st.lists(st.floats(0.0, 1e4), min_size=2, max_size=20), st.floats(0.01, 100.0))
def test_the_likelihood_falls_with_the_innovation(sizes: list[float], variance: float) -> None:
    """The further off, the less probable, alike to either side."""
    sizes = sorted(sizes)
    count = len(sizes)
    up, down = (
        scalar_update(
            np.zeros((count, 1)), np.ones((count, 1, 1)), sign * np.array(sizes), np.ones(1), variance
        )
        for sign in (1.0, -1.0)
    )
    assert np.all(np.diff(up) <= 1e-12)
    assert up == pytest.approx(down)


def test_the_likelihood_is_the_student_t_of_the_innovation() -> None:
    """Up to one constant, the log density of t with 5 degrees of freedom and the innovation's variance."""
    from scipy import stats

    innovation = np.array([0.0, 0.5, 3.0, 40.0])
    log = scalar_update(np.zeros((4, 1)), np.ones((4, 1, 1)) * np.array([1, 2, 3, 4.0])[:, None, None],
                        innovation, np.ones(1), 0.5)  # fmt: skip
    scale = np.sqrt(np.array([1, 2, 3, 4.0]) + 0.5)
    expected = stats.t.logpdf(innovation / scale, SETTINGS.innovation_dof) - np.log(scale)
    assert expected - expected[0] == pytest.approx(log - log[0])


def test_considered_states_are_allowed_for_but_not_changed() -> None:
    """With frozen states (Schmidt), the others' update is that of the full gain's own part, and the frozen
    mean and covariance stay as they are; the whole stays a covariance."""
    mean, cov = filters(3, 5, 8)
    row = np.random.default_rng(9).standard_normal(5)
    innovation = np.array([0.2, -0.1, 0.3])
    free_mean, free_cov = mean.copy(), cov.copy()
    scalar_update(free_mean, free_cov, innovation, row, 1.0)
    new_mean, new_cov = mean.copy(), cov.copy()
    scalar_update(new_mean, new_cov, innovation, row, 1.0, frozen_from=3)
    assert free_mean[:, :3] == pytest.approx(new_mean[:, :3])
    assert free_cov[:, :3, :] == pytest.approx(new_cov[:, :3, :])
    assert np.array_equal(mean[:, 3:], new_mean[:, 3:])
    assert np.array_equal(cov[:, 3:, 3:], new_cov[:, 3:, 3:])
    assert np.all(np.linalg.eigvalsh(new_cov) > 0.0)
    # Against the definition: x+ = x + K z with K's frozen rows zero.
    for k in range(3):
        gain = cov[k] @ row / (row @ cov[k] @ row + 1.0)
        gain[3:] = 0.0
        part = np.eye(5) - np.outer(gain, row)
        assert part @ cov[k] @ part.T + np.outer(gain, gain) == pytest.approx(new_cov[k])


def test_symmetrising_keeps_what_is_symmetric() -> None:
    """A covariance stays; an asymmetric one becomes its symmetric part; diagonals stay positive."""
    _, cov = filters(2, 3, 4)
    same = cov.copy()
    symmetrise(same)
    assert cov == pytest.approx(same)
    odd = np.array([[[1.0, 2.0], [0.0, -1e-9]]])
    symmetrise(odd)
    assert np.array([[[1.0, 1.0], [1.0, 1e-14]]]) == pytest.approx(odd)
