"""The model's derivatives, for the extended Kalman filter.

In: one state (3,). Out: (3, 3) matrices. Analytic throughout; `advance_jacobian` is the derivative of the
midpoint rule itself, not of the differential equation.
"""

from __future__ import annotations

import numpy as np

from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.car.vehicle_state.car import CarDynamics
from tpmsd.car.vehicle_state.model import (
    MIN_SPEED_MPS,
    R,
    StepInputs,
    U,
    V,
    rates,
    road_wheel_cos_sin,
    substeps,
    wheel_states,
)
from tpmsd.foundation.wheels import FloatArray


def _force_gradients(
    car: CarDynamics, state: FloatArray, inputs: StepInputs
) -> tuple[FloatArray, FloatArray]:
    """Return the (3,) derivatives of lateral acceleration and of yaw acceleration by the state."""
    at = wheel_states(car, state, inputs)
    forces = car.tyres.gradients(at.slip, at.slip_angle_rad, at.load_n)
    # d(angle) = -d atan2(left, along); a hub slower than MIN_SPEED_MPS has its along speed held.
    free = at.hub_along_mps > MIN_SPEED_MPS
    along = np.maximum(at.hub_along_mps, MIN_SPEED_MPS)
    square = along**2 + at.hub_left_mps**2
    by_left, by_along = -along / square, np.where(free, at.hub_left_mps / square, 0.0)
    angle = np.stack([by_left, by_along, by_left * car.forward_m - by_along * car.left_m])
    base = car.wheelbase_m
    front, rear = (
        car.height_m * car.mass_kg * arm / (base * track)
        for arm, track in ((car.rear_m, car.track_front_m), (car.front_m, car.track_rear_m))
    )
    by_lateral = np.array([-front, front, -rear, rear])
    load = np.stack([np.zeros(4), state[R] * by_lateral, state[U] * by_lateral])
    along_by = forces.along_by_angle * angle + forces.along_by_load * load
    left_by = forces.left_by_angle * angle + forces.left_by_load * load
    cos, sin = road_wheel_cos_sin(inputs)
    ahead, side = along_by * cos - left_by * sin, along_by * sin + left_by * cos
    moment = (side * car.forward_m - ahead * car.left_m).sum(axis=-1)
    return side.sum(axis=-1) / car.mass_kg, moment / car.yaw_inertia_kgm2


def rates_jacobian(car: CarDynamics, state: FloatArray, inputs: StepInputs) -> FloatArray:
    """Return the (3, 3) derivative of `model.rates`; rows are the rates, columns the states."""
    lateral, yaw = _force_gradients(car, state, inputs)
    turning = np.array([0.0, state[R], state[U]])
    return np.stack([lateral - turning, np.array([state[R], 0.0, state[V]]), yaw])


def advance_jacobian(
    car: CarDynamics, state: FloatArray, inputs: StepInputs
) -> tuple[FloatArray, FloatArray]:
    """Return the state after the tick (3,), and its derivative by the state before (3, 3)."""
    count, step = substeps(state, inputs)
    whole = np.eye(3)
    for _ in range(count):
        half = state + step / 2 * rates(car, state, inputs)
        to_half = np.eye(3) + step / 2 * rates_jacobian(car, state, inputs)
        whole = (np.eye(3) + step * rates_jacobian(car, half, inputs) @ to_half) @ whole
        state = state + step * rates(car, half, inputs)
    return state, whole


def measurement_jacobian(car: CarDynamics, state: FloatArray, inputs: StepInputs) -> FloatArray:
    """Return the (3, 3) derivative of `model.measurements`; rows are the readings, columns the states."""
    lateral, _ = _force_gradients(car, state, inputs)
    out = np.zeros((3, 3))
    out[0] = (1.0 + GRAVITY_MPS2 * car.roll_rad_per_mps2) * lateral
    out[1, R] = out[2, U] = 1.0
    return out
