"""Slips as plain functions of measured motion, over whole recordings at once.

In: arrays over time. Out: arrays over time. No filter: lateral forces follow from lateral and yaw
acceleration, the tyre model is turned round to give the angles under which they arise. Made for `diagnose`,
whose explanatory variables they are, and for the gate where the bus has no steering signal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.vehicle_state.car import CarDynamics
from tpmsd.car.vehicle_state.loads import wheel_loads
from tpmsd.car.vehicle_state.settings import SETTINGS
from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True, slots=True)
class SlipTraces:
    """Slips over a recording of n ticks; NaN where an input was."""

    side_slip_rad: FloatArray
    """(n,) course of the rear axle's middle minus the heading: negative in a left turn at speed."""
    front_slip_angle_rad: FloatArray
    """(n,) mean slip angle of the front wheels, positive where their force points left."""
    wheel_slip: FloatArray
    """(n, 4) longitudinal slip of fl, fr, rl, rr: omega r / v - 1, positive when driving."""
    grip_used: FloatArray
    """(n, 4) share of friction * load that each wheel needs."""


def slip_traces(
    car: CarDynamics,
    accel_long_mps2: FloatArray,
    accel_lat_mps2: FloatArray,
    yaw_accel_radps2: FloatArray | None = None,
    steer_rad: FloatArray | None = None,
) -> SlipTraces:
    """Return the slips over a recording, all inputs (n,); those that are None count as zero.

    `accel_lat_mps2` is the lateral acceleration of the car (speed times yaw rate where the bus has none), not
    the reading of a sensor that rolls with the body. ValueError if the lengths differ.
    """
    yaw = np.zeros_like(accel_lat_mps2) if yaw_accel_radps2 is None else yaw_accel_radps2
    steer = np.zeros_like(accel_lat_mps2) if steer_rad is None else steer_rad
    if len({a.shape for a in (accel_long_mps2, accel_lat_mps2, yaw, steer)}) != 1:
        raise ValueError("slip_traces: the inputs differ in length")
    base, inertia = car.wheelbase_m, car.yaw_inertia_kgm2
    front = (car.mass_kg * accel_lat_mps2 * car.rear_m + inertia * yaw) / base
    rear = (car.mass_kg * accel_lat_mps2 * car.front_m - inertia * yaw) / base
    load = wheel_loads(car, accel_long_mps2, accel_lat_mps2)
    front_angle = angle_for_force(front, load[..., :2].sum(axis=-1), 2 * car.cornering_front_n, car.friction)
    rear_angle = angle_for_force(rear, load[..., 2:].sum(axis=-1), 2 * car.cornering_rear_n, car.friction)
    slips = wheel_slips(car, accel_long_mps2, accel_lat_mps2, -rear_angle, front_angle, steer)
    angles = np.stack([front_angle, front_angle, rear_angle, rear_angle], axis=-1)
    forces = car.tyres.forces(slips, angles, load)
    limit = np.maximum(car.friction * load, 1.0)
    used = np.hypot(forces.along_n, forces.left_n) / limit
    return SlipTraces(-rear_angle, front_angle, slips, used)


def angle_for_force(
    force_n: FloatArray, load_n: FloatArray, cornering_n: float, friction: float
) -> FloatArray:
    """Return the slip angle (rad) at which a tyre without longitudinal slip has this side force; same shape.

    Inverse of Dugoff's law: linear up to half the limit L = friction * load, then
    |F| = L (1 - L / (4 C tan alpha)). Forces beyond `max_use` of the limit give that one's angle.
    """
    limit = np.maximum(friction * load_n, 1.0)
    size = np.minimum(np.abs(force_n), SETTINGS.max_use * limit)
    gripping = size / cornering_n
    sliding = limit**2 / (4.0 * cornering_n * np.maximum(limit - size, 1e-9))
    tangent = np.where(size <= limit / 2.0, gripping, sliding)
    return np.asarray(np.copysign(np.arctan(tangent), force_n) + 0.0 * force_n)


def wheel_slips(
    car: CarDynamics,
    accel_long_mps2: FloatArray,
    accel_lat_mps2: FloatArray,
    side_slip_rad: FloatArray,
    front_angle_rad: FloatArray,
    steer_rad: FloatArray,
) -> FloatArray:
    """Return the (..., 4) longitudinal slip of wheels that carry the measured acceleration; inputs (...).

    The forces carry m a_x and, with steered wheels, the part of the front side force that points backwards: a
    bend at constant speed is driven with slip. In a sliding tyre the same force needs more of it.
    """
    steer = np.asarray(steer_rad)
    front = car.mass_kg * accel_lat_mps2 * car.rear_m / car.wheelbase_m
    force = car.mass_kg * np.asarray(accel_long_mps2) + front * np.sin(steer)
    ahead = np.where(force > 0.0, car.drive_front_share, car.brake_front_share)
    share = np.stack([ahead, ahead, 1.0 - ahead, 1.0 - ahead], axis=-1) / 2
    wanted = force[..., None] * share / car.longitudinal_n
    load = wheel_loads(car, accel_long_mps2, accel_lat_mps2)
    angle = np.stack([front_angle_rad, front_angle_rad, -side_slip_rad, -side_slip_rad], axis=-1)
    slip = _slip_of_force_ratio(wanted)
    for _ in range(4):
        out = car.tyres.forces(slip, angle, load)
        linear = car.longitudinal_n * slip / (1.0 + slip)
        grip = np.where(linear != 0.0, out.along_n / np.where(linear != 0.0, linear, 1.0), 1.0)
        better = _slip_of_force_ratio(wanted / np.maximum(grip, 0.05))
        if np.allclose(better, slip, rtol=1e-3, atol=1e-6, equal_nan=True):
            break  # nothing slides
        slip = better
    return slip


def _slip_of_force_ratio(ratio: FloatArray) -> FloatArray:
    """Return sigma of sigma / (1 + sigma) = F_x / C_sigma, limited to `max_slip` in size."""
    held = np.clip(ratio, -SETTINGS.max_slip, SETTINGS.max_slip)
    return np.asarray(np.clip(held / (1.0 - held), -SETTINGS.max_slip, SETTINGS.max_slip))
