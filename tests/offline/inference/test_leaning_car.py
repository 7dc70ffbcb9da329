"""The calibration's states against covariances written out source by source, and priors on the columns."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.blocks import PE, PSI, QOLD, Q, V, W
from tpmsd.offline.inference.layouts import AGE_STD_S, GYRO_BIAS_STD_RADPS, LEANING_CAR
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.noise_fit import Data, log_prior, maximised, restricted_posterior
from tpmsd.offline.inference.state_space import SPEED_STD_MPS, YAW_STD_RADPS, Geometry, diagonals, geometry
from tpmsd.offline.inference.trajectory import WINDOW_S
from tpmsd.offline.inference.whitening import Whitener
from tpmsd.offline.inference.windows import CHANNELS, Linearised

STATES = LEANING_CAR.states
PLAIN = Noise(reading_m=(0.01, 0.01, 0.012, 0.008))
ROUGH = dataclasses.replace(
    PLAIN,
    rough_m=3e-3,
    speed_mps=0.2,
    side_slip_rad=0.01,
    slow_m=2.0,
    left_right_drift=1e-3,
    age_s=3e-3,
    gyro_drift_radps=1e-3,
)


def random_windows(rng: np.random.Generator, count: int) -> Linearised:
    """Windows whose channels see anything of the motion."""
    return Linearised(
        index=np.arange(count),
        fixes=rng.integers(1, 5, (count, 3)).astype(float),
        after_fixes=rng.uniform(0.0, 1.0, (count, 3)),
        covariates={
            "speed": rng.uniform(2.0, 30.0, count),
            "yaw_rate": rng.normal(0.0, 0.1, count),
            "accel_kinematic": rng.normal(0.0, 1.0, count),
        },
        design=rng.standard_normal((count, CHANNELS, 3)),
        to_east_north=rng.standard_normal((count, 2, 3)),
    )


def random_space(seed: int, count: int) -> tuple[Linearised, Geometry]:
    """The same with a fifth of all readings missing."""
    rng = np.random.default_rng(seed)
    windows = random_windows(rng, count)
    return windows, geometry(windows, rng.random((count, CHANNELS)) > 0.2, LEANING_CAR)


def dense_covariance(windows: Linearised, space: Geometry, noise: Noise) -> FloatArray:
    """(9w, 9w) of all channels of all windows, by carrying every single source of noise through the drive."""
    at = LEANING_CAR.names.index
    v = windows.covariates["speed"]
    reading = np.sqrt(np.square(noise.reading_m) + (noise.stamp_s * v[:, None]) ** 2)
    kept = {
        at("slow_east"): (np.exp(-WINDOW_S / noise.slow_tau_s), noise.slow_m),
        at("slow_north"): (np.exp(-WINDOW_S / noise.slow_tau_s), noise.slow_m),
        at("gnss_speed"): (noise.speed_memory, noise.speed_mps),
        at("gnss_cross_speed"): (noise.speed_memory, noise.cross_mps),
        at("left_right_drift"): (np.exp(-WINDOW_S / noise.left_right_drift_tau_s), noise.left_right_drift),
        at("side_slip"): (
            np.exp(-WINDOW_S / noise.side_slip_tau_s),
            noise.side_slip_rad,
        ),
    }
    walks = {at("gyro_bias"): noise.gyro_drift_radps, at("gnss_age"): noise.age_s}
    start = np.zeros(STATES)
    start[Q : Q + 4], start[PSI], start[PE : PE + 2] = reading[0], 0.5, 300.0
    start[at("gyro_bias")], start[at("gnss_age")] = GYRO_BIAS_STD_RADPS, AGE_STD_S
    for place, (_, std) in kept.items():
        start[place] = std
    state, rows = np.diag(start), []
    for k in range(len(windows)):
        old = np.pad(state, ((0, 0), (0, 14)))
        new = np.zeros_like(old)
        source = iter(range(state.shape[1], old.shape[1]))
        new[QOLD : QOLD + 4] = old[Q : Q + 4]
        for wheel in range(4):
            new[Q + wheel, next(source)] = reading[k, wheel]
        new[V, next(source)] = SPEED_STD_MPS
        new[W, next(source)] = YAW_STD_RADPS
        for place, (decay, std) in kept.items():
            new[place] = decay * old[place]
            new[place, next(source)] = std * np.sqrt(1.0 - decay**2)
        for place, growth in walks.items():
            new[place] = old[place]
            new[place, next(source)] = growth
        new[PSI] = old[PSI] + WINDOW_S * new[W]
        for axis in (0, 1):
            by_v, by_w, by_heading = windows.to_east_north[k, axis]
            course = old[PSI] + new[at("side_slip")]
            new[PE + axis] = old[PE + axis] + by_v * new[V] + by_w * new[W] + by_heading * course
        state = new
        rows.append(space.rows[k] @ state)
    table = np.concatenate([np.pad(row, ((0, 0), (0, state.shape[1] - row.shape[1]))) for row in rows])
    return table @ table.T + np.diag(diagonals(space, noise).variance.ravel())


@pytest.mark.parametrize("noise", [PLAIN, ROUGH])
def test_innovations_are_those_of_the_dense_covariance(noise: Noise) -> None:
    """Products of whitened columns and the log-determinant equal those of the covariance inverted in one
    piece."""
    windows, space = random_space(3, 12)
    columns = np.random.default_rng(4).standard_normal((12, CHANNELS, 4)) * space.here[:, :, None]
    seen = space.here.ravel()
    covariance = dense_covariance(windows, space, noise)[np.ix_(seen, seen)]
    made = Whitener(space, diagonals(space, noise))
    white, flat = made.apply(columns).reshape(-1, 4), columns.reshape(-1, 4)[seen]

    assert white.T @ white == pytest.approx(flat.T @ np.linalg.solve(covariance, flat), rel=1e-5)
    assert made.logdet == pytest.approx(np.linalg.slogdet(covariance)[1], rel=1e-7)


def test_a_prior_on_the_columns_is_a_variance_of_the_data() -> None:
    """Between two noises the posterior differs as the likelihood does whose covariance holds what the
    columns' values may add."""
    windows, space = random_space(5, 10)
    rng = np.random.default_rng(6)
    columns = rng.standard_normal((10, CHANNELS, 3)) * space.here[:, :, None]
    prior_std = np.array([0.3, 2.0])
    data = Data(space, columns, np.ones((10, CHANNELS)), prior_std)
    seen = space.here.ravel()
    y, X = columns.reshape(-1, 3)[seen, 0], columns.reshape(-1, 3)[seen, 1:] * prior_std
    values, expected = [], []
    for noise in (PLAIN, ROUGH):
        covariance = dense_covariance(windows, space, noise)[np.ix_(seen, seen)] + X @ X.T
        misfit = float(y @ np.linalg.solve(covariance, y)) + np.linalg.slogdet(covariance)[1]
        expected.append(-0.5 * misfit)
        values.append(restricted_posterior(data, noise, [])[0] - log_prior(noise))

    assert values[1] - values[0] == pytest.approx(expected[1] - expected[0], rel=1e-6)


@pytest.mark.parametrize("name", sorted(LEANING_CAR.parameters))
def test_the_gradient_is_that_of_differences(name: str) -> None:
    """By the logarithm of every parameter (of a correlation, the logit), with a prior on the columns."""
    _, space = random_space(7, 10)
    columns = np.random.default_rng(8).standard_normal((10, CHANNELS, 3)) * space.here[:, :, None]
    data = Data(space, columns, np.ones((10, CHANNELS)), np.array([0.3, 2.0]))
    value, step, trials = float(getattr(ROUGH, name)), 1e-4, []
    for sign in (1.0, -1.0):
        odds = value / (1.0 - value) * np.exp(sign * step)
        at = odds / (1.0 + odds) if name == "speed_memory" else value * np.exp(sign * step)
        noise = dataclasses.replace(ROUGH, **{name: float(at)})
        trials.append(restricted_posterior(data, noise, [])[0])
    _, slope = restricted_posterior(data, ROUGH, [name])

    assert slope[0] == pytest.approx((trials[0] - trials[1]) / (2.0 * step), rel=1e-3, abs=2e-3)


def test_the_fitted_noise_is_as_likely_as_the_true_one() -> None:
    """From data drawn with a known noise, the search reaches at least the posterior of what made them."""
    _, space = random_space(9, 150)
    made = Whitener(space, diagonals(space, ROUGH))
    drawn = made.simulate(np.random.default_rng(10), 1)
    data = Data(space, drawn, np.ones((150, CHANNELS)))
    found = maximised(data, PLAIN, data.estimable())
    start, reached, true = (restricted_posterior(data, noise, [])[0] for noise in (PLAIN, found, ROUGH))

    assert reached > true - 0.5
    assert reached > start + 100.0


def test_only_parameters_of_its_states_and_channels_are_estimated() -> None:
    """A drive without a gyro and without courses estimates neither's noise, nor what its states lack."""
    windows, space = random_space(11, 20)
    here = space.here.copy()
    here[:, [4, 6]] = False
    data = Data(geometry(windows, here, LEANING_CAR), np.zeros((20, CHANNELS, 1)), np.ones((20, CHANNELS)))
    names = data.estimable()

    assert {"rough_m", "left_right_drift", "side_slip_rad", "speed_mps", "age_s", "slow_m"} <= set(names)
    assert not {"gyro_radps", "gyro_drift_radps", "cross_mps", "radius_drift", "clock_s"} & set(names)
