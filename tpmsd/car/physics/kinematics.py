"""Kinematics of the wheels: plane motion of a four-wheeled car.

In: the motion of the middle of the rear axle. Out: each wheel's rolling speed. ISO 8855: x forward, y left,
yaw rate positive in a left turn. [Lundquist 2013], eqs (4)-(6), gives the rear pair; the front pair is
derived here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import FL, FR, RL, RR, FloatArray


@dataclass(frozen=True, slots=True)
class WheelPositions:
    """Tracks and wheelbase of a car, m."""

    track_front_m: float
    track_rear_m: float
    wheelbase_m: float


def wheel_speeds(
    speed_mps: FloatArray | float,
    yaw_rate_radps: FloatArray | float,
    geometry: WheelPositions,
    lateral_speed_mps: FloatArray | float = 0.0,
) -> FloatArray:
    """Return the speed over ground of each wheel along its own rolling direction, shape (..., 4).

    The rear wheels point along the body: v -+ yaw_rate * track / 2 (eq. 6). A steered wheel rolls along the
    path of its own hub, so its speed is the hub's speed, whatever the steering ratio is; the tyre's slip
    angle enters only in second order (its cosine). The sign of a front wheel's speed is that of its
    longitudinal part.

    `lateral_speed_mps` is the rear axle's own, zero where it does not slip sideways.
    """
    v = np.asarray(speed_mps, dtype=np.float64)
    yaw = np.asarray(yaw_rate_radps, dtype=np.float64)
    lateral = np.asarray(lateral_speed_mps, dtype=np.float64)
    out = np.empty((*np.broadcast(v, yaw, lateral).shape, 4))
    out[..., RL] = v - yaw * (geometry.track_rear_m / 2)
    out[..., RR] = v + yaw * (geometry.track_rear_m / 2)
    hub_lateral = lateral + yaw * geometry.wheelbase_m
    for wheel, sign in ((FL, -1.0), (FR, 1.0)):
        longitudinal = v + sign * yaw * (geometry.track_front_m / 2)
        out[..., wheel] = np.copysign(np.hypot(longitudinal, hub_lateral), longitudinal)
    return out


def rear_steer_ratio(speed_mps: FloatArray, crossover_mps: float) -> FloatArray:
    """Return (v^2 - v0^2) / (v^2 + v0^2), by which a system steers the rear wheels: -1 (against the front
    ones) at rest, 0 at the crossover speed v0, 1 at high speed ([Sano 1986])."""
    square, crossover = speed_mps**2, crossover_mps**2
    return np.asarray((square - crossover) / (square + crossover))
