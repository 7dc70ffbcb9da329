"""The 3-DOF car: how lateral speed, longitudinal speed and yaw rate change, and what the sensors read.

In: states (..., 3) of any leading shape (particles, sigma points), and the tick's inputs. Out: arrays of the
same leading shape. Liu et al. (2022), eqs (1)-(12), each sign taken from a free-body drawing: hub i lies x_i
ahead and y_i to the left of the centre of gravity and moves with (u - r y_i, v + r x_i).

State: (v, u, r), lateral and longitudinal speed of the centre of gravity and yaw rate. Inputs: longitudinal
acceleration and angle of the road wheels. Readings: lateral acceleration, yaw rate and, where wheels tell
it, the speed u.

What the paper leaves open:

- The wheels' longitudinal slip is that which carries m * a_x, shared among the axles as drive and brakes
  share it. Slip from wheel speeds would need radii that are known to 0.1 %; they are what is sought here.
- Wheel loads follow from a_x and the steady a_y = u r; with a_y itself there would be a loop, for a_y comes
  from the loads.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.car.vehicle_state.car import CarDynamics
from tpmsd.car.vehicle_state.loads import wheel_loads
from tpmsd.car.vehicle_state.tyre import TyreForces
from tpmsd.foundation.wheels import FloatArray

V, U, R = range(3)
"""Places in the state: m/s, m/s, rad/s."""
MIN_SPEED_MPS = 2.0
"""Slip angles are those of at least this speed: slower, their geometry is singular and the tyres are stiff
springs."""
MIN_STEP_S, MAX_STEP_S = 0.02, 0.05
STEP_S_PER_MPS = 0.01
"""Steps of the integration grow with speed, as the lateral motion's time constant does (0.02 s at 2 m/s)."""
_MAX_FORCE_SHARE = 0.3


@dataclass(frozen=True, slots=True)
class StepInputs:
    """Inputs of the model over one step."""

    dt_s: float
    accel_long_mps2: float
    steer_rad: float
    """Angle of the road wheels, left positive."""


@dataclass(frozen=True, slots=True)
class Wheels:
    """Motion and forces at the wheels; arrays (..., 4)."""

    slip: FloatArray
    """Longitudinal, sigma: (omega r - v) / v, positive when driving."""
    slip_angle_rad: FloatArray
    load_n: FloatArray
    forces: TyreForces
    hub_along_mps: FloatArray
    """Speed of the hub along the body's x axis."""
    hub_left_mps: FloatArray


def carried_slip(car: CarDynamics, accel_long_mps2: FloatArray | float) -> FloatArray:
    """Return the (..., 4) longitudinal slip of wheels that carry m * a_x: sigma / (1 + sigma) = F_x /
    C_sigma."""
    accel = np.asarray(accel_long_mps2, dtype=np.float64)
    front = np.where(accel > 0.0, car.drive_front_share, car.brake_front_share)
    share = np.stack([front, front, 1.0 - front, 1.0 - front], axis=-1) / 2
    force = car.mass_kg * accel[..., None] * share / car.longitudinal_n
    force = np.clip(force, -_MAX_FORCE_SHARE, _MAX_FORCE_SHARE)
    return np.asarray(force / (1.0 - force))


def wheel_states(car: CarDynamics, state: FloatArray, inputs: StepInputs) -> Wheels:
    """Return slips, loads, forces and hub speeds of the four wheels, (..., 4), in the states (..., 3)."""
    v, u, r = state[..., V, None], state[..., U, None], state[..., R, None]
    along = u - r * car.left_m
    left = v + r * car.forward_m
    steer = inputs.steer_rad * _STEERED
    angle = steer - np.arctan2(left, np.maximum(along, MIN_SPEED_MPS))
    load = wheel_loads(car, np.asarray(inputs.accel_long_mps2), state[..., U] * state[..., R])
    slip = carried_slip(car, inputs.accel_long_mps2)
    forces = car.tyres.forces(slip, angle, load)
    return Wheels(np.broadcast_to(slip, load.shape), angle, load, forces, along, left)


_STEERED = np.array([1.0, 1.0, 0.0, 0.0])


def lateral_and_yaw_accel(
    car: CarDynamics, state: FloatArray, inputs: StepInputs
) -> tuple[FloatArray, FloatArray]:
    """Return (...,) lateral acceleration, eq. (5), and yaw acceleration, eqs (1) and (3), by the tyres'
    forces."""
    forces = wheel_states(car, state, inputs).forces
    cos, sin = road_wheel_cos_sin(inputs)
    ahead = forces.along_n * cos - forces.left_n * sin
    side = forces.along_n * sin + forces.left_n * cos
    moment = (side * car.forward_m - ahead * car.left_m).sum(axis=-1)
    return side.sum(axis=-1) / car.mass_kg, moment / car.yaw_inertia_kgm2


def road_wheel_cos_sin(inputs: StepInputs) -> tuple[FloatArray, FloatArray]:
    """Return (4,) cosine and sine of each wheel's steering angle; that of the rear wheels is zero."""
    return np.cos(inputs.steer_rad * _STEERED), np.sin(inputs.steer_rad * _STEERED)


def rates(car: CarDynamics, state: FloatArray, inputs: StepInputs) -> FloatArray:
    """Return the (..., 3) time derivative of the state, eq. (1)."""
    lateral, yaw = lateral_and_yaw_accel(car, state, inputs)
    v, u, r = state[..., V], state[..., U], state[..., R]
    return np.stack([lateral - u * r, inputs.accel_long_mps2 + v * r, yaw], axis=-1)


def advance(car: CarDynamics, state: FloatArray, inputs: StepInputs) -> FloatArray:
    """Return the (..., 3) state at the end of the tick, by the midpoint rule in `substeps`."""
    count, step = substeps(state, inputs)
    for _ in range(count):
        half = state + step / 2 * rates(car, state, inputs)
        state = state + step * rates(car, half, inputs)
    return state


def substeps(state: FloatArray, inputs: StepInputs) -> tuple[int, float]:
    """Return number and length (s) of a tick's integration steps, shorter at low speed, where the dynamics
    are stiffest."""
    lowest_mps = float(np.min(state[..., U]))
    longest = min(max(STEP_S_PER_MPS * lowest_mps, MIN_STEP_S), MAX_STEP_S)
    count = max(int(np.ceil(inputs.dt_s / longest - 1e-9)), 1)
    return count, inputs.dt_s / count


def measurements(car: CarDynamics, state: FloatArray, inputs: StepInputs) -> FloatArray:
    """Return the (..., 3) expected readings: lateral acceleration (with the body's roll), yaw rate, speed."""
    lateral, _ = lateral_and_yaw_accel(car, state, inputs)
    gain = 1.0 + GRAVITY_MPS2 * car.roll_rad_per_mps2
    return np.stack([gain * lateral, state[..., R], state[..., U]], axis=-1)
