"""The estimator from tick to tick: what it follows, when it begins again, what it says of its error."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.car.vehicle_state.cars import PAPER_CAR
from tpmsd.car.config.dynamics_record import DynamicsConfig
from tpmsd.car.vehicle_state import model
from tpmsd.car.vehicle_state.configured import configured_car
from tpmsd.car.vehicle_state.estimator import FILTERS, VehicleStateEstimator, make_filter, state_of
from tpmsd.car.vehicle_state.kalman import FilterNoise, GaussianState
from tpmsd.car.vehicle_state.model import StepInputs
from tpmsd.car.vehicle_state.record import VehicleState
from tpmsd.foundation.errors import ConfigError

DT_S = 0.05


def drive(count: int = 200) -> tuple[np.ndarray, list[tuple[float, ...]]]:
    """A slalom of the 3-DOF model with exact sensors: states (n, 3), and what each step is given."""
    state = np.array([0.0, 20.0, 0.0])
    states, given = [], []
    for k in range(count):
        step = StepInputs(DT_S, 0.5 * math.sin(0.05 * k), 0.03 * math.sin(0.1 * k))
        state = model.advance(PAPER_CAR, state, step)
        lateral, yaw, speed = (float(value) for value in model.measurements(PAPER_CAR, state, step))
        states.append(state)
        given.append((DT_S, step.accel_long_mps2, lateral, yaw, step.steer_rad, speed))
    return np.array(states), given


def estimator(method: str, seed: int = 1) -> VehicleStateEstimator:
    return VehicleStateEstimator(PAPER_CAR, method, np.random.default_rng(seed), 50)


@pytest.mark.parametrize("method", FILTERS)
def test_each_filter_follows_the_model(method: str) -> None:
    """With its own car and exact sensors speeds and yaw rate are right within the stated deviations."""
    states, given = drive()
    one = estimator(method)
    told = [one.step(*values) for values in given]
    assert None not in told
    found = np.array(told)
    truth = np.column_stack(
        [states[:, 1], states[:, 0], np.arctan2(states[:, 0], states[:, 1]), states[:, 2]]
    )
    off = (found[:, ::2] - truth)[20:]
    assert (np.abs(off) < 3.0 * found[20:, 1::2]).mean() > 0.97
    assert np.sqrt(np.mean(off[:, 1] ** 2)) < 0.15 * states[:, 0].std()


def test_the_side_slip_is_that_of_steady_cornering() -> None:
    """v = (b - a m u^2 / (C_r l)) r of the linear single-track car, by the readings of a steady bend."""
    car = PAPER_CAR
    speed, yaw = 15.0, 0.05
    lateral = (
        car.rear_m - car.front_m * car.mass_kg * speed**2 / (2 * car.cornering_rear_n * car.wheelbase_m)
    ) * yaw
    steer = yaw * (car.wheelbase_m + car.understeer_gradient_s2pm * speed**2) / speed
    one = estimator("ukf")
    for _ in range(100):
        state = one.step(DT_S, 0.0, speed * yaw, yaw, steer, speed)
    assert state is not None
    assert lateral == pytest.approx(state.velocity_lat_mps, abs=0.005)
    assert math.atan2(lateral, speed) == pytest.approx(state.side_slip_rad, abs=5e-4)


def test_the_side_slip_has_the_deviation_of_its_parts() -> None:
    """The spread of atan2(v, u) over draws of a belief is the stated one."""
    rng = np.random.default_rng(3)
    covariance = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.0], [0.0, 0.0, 1e-4]])
    belief = GaussianState(np.array([0.8, 18.0, 0.2]), covariance)
    drawn = rng.multivariate_normal(belief.mean, covariance, 200_000)
    state = state_of(belief)
    assert np.arctan2(drawn[:, 0], drawn[:, 1]).std() == pytest.approx(state.side_slip_std_rad, rel=0.02)
    assert (state.velocity_lat_std_mps, state.velocity_long_std_mps) == pytest.approx((0.2, 0.3))


@pytest.mark.parametrize("method", FILTERS)
def test_a_standstill_and_lost_steering_end_the_estimate(method: str) -> None:
    """Below 2 m/s, and a second after the last steering angle, nothing is said; then it begins again."""
    _, given = drive(60)
    one = estimator(method)
    assert one.step(*given[0]) is not None
    assert one.step(DT_S, 0.0, 0.0, 0.0, 0.0, 1.0) is None
    told = [one.step(*values[:4], math.nan, values[5]) for values in given]
    assert told == [None] * len(given)
    assert one.step(*given[0]) is not None
    held = [one.step(*values[:4], math.nan, values[5]) is not None for values in given[1:]]
    assert all(held[:19]) and not any(held[21:])


@pytest.mark.parametrize("method", FILTERS)
@pytest.mark.parametrize("missing", [1, 2, 3, 5])
def test_a_reading_that_is_missing_for_a_while_is_done_without(method: str, missing: int) -> None:
    """Half a second without acceleration, yaw rate or speed: the estimate goes on and stays near."""
    states, given = drive(120)
    one = estimator(method)
    for k, values in enumerate(given):
        holed = tuple(math.nan if place == missing and 60 <= k < 70 else v for place, v in enumerate(values))
        state = one.step(*holed)
        assert state is not None
        assert abs(state.velocity_lat_mps - states[k, 0]) < 0.3


@pytest.mark.parametrize("method", FILTERS)
def test_means_over_a_tick_tell_the_state_at_its_end(method: str) -> None:
    """A lane change in steps of 5 ms, its signals averaged over ticks of 0.1 s: the lateral speed at the end
    of a tick is met more than twice as well as by an estimator that takes the means for values at the end."""
    state, fine = np.array([0.0, 20.0, 0.0]), []
    for k in range(2000):
        step = StepInputs(0.005, 0.0, 0.04 * math.sin(2.0 * math.pi * 0.5 * 0.005 * k))
        state = model.advance(PAPER_CAR, state, step)
        state[model.U] = 20.0
        fine.append([*model.measurements(PAPER_CAR, state, step), step.steer_rad, state[model.V]])
    ticks = np.array(fine).reshape(-1, 20, 5)
    rmse = {}
    for means in (True, False):
        one = VehicleStateEstimator(PAPER_CAR, method, np.random.default_rng(1), 50, means=means)
        told = [one.step(0.1, 0.0, a, r, steer, u) for a, r, u, steer, _ in ticks.mean(axis=1)]
        off = np.array([s.velocity_lat_mps for s in told if s is not None]) - ticks[:, -1, 4]
        rmse[means] = float(np.sqrt(np.mean(off[10:] ** 2)))
    assert rmse[True] < 0.5 * rmse[False]


def test_without_longitudinal_acceleration_the_speed_s_change_stands_in() -> None:
    """A drive that brakes steadily, no accelerometer: the speed is followed."""
    one = estimator("ekf")
    for k in range(100):
        speed = 30.0 - 3.0 * DT_S * k
        state = one.step(DT_S, math.nan, 0.0, 0.0, 0.0, speed)
        assert state is not None
    assert speed == pytest.approx(state.velocity_long_mps, abs=0.05)


def test_what_contradicts_the_state_for_long_begins_it_anew() -> None:
    """A yaw rate that the robust weights refuse for 2 s is taken as true then."""
    one = estimator("arupf")
    for _ in range(20):
        one.step(DT_S, 0.0, 0.0, 0.0, 0.0, 20.0)
    told = [one.step(DT_S, 0.0, 0.0, 0.8, 0.0, 20.0) for _ in range(60)]
    assert None in told


@pytest.mark.parametrize("method", FILTERS)
def test_no_input_makes_it_raise(method: str) -> None:
    """Readings of any size and sign, missing ones and steps of no length: a state of finite numbers, or
    None."""
    rng = np.random.default_rng(7)
    one = estimator(method)
    for _ in range(400):
        values = rng.standard_normal(5) * 10.0 ** rng.integers(-2, 5, 5)
        values[rng.random(5) < 0.2] = math.nan
        state = one.step(float(rng.choice([0.0, 0.01, 0.1, 0.5])), *map(float, values))
        assert state is None or np.isfinite(state).all()


def test_other_names_are_refused() -> None:
    """A filter is one of four."""
    with pytest.raises(ValueError, match="ekf ukf upf arupf"):
        VehicleStateEstimator(PAPER_CAR, "pf", np.random.default_rng(1))
    start = GaussianState(np.array([0.0, 20.0, 0.0]), np.eye(3))
    with pytest.raises(ValueError, match="ekf ukf upf arupf"):
        make_filter("pf", PAPER_CAR, FilterNoise(), start, np.random.default_rng(1))


def test_the_configured_car_is_that_of_the_tables() -> None:
    """Each wheel has half of its axle's stiffness; what is missing is named."""
    dynamics = DynamicsConfig(1558.0, 2538.0, 1.48, 1.08, 0.432, 90e3, 150e3, friction=0.9)
    car = configured_car(dynamics, 1.51, 1.55, "front")
    assert (45e3, 75e3, 1.48, 1.08) == (car.cornering_front_n, car.cornering_rear_n, car.front_m, car.rear_m)
    assert (1.0, 0.65) == (car.drive_front_share, car.brake_front_share)
    with pytest.raises(ConfigError, match=r"\[dynamics\] yaw_inertia_kgm2 cg_to_front_m"):
        configured_car(DynamicsConfig(mass_kg=1500.0), 1.5, 1.5, "rear")


def test_the_record_has_the_names_of_the_columns() -> None:
    """Values and deviations alternate."""
    from tpmsd.offline.tables.columns import VEHICLE_STATE

    assert VehicleState._fields == tuple(column.name for column in VEHICLE_STATE)
    assert all("_std_" in name for name in VehicleState._fields[1::2])
