"""The four filters: alike where they must be, robust where they should be."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.car.vehicle_state.cars import PAPER_CAR, START
from tpmsd.car.vehicle_state import model
from tpmsd.car.vehicle_state.adaptive import RobustSettings
from tpmsd.car.vehicle_state.kalman import Ekf, FilterNoise, GaussianState, StateFilter, Ukf
from tpmsd.car.vehicle_state.model import StepInputs
from tpmsd.car.vehicle_state.particle import UnscentedParticleFilter

NOISE = FilterNoise()
MAKERS: dict[str, Callable[[int], StateFilter]] = {
    "ekf": lambda seed: Ekf(PAPER_CAR, NOISE, START),
    "ukf": lambda seed: Ukf(PAPER_CAR, NOISE, START),
    "arukf": lambda seed: Ukf(PAPER_CAR, NOISE, START, RobustSettings()),
    "upf": lambda seed: UnscentedParticleFilter(PAPER_CAR, NOISE, START, np.random.default_rng(seed)),
    "arupf": lambda seed: UnscentedParticleFilter(
        PAPER_CAR, NOISE, START, np.random.default_rng(seed), RobustSettings()
    ),
    "upf*": lambda seed: UnscentedParticleFilter(
        PAPER_CAR, NOISE, START, np.random.default_rng(seed), carry=False
    ),
    "arupf*": lambda seed: UnscentedParticleFilter(
        PAPER_CAR, NOISE, START, np.random.default_rng(seed), RobustSettings(), carry=False
    ),
}


def slalom(
    count: int = 300, outliers: bool = False, speed: bool = True
) -> tuple[np.ndarray, list, np.ndarray]:
    """A drive of the model itself with the noise the filters assume: truth, inputs, readings."""
    rng = np.random.default_rng(11)
    state = np.array([0.0, 20.0, 0.0])
    truth, inputs, readings = [], [], []
    for k in range(count):
        step = StepInputs(0.02, -0.5 if k > 150 else 0.3, 0.03 * np.sin(0.06 * k))
        state = model.advance(PAPER_CAR, state, step)
        state = state + np.array(NOISE.process) * np.sqrt(step.dt_s) * rng.standard_normal(3)
        noise = np.array(NOISE.readings) * rng.standard_normal(3)
        reading = model.measurements(PAPER_CAR, state, step) + noise
        if outliers and k % 17 == 9:
            reading[k % 2] += (6.0, 0.5)[k % 2]
        if not speed:
            reading[2] = np.nan
        truth.append(state)
        inputs.append(step)
        readings.append(reading)
    return np.array(truth), inputs, np.array(readings)


def run(filter_: StateFilter, inputs: list, readings: np.ndarray) -> list[GaussianState]:
    return [filter_.step(i, r) for i, r in zip(inputs, readings, strict=True)]


def rmse(beliefs: list[GaussianState], truth: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean((np.array([b.mean for b in beliefs]) - truth) ** 2, axis=0))


@pytest.mark.parametrize("name", ["ekf", "ukf"])
def test_stated_uncertainty_is_the_real_one(name: str) -> None:
    """On a drive of the model itself the normalised squared error averages the number of states, 3."""
    truth, inputs, readings = slalom()
    beliefs = run(MAKERS[name](1), inputs, readings)
    off = [b.mean - t for b, t in zip(beliefs, truth, strict=True)]
    squared = [e @ np.linalg.solve(b.covariance, e) for e, b in zip(off, beliefs, strict=True)]
    assert 2.2 < np.mean(squared) < 4.0


@pytest.mark.parametrize("name", list(MAKERS))
def test_every_filter_follows_the_model(name: str) -> None:
    """Without outliers all are about as good as the Kalman filters."""
    truth, inputs, readings = slalom()
    best = rmse(run(MAKERS["ekf"](1), inputs, readings), truth)
    assert (rmse(run(MAKERS[name](1), inputs, readings), truth) < 1.4 * best).all()


def test_ekf_and_ukf_agree_where_the_model_is_nearly_linear() -> None:
    """On gentle steering their means differ by a small part of their standard deviations."""
    _, inputs, readings = slalom()
    for one, other in zip(*(run(MAKERS[n](1), inputs, readings) for n in ("ekf", "ukf")), strict=True):
        assert (np.abs(one.mean - other.mean) < 0.2 * np.sqrt(np.diag(one.covariance))).all()


@pytest.mark.parametrize(("plain", "robust"), [("ukf", "arukf"), ("upf", "arupf"), ("upf*", "arupf*")])
def test_outliers_pull_the_robust_filter_less(plain: str, robust: str) -> None:
    """One reading in 17 is far off: the robust form's yaw rate is less than half as wrong."""
    truth, inputs, readings = slalom(outliers=True)
    bad, good = (rmse(run(MAKERS[n](1), inputs, readings), truth) for n in (plain, robust))
    assert good[model.R] < 0.5 * bad[model.R]
    assert (good < 1.05 * bad).all()


def test_one_wild_reading_changes_nothing() -> None:
    """A gyro spike of 5 rad/s weighs nothing: the belief is as if the gyro had been silent."""
    _, inputs, readings = slalom(60)
    spiked, silent = readings.copy(), readings.copy()
    spiked[59, 1] += 5.0
    silent[59, 1] = np.nan
    one, other = (run(MAKERS["arukf"](1), inputs, r)[-1] for r in (spiked, silent))
    assert np.allclose(one.mean, other.mean, atol=1e-5)
    assert np.allclose(one.covariance, other.covariance, atol=1e-7)


@pytest.mark.parametrize("name", list(MAKERS))
def test_silent_sensors_leave_the_model_alone(name: str) -> None:
    """Without any reading the state is what the model makes of the inputs, ever less sure."""
    filter_ = MAKERS[name](1)
    inputs = StepInputs(0.02, 0.0, 0.0)
    first = filter_.step(inputs, np.full(3, np.nan))
    for _ in range(50):
        last = filter_.step(inputs, np.full(3, np.nan))
    assert last.mean[model.U] == pytest.approx(20.0, abs=0.3)
    if name not in ("upf", "arupf"):
        assert last.covariance[model.U, model.U] > first.covariance[model.U, model.U]


def test_the_near_optimal_proposal_keeps_its_particles() -> None:
    """With it most particles keep their weight; as published few do."""
    _, inputs, readings = slalom(100)
    shares = []
    for carry in (True, False):
        filter_ = UnscentedParticleFilter(PAPER_CAR, NOISE, START, np.random.default_rng(1), carry=carry)
        seen = []
        for step, reading in zip(inputs, readings, strict=True):
            filter_.step(step, reading)
            seen.append(filter_.effective / 100)
        shares.append(np.mean(seen))
    assert shares[0] < 0.4 < 0.6 < shares[1]


@pytest.mark.parametrize("name", ["upf", "arupf", "upf*", "arupf*"])
def test_the_same_seed_gives_the_same_estimate(name: str) -> None:
    """All randomness is the generator's."""
    _, inputs, readings = slalom(40)
    one, other, else_ = (run(MAKERS[name](s), inputs, readings)[-1].mean for s in (1, 1, 2))
    assert np.array_equal(one, other)
    assert not np.array_equal(one, else_)


def test_no_particles_no_filter() -> None:
    """Fewer than one particle is refused."""
    with pytest.raises(ValueError, match="particles"):
        UnscentedParticleFilter(PAPER_CAR, NOISE, START, np.random.default_rng(1), particles=0)
