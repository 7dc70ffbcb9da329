"""Slips from forces, and the observer that follows a drive, against the model that made the drive."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.vehicle_state.observer import SlipObserver
from tests.car.vehicle_state.cars import PAPER_CAR, steering
from tpmsd.car.vehicle_state import model
from tpmsd.car.vehicle_state.loads import wheel_loads
from tpmsd.car.vehicle_state.model import StepInputs
from tpmsd.car.vehicle_state.settings import SETTINGS
from tpmsd.car.vehicle_state.slips import angle_for_force, slip_traces, wheel_slips
from tpmsd.car.vehicle_state.tyre import DugoffTyre

NONE = np.zeros(1)


@settings(derandomize=True)
@given(st.floats(-1.0, 1.0), st.floats(500.0, 9000.0))
def test_the_turned_tyre_gives_back_the_force(share: float, load: float) -> None:
    """angle_for_force is the inverse of Dugoff's side force, up to `max_use` of the limit."""
    wanted = SETTINGS.max_use * share * 0.9 * load
    angle = angle_for_force(np.array(wanted), np.array(load), 50e3, 0.9)
    back = DugoffTyre(80e3, 50e3, 0.9).forces(np.array(0.0), angle, np.array(load)).left_n
    assert wanted == pytest.approx(float(back), rel=1e-6, abs=1e-6)


def test_wheel_slips_carry_the_acceleration() -> None:
    """Through the tyre and along the car, the slips give back m a_x: straight, and with the fronts at work in
    a bend, where the steered wheels' side force must be driven against."""
    car = PAPER_CAR
    for accel, lateral, front_angle, steer in (
        (-3.0, 0.0, 0.0, 0.0),
        (1.0, 0.0, 0.0, 0.0),
        (0.0, 4.0, 0.06, 0.08),
    ):
        arrays = (
            np.array([value]) for value in (accel, lateral, -0.02 if lateral else 0.0, front_angle, steer)
        )
        slips = wheel_slips(car, *arrays)
        load = wheel_loads(car, np.array([accel]), np.array([lateral]))
        rear_angle = 0.02 if lateral else 0.0
        angles = np.array([[front_angle, front_angle, rear_angle, rear_angle]])
        along = car.tyres.forces(slips, angles, load).along_n
        backwards = car.mass_kg * lateral * car.rear_m / car.wheelbase_m * math.sin(steer)
        assert car.mass_kg * accel + backwards == pytest.approx(float(along.sum()), rel=0.02, abs=1.0)


def test_slip_traces_are_those_of_steady_cornering() -> None:
    """A steady bend of the full model: side slip and slip angle agree with the state it settles at."""
    state = np.array([0.0, 20.0, 0.0])
    for _ in range(1500):
        state = model.advance(PAPER_CAR, state, steering(0.03))
        state[model.U] = 20.0
    v, u, r = state
    traces = slip_traces(PAPER_CAR, NONE, np.array([u * r]), NONE, np.array([0.03]))
    assert math.atan2(v - PAPER_CAR.rear_m * r, u) == pytest.approx(traces.side_slip_rad[0], rel=0.1)
    angle = 0.03 - math.atan2(v + PAPER_CAR.front_m * r, u)
    assert angle == pytest.approx(traces.front_slip_angle_rad[0], rel=0.1)
    assert traces.side_slip_rad[0] < 0.0 < traces.front_slip_angle_rad[0]


def test_grip_used_is_the_share_of_the_friction_circle() -> None:
    """A front wheel that brakes with its share of m a uses that over friction times its load."""
    traces = slip_traces(PAPER_CAR, np.array([-2.0]), NONE)
    load = wheel_loads(PAPER_CAR, np.array([-2.0]), NONE)
    share = PAPER_CAR.brake_front_share * 0.5
    front = PAPER_CAR.mass_kg * 2.0 * share / (PAPER_CAR.friction * load[0, 0])
    assert front == pytest.approx(traces.grip_used[0, 0], rel=1e-6)
    assert (traces.grip_used >= 0.0).all() and (traces.grip_used <= 1.0).all()


def test_unknown_inputs_stay_unknown() -> None:
    """NaN in, NaN out, tick by tick; different lengths are refused."""
    traces = slip_traces(PAPER_CAR, np.array([0.0, np.nan, 0.5]), np.array([1.0, 1.0, np.nan]))
    assert [True, False, False] == list(np.isfinite(traces.wheel_slip).all(axis=1))
    assert [True, False] == list(np.isfinite(traces.side_slip_rad[[0, 2]]))
    with pytest.raises(ValueError, match="length"):
        slip_traces(PAPER_CAR, NONE, np.zeros(2))


# -- observer -----------------------------------------------------------------------------------------------


def drive(count: int = 300) -> tuple[np.ndarray, list[tuple[float, ...]]]:
    """A slalom of the model at 10 Hz with exact sensors: states, and what the observer is given."""
    state = np.array([0.0, 20.0, 0.0])
    states, given_ = [], []
    for k in range(count):
        step = StepInputs(0.1, 0.5 * math.sin(0.05 * k), 0.03 * math.sin(0.2 * k))
        state = model.advance(PAPER_CAR, state, step)
        lateral, yaw, speed = model.measurements(PAPER_CAR, state, step)
        states.append(state)
        given_.append((0.1, step.accel_long_mps2, float(lateral), float(yaw), step.steer_rad, float(speed)))
    return np.array(states), given_


def test_the_observer_follows_the_side_slip() -> None:
    """With its own car and exact sensors the side slip is right to a tenth of what there is of it."""
    states, given_ = drive()
    observer = SlipObserver(PAPER_CAR)
    told = [observer.step(*values) for values in given_]
    side = np.arctan2(states[:, 0] - PAPER_CAR.rear_m * states[:, 2], states[:, 1])
    found = np.array([math.nan if t is None else t.side_slip_rad for t in told])
    assert np.sqrt(np.mean((found - side) ** 2)) < 0.1 * side.std()
    assert observer.trusted


def test_a_bus_without_inertial_signals_gives_nothing() -> None:
    """Without acceleration, yaw rate or steering there is no estimate, and no error either."""
    _, given_ = drive(20)
    for missing in (1, 3, 4, 5):
        observer = SlipObserver(PAPER_CAR)
        for values in given_:
            lacking = list(values)
            lacking[missing] = math.nan
            assert observer.step(*lacking) is None
    without_lateral = list(given_[0])
    without_lateral[2] = math.nan
    assert SlipObserver(PAPER_CAR).step(*without_lateral) is not None


def test_a_steering_signal_of_the_wrong_sign_loses_trust() -> None:
    """Signals that contradict the model are noticed."""
    _, given_ = drive(600)
    observer = SlipObserver(PAPER_CAR)
    for values in given_:
        wrong = list(values)
        wrong[4] = -4.0 * values[4]
        observer.step(*wrong)
    assert not observer.trusted


def test_the_observer_begins_anew_after_a_stop() -> None:
    """At a standstill nothing is told; afterwards the estimate comes back."""
    _, given_ = drive(40)
    observer = SlipObserver(PAPER_CAR)
    for values in given_:
        observer.step(*values)
    assert observer.step(0.1, 0.0, 0.0, 0.0, 0.0, 0.0) is None
    again = observer.step(*given_[-1])
    assert again is not None and again.speed_mps == pytest.approx(given_[-1][5], abs=0.5)
