"""The 3-DOF car and its tyres against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.car.vehicle_state.cars import PAPER_CAR, steering
from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.car.vehicle_state import model
from tpmsd.car.vehicle_state.car import CarDynamics, typical
from tpmsd.car.vehicle_state.linear import advance_jacobian, measurement_jacobian, rates_jacobian
from tpmsd.car.vehicle_state.loads import wheel_loads
from tpmsd.car.vehicle_state.tyre import DugoffTyre

ACCEL = st.floats(-9.0, 9.0)


# -- tyre ---------------------------------------------------------------------------------------------------


def forces(slip: float, angle: float, load: float, friction: float = 0.9) -> tuple[float, float]:
    out = DugoffTyre(80e3, 50e3, friction).forces(np.array(slip), np.array(angle), np.array(load))
    return float(out.along_n), float(out.left_n)


@settings(derandomize=True)
@given(st.floats(-0.9, 3.0), st.floats(-1.2, 1.2), st.floats(0.0, 9000.0), st.floats(0.1, 1.2))
def test_the_friction_circle_is_never_left(slip: float, angle: float, load: float, friction: float) -> None:
    """Whatever the slips, both forces together stay within friction times load."""
    assert np.hypot(*forces(slip, angle, load, friction)) <= friction * load * (1.0 + 1e-9) + 1e-9


def test_a_sliding_tyre_reaches_the_circle() -> None:
    """With ever more slip angle the force tends to friction times load: 1 - lambda / 2 of it."""
    limit = 0.9 * 3000.0
    lambda_ = limit / (2 * 50e3 * np.tan(1.2))
    assert limit * (1 - lambda_ / 2) == pytest.approx(forces(0.0, 1.2, 3000.0)[1])
    assert limit == pytest.approx(forces(0.0, 1.5, 3000.0)[1], rel=2e-3)


def test_a_gripping_tyre_is_linear() -> None:
    """Up to half the friction limit the forces are C sigma / (1 + sigma) and C tan(alpha) / (1 + sigma)."""
    along, left = forces(0.01, 0.01, 4000.0)
    assert (80e3 * 0.01 / 1.01, 50e3 * np.tan(0.01) / 1.01) == pytest.approx((along, left))


def test_force_is_continuous_where_sliding_begins() -> None:
    """At lambda = 1 both branches agree, in value and in slope."""
    edge = np.arctan(0.9 * 3000.0 / (2 * 50e3))
    around = [forces(0.0, edge + d, 3000.0)[1] for d in (-2e-6, -1e-6, 1e-6, 2e-6)]
    assert around[1] - around[0] == pytest.approx(around[3] - around[2], rel=1e-3)


def test_braking_and_driving_turn_the_force_round_and_a_lifted_wheel_has_none() -> None:
    """Slip has the sign of the force, slip angle that of the side force; no load, no force."""
    assert forces(-0.02, 0.0, 4000.0)[0] < 0.0 < forces(0.02, 0.0, 4000.0)[0]
    assert forces(0.0, -0.02, 4000.0)[1] == -forces(0.0, 0.02, 4000.0)[1]
    assert (0.0, 0.0) == forces(0.1, 0.1, 0.0) == forces(0.1, 0.1, -500.0)


# -- loads --------------------------------------------------------------------------------------------------


@settings(derandomize=True)
@given(ACCEL, ACCEL)
def test_wheel_loads_sum_to_the_weight(accel_long: float, accel_lat: float) -> None:
    """Accelerations move load about and make none."""
    loads = wheel_loads(PAPER_CAR, np.array(accel_long), np.array(accel_lat))
    assert PAPER_CAR.mass_kg * GRAVITY_MPS2 == pytest.approx(loads.sum())


@settings(derandomize=True)
@given(ACCEL, ACCEL)
def test_wheel_loads_balance_the_moments(accel_long: float, accel_lat: float) -> None:
    """About the road under the centre of gravity: the loads' moments carry m h times the accelerations."""
    car = PAPER_CAR
    loads = wheel_loads(car, np.array(accel_long), np.array(accel_lat))
    assert -car.mass_kg * car.height_m * accel_long == pytest.approx(loads @ car.forward_m, abs=1e-6)
    assert -car.mass_kg * car.height_m * accel_lat == pytest.approx(loads @ car.left_m, abs=1e-6)


def test_load_goes_forward_when_braking_and_out_of_the_bend() -> None:
    """Braking loads the front, a left turn the right wheels."""
    loads = wheel_loads(PAPER_CAR, np.array(-3.0), np.array(3.0))
    rest = wheel_loads(PAPER_CAR, np.array(0.0), np.array(0.0))
    assert loads[1] > loads[0] and loads[3] > loads[2]
    assert loads[:2].sum() > rest[:2].sum()


# -- motion -------------------------------------------------------------------------------------------------


def linear_car() -> CarDynamics:
    """So much grip that no tyre slides, so little height that no load moves."""
    return replace(PAPER_CAR, friction=50.0, height_m=1e-6)


@pytest.mark.parametrize("speed", [8.0, 20.0, 35.0])
def test_steady_cornering_is_that_of_the_linear_bicycle(speed: float) -> None:
    """r = u delta / (l + K u^2) with K = m/l (b/C_f - a/C_r), and v = (b - a m u^2 / (C_r l)) r."""
    car = linear_car()
    steer = 1e-3
    state = np.array([0.0, speed, 0.0])
    for _ in range(3000):
        state = model.advance(car, state, steering(steer))
        state[model.U] = speed
    gradient = car.understeer_gradient_s2pm
    yaw = speed * steer / (car.wheelbase_m + gradient * speed**2)
    rear = 2 * car.cornering_rear_n
    lateral = (car.rear_m - car.front_m * car.mass_kg * speed**2 / (rear * car.wheelbase_m)) * yaw
    assert (lateral, yaw) == pytest.approx((state[model.V], state[model.R]), rel=1e-3, abs=1e-6)


def test_the_understeer_gradient_has_its_sign() -> None:
    """This nose-light car with stiff rear tyres understeers; with the stiffnesses exchanged less so."""
    car = PAPER_CAR
    other = replace(car, cornering_front_n=75_000.0, cornering_rear_n=45_000.0)
    assert car.understeer_gradient_s2pm > 0.0 > other.understeer_gradient_s2pm


def test_a_left_turn_is_positive_everywhere() -> None:
    """Steering left turns left, accelerates left, and loads nothing on the other side."""
    state = np.array([0.0, 20.0, 0.0])
    for _ in range(200):
        state = model.advance(PAPER_CAR, state, steering(0.02))
    reading = model.measurements(PAPER_CAR, state, steering(0.02))
    assert (reading[:2] > 0.0).all()
    assert reading[0] == pytest.approx(state[model.U] * state[model.R], rel=1e-2)


def test_straight_driving_only_integrates_the_acceleration() -> None:
    """Without steering nothing turns, and the speed follows the accelerometer."""
    state = np.array([0.0, 20.0, 0.0])
    for _ in range(100):
        state = model.advance(PAPER_CAR, state, steering(0.0, -2.0))
    assert (0.0, 18.0, 0.0) == pytest.approx(tuple(state))


def test_braking_is_carried_by_slip() -> None:
    """The wheels' longitudinal forces together are m a_x, split as the brakes split it."""
    state = np.array([0.0, 20.0, 0.0])
    along = model.wheel_states(PAPER_CAR, state, steering(0.0, -2.0)).forces.along_n
    assert -2.0 * PAPER_CAR.mass_kg == pytest.approx(along.sum())
    assert PAPER_CAR.brake_front_share == pytest.approx(along[:2].sum() / along.sum())


def test_many_states_at_once_are_as_one_by_one() -> None:
    """Particles and sigma points are leading axes and nothing more."""
    rng = np.random.default_rng(2)
    states = np.array([0.0, 20.0, 0.2]) + rng.standard_normal((5, 7, 3)) * [0.5, 2.0, 0.1]
    inputs = steering(0.03, -1.0, 0.1)
    together = model.advance(PAPER_CAR, states, inputs)
    for i in range(5):
        for j in range(7):
            assert np.allclose(together[i, j], model.advance(PAPER_CAR, states[i, j], inputs), atol=1e-12)


def test_slow_cars_do_not_blow_up() -> None:
    """At walking pace and below, with a tick of 0.1 s, the state stays finite and small."""
    for speed in (0.0, 0.5, 2.0, 4.0):
        state = np.array([0.1, speed, 0.05])
        for _ in range(100):
            state = model.advance(PAPER_CAR, state, steering(0.2, 0.0, 0.1))
        assert np.abs(state).max() < 10.0


# -- derivatives --------------------------------------------------------------------------------------------

STATES = [
    ((0.0, 20.0, 0.0), 0.0, 0.0),
    ((-0.3, 22.0, 0.3), 0.03, -1.5),
    ((0.9, 22.0, -0.5), -0.09, 0.5),
    ((0.1, 1.5, 0.2), 0.2, 0.0),
]


@pytest.mark.parametrize(("state", "steer", "accel"), STATES)
def test_the_derivatives_are_those_of_finite_differences(
    state: tuple[float, ...], steer: float, accel: float
) -> None:
    """Gripping, sliding and crawling: rates, readings and a whole tick."""
    car = replace(PAPER_CAR, roll_rad_per_mps2=0.01)
    inputs, x = steering(steer, accel, 0.1), np.array(state)

    def differences(function: object) -> np.ndarray:
        columns = []
        for k in range(3):
            h = np.zeros(3)
            h[k] = 1e-6
            columns.append((function(car, x + h, inputs) - function(car, x - h, inputs)) / 2e-6)  # type: ignore[operator]
        return np.stack(columns, axis=1)

    for function, derivative in (
        (model.rates, rates_jacobian(car, x, inputs)),
        (model.measurements, measurement_jacobian(car, x, inputs)),
        (model.advance, advance_jacobian(car, x, inputs)[1]),
    ):
        assert np.allclose(differences(function), derivative, rtol=1e-4, atol=1e-5)
    assert np.array_equal(advance_jacobian(car, x, inputs)[0], model.advance(car, x, inputs))


# -- the typical car ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("driven", ["front", "rear", "all"])
def test_a_typical_car_understeers_like_a_passenger_car(driven: str) -> None:
    """Published gradients of passenger cars are about 1 to 5 degrees of road wheel per g (Gillespie 1992)."""
    car = typical(2.63, 1.53, 1.52, driven)
    per_g = np.degrees(car.understeer_gradient_s2pm * GRAVITY_MPS2)
    assert 0.5 < per_g < 5.0
    assert 2.63 == pytest.approx(car.wheelbase_m)


def test_no_car_without_a_mass() -> None:
    """Values that make no car are refused by name."""
    with pytest.raises(ValueError, match="mass_kg"):
        replace(PAPER_CAR, mass_kg=0.0)
    with pytest.raises(ValueError, match="friction"):
        replace(PAPER_CAR, friction=float("nan"))
