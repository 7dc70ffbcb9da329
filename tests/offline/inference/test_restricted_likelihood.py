"""The restricted likelihood of a noise, its gradient and the draws from it, against dense matrices."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.blocks import V, W
from tpmsd.offline.inference.layouts import DRIFTING_RADII
from tpmsd.offline.inference.noise import LIMITS, Noise
from tpmsd.offline.inference.noise_fit import Data, log_prior, maximised, restricted_posterior
from tpmsd.offline.inference.state_space import Geometry, StateSpace, diagonals, geometry
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.whitening import Whitener
from tpmsd.offline.inference.windows import GYRO, Reader

WINDOWS = 12
STATES = DRIFTING_RADII.states
NOISE = Noise(reading_m=(0.01, 0.011, 0.012, 0.009), radius_drift=1e-4, clock_s=0.01, gyro_drift_radps=1e-4)


@pytest.fixture(scope="module")
def space() -> Geometry:
    """Of a stretch with missing readings and a gap of three windows."""
    recording = recording_of(drive(Spec(duration_s=200.0), 5))
    windows = Reader(recording, reference(recording)).windows
    here = np.isfinite(windows.measured)
    here[4, GYRO:] = False
    here[7] = False
    at = np.array([*range(7), *range(10, 10 + WINDOWS - 7)])
    index = windows.index[at]
    return geometry(windows, here).part(at, np.diff(index, prepend=index[0] - 1))


def dense_covariance(space: Geometry, noise: Noise, inflate: FloatArray) -> FloatArray:
    """(9w, 9w) of all channels at once, by carrying every source of noise through the drive."""
    made = diagonals(space, noise, inflate)
    system = StateSpace(space, made)
    transition, fresh = system.transition, system.fresh
    state = np.diag(np.sqrt(made.start))
    rows = []
    for k in range(WINDOWS):
        values, vectors = np.linalg.eigh(fresh[k])
        new = vectors * np.sqrt(np.maximum(values, 0.0))
        state = np.concatenate([transition[k] @ state, new], axis=1)
        rows.append(space.rows[k] @ state)
    width = state.shape[1]
    table = np.concatenate([np.pad(row, ((0, 0), (0, width - row.shape[1]))) for row in rows])
    return table @ table.T + np.diag(made.variance.ravel())


def drawn(space: Geometry, columns: int) -> tuple[FloatArray, FloatArray]:
    """(w, 9, 1 + columns) of random numbers, and factors on the variances."""
    rng = np.random.default_rng(8)
    inflate = np.where(rng.random((WINDOWS, 9)) < 0.1, 9.0, 1.0)
    return rng.standard_normal((WINDOWS, 9, 1 + columns)) * [0.02, *[1.0] * columns], inflate


def test_products_of_whitened_columns_are_those_of_the_dense_inverse(space: Geometry) -> None:
    """Gram matrix and log-determinant equal those of the covariance inverted in one piece."""
    columns, inflate = drawn(space, 3)
    covariance = dense_covariance(space, NOISE, inflate)
    seen = space.here.ravel()
    covariance, flat = covariance[np.ix_(seen, seen)], columns.reshape(-1, 4)[seen]
    made = Whitener(space, diagonals(space, NOISE, inflate))
    white = made.apply(columns).reshape(-1, 4)

    assert white.T @ white == pytest.approx(flat.T @ np.linalg.solve(covariance, flat), rel=1e-6)
    assert made.logdet == pytest.approx(np.linalg.slogdet(covariance)[1], rel=1e-9)


def test_the_motion_is_known_as_the_dense_posterior_says(space: Geometry) -> None:
    """Standard deviations of speed and yaw rate are those of all states and channels written out."""
    inflate = np.ones((WINDOWS, 9))
    made = diagonals(space, NOISE, inflate)
    system = StateSpace(space, made)
    transition, fresh = system.transition, system.fresh
    size = WINDOWS * STATES
    moved = np.eye(size)
    for k in range(1, WINDOWS):
        at, before = slice(k * STATES, (k + 1) * STATES), slice((k - 1) * STATES, k * STATES)
        moved[at, before] = -transition[k]
    new = np.zeros((size, size))
    new[:STATES, :STATES] = transition[0] @ np.diag(made.start) @ transition[0].T
    for k in range(WINDOWS):
        new[k * STATES : (k + 1) * STATES, k * STATES : (k + 1) * STATES] += fresh[k]
    back = np.linalg.inv(moved)
    prior = back @ new @ back.T
    H = np.zeros((WINDOWS * 9, size))
    for k in range(WINDOWS):
        H[9 * k : 9 * k + 9, k * STATES : (k + 1) * STATES] = space.rows[k]
    seen = space.here.ravel()
    H, R = H[seen], np.diag(made.variance.ravel()[seen])
    gain = prior @ H.T @ np.linalg.inv(H @ prior @ H.T + R)
    variances = np.diag(prior - gain @ H @ prior).reshape(WINDOWS, STATES)

    expected = np.sqrt(variances[:, [V, W]])
    assert Whitener(space, made).motion_stds() == pytest.approx(expected, rel=1e-3)


def test_the_restricted_likelihood_is_that_of_error_contrasts(space: Geometry) -> None:
    """Between two noises it differs as the likelihood of contrasts that are free of the columns does."""
    columns, inflate = drawn(space, 2)
    seen = space.here.ravel()
    flat = columns.reshape(-1, 3)[seen]
    contrasts = np.linalg.svd(flat[:, 1:])[0][:, 2:]
    data = Data(space, columns, inflate)
    other = dataclasses.replace(NOISE, gyro_radps=3e-3, slow_tau_s=20.0)
    values, expected = [], []
    for noise in (NOISE, other):
        covariance = contrasts.T @ dense_covariance(space, noise, inflate)[np.ix_(seen, seen)] @ contrasts
        y = contrasts.T @ flat[:, 0]
        misfit = float(y @ np.linalg.solve(covariance, y)) + np.linalg.slogdet(covariance)[1]
        expected.append(-0.5 * misfit)
        values.append(restricted_posterior(data, noise, [])[0] - log_prior(noise))

    assert values[1] - values[0] == pytest.approx(expected[1] - expected[0], rel=1e-4)


@pytest.mark.parametrize("name", sorted(DRIFTING_RADII.parameters))
def test_the_gradient_is_that_of_differences(space: Geometry, name: str) -> None:
    """By the logarithm of every parameter (of a correlation, the logit)."""
    columns, inflate = drawn(space, 2)
    data, step = Data(space, columns, inflate), 1e-4
    value = float(getattr(NOISE, name))
    odds = value / (1.0 - value)
    trials = []
    for sign in (1.0, -1.0):
        moved = odds * np.exp(sign * step)
        at = moved / (1.0 + moved) if name == "speed_memory" else value * np.exp(sign * step)
        noise = dataclasses.replace(NOISE, **{name: float(at)})
        trials.append(restricted_posterior(data, noise, [])[0])
    _, slope = restricted_posterior(data, NOISE, [name])

    assert slope[0] == pytest.approx((trials[0] - trials[1]) / (2.0 * step), rel=1e-3, abs=1e-3)


def test_draws_have_the_covariance_of_the_noise(space: Geometry) -> None:
    """Whitened by the noise that they were drawn from, residuals are independent and of unit variance; their
    covariance is the dense one."""
    made = Whitener(space, diagonals(space, NOISE))
    draws = made.simulate(np.random.default_rng(3), 4000)
    white = made.apply(draws)[space.here]
    covariance = dense_covariance(space, NOISE, np.ones((WINDOWS, 9)))
    seen = space.here.ravel()
    reported = draws.reshape(-1, 4000)[seen]
    size = np.sqrt(np.diag(covariance)[seen])
    ratio = (reported @ reported.T / 4000) / np.outer(size, size)

    assert np.abs(np.cov(white) - np.eye(len(white))).max() < 0.1
    assert np.abs(ratio - covariance[np.ix_(seen, seen)] / np.outer(size, size)).max() < 0.1


@pytest.mark.parametrize("factor", [10.0**-0.5, 10.0**0.5])
@pytest.mark.parametrize(
    "name", ["gyro_radps", "speed_mps", "cross_mps", "rough_m", "white_m", "slow_m", "radius_drift"]
)
def test_a_known_noise_is_found_from_either_side(name: str, factor: float) -> None:
    """Of data drawn with a noise whose size is three times smaller or larger than where the search starts,
    every channel's own is found within a third of its true size."""
    recording = recording_of(drive(Spec(duration_s=420.0), 5))
    windows = Reader(recording, reference(recording)).windows
    space = geometry(windows, np.isfinite(windows.measured))
    start = Noise(reading_m=(0.005,) * 4, rough_m=1e-3, white_m=1.0, radius_drift=1e-4)
    true = dataclasses.replace(start, **{name: getattr(start, name) * factor})
    data = Whitener(space, diagonals(space, true)).simulate(np.random.default_rng(4), 1)
    columns = np.concatenate([data, np.zeros_like(data)], axis=2)
    columns[:, GYRO, 1] = windows.covariates["yaw_rate"]
    names = [one for one in LIMITS if one in (name, "gyro_radps", "speed_mps", "rough_m")]
    found = maximised(Data(space, columns, np.ones(data.shape[:2])), start, names)

    assert getattr(found, name) == pytest.approx(getattr(true, name), rel=0.35)
