"""Motions with closed forms, for the tests of this package."""

from __future__ import annotations

import numpy as np

from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.car.physics.motion import Car, Motion, driven_mask
from tpmsd.foundation.wheels import FloatArray

GEOMETRY = WheelPositions(track_front_m=1.53, track_rear_m=1.52, wheelbase_m=2.63)


def car(driven: str = "front", **changes: float) -> Car:
    """A front-driven car with 0.316 m wheels, unless told otherwise."""
    return Car(radius_m=np.full(4, 0.316), geometry=GEOMETRY, driven=driven_mask(driven), **changes)


def steady(
    speed_mps: float = 20.0,
    yaw_rate_radps: float = 0.0,
    duration_s: float = 10.0,
    grade_rad: float = 0.0,
    heading_rad: float = 0.0,
) -> Motion:
    """Constant speed, yaw rate and slope at 100 Hz."""
    time = np.arange(round(100 * duration_s) + 1) / 100.0
    return Motion.from_profiles(
        time,
        np.full_like(time, speed_mps),
        np.full_like(time, yaw_rate_radps),
        wheelbase_m=GEOMETRY.wheelbase_m,
        grade_rad=np.full_like(time, grade_rad),
        heading_start_rad=heading_rad,
    )


def accelerating(accel_mps2: float, start_mps: float = 10.0, duration_s: float = 5.0) -> Motion:
    """Constant acceleration on a level straight."""
    time: FloatArray = np.arange(round(100 * duration_s) + 1) / 100.0
    return Motion.from_profiles(
        time, start_mps + accel_mps2 * time, np.zeros_like(time), wheelbase_m=GEOMETRY.wheelbase_m
    )
