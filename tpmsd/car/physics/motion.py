"""Motion of the car, and the car itself: the arguments of every effect of the catalogue.

In: profiles of speed, yaw rate and grade over time. Out: `Motion` (arrays over time) and `Car` (constants).
Frames and signs are ISO 8855: x forward, y left, z up; yaw rate and lateral acceleration positive in a left
turn.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.foundation.wheels import IS_FRONT, FloatArray

GRAVITY_MPS2 = 9.80665


@dataclass(frozen=True)
class Motion:
    """Motion of the middle of the rear axle; all arrays have shape (n,)."""

    time_s: FloatArray
    """Since the drive's start, increasing."""
    distance_m: FloatArray
    """Rolled along the road surface since the drive's start."""
    speed_mps: FloatArray
    """Along the body's x axis, along the road surface."""
    accel_long_mps2: FloatArray
    """Kinematic: the derivative of speed_mps, without gravity."""
    accel_lat_mps2: FloatArray
    """Centripetal: speed times yaw rate."""
    yaw_rate_radps: FloatArray
    grade_rad: FloatArray
    """Slope angle, positive uphill."""
    heading_rad: FloatArray
    """Heading of the body, counter-clockwise from east, unwrapped."""
    steering_rad: FloatArray
    """Mean angle of the road wheels, positive to the left."""
    measured: Mapping[str, FloatArray] = field(default_factory=dict)
    """(n,) each: what other instruments read, by the names of `tpmsd.car.physics.covariates`: steering,
    steering_rate, torque, temperature."""

    def __post_init__(self) -> None:
        shape = self.time_s.shape
        for name, values in self.measured.items():
            if values.shape != shape:
                raise ValueError(f"motion.measured[{name!r}] has shape {values.shape}, time_s has {shape}")
        for name in _ARRAYS:
            if getattr(self, name).shape != shape or len(shape) != 1:
                raise ValueError(f"motion.{name} has shape {getattr(self, name).shape}, time_s has {shape}")

    def __len__(self) -> int:
        return len(self.time_s)

    @cached_property
    def specific_force_long_mps2(self) -> FloatArray:
        """(n,) What an accelerometer reads and the tyres must carry: acceleration plus g*sin(grade)."""
        return np.asarray(self.accel_long_mps2 + GRAVITY_MPS2 * np.sin(self.grade_rad))

    @classmethod
    def from_profiles(
        cls,
        time_s: FloatArray,
        speed_mps: FloatArray,
        yaw_rate_radps: FloatArray,
        *,
        wheelbase_m: float,
        grade_rad: FloatArray | None = None,
        heading_start_rad: float = 0.0,
    ) -> Motion:
        """Derive accelerations, heading, distance and steering from speed, yaw rate and grade, each (n,).

        The steering is that of a car that does not slip sideways: tan(steering) = wheelbase * yaw rate /
        speed.
        """
        if len(time_s) < 2 or not bool(np.all(np.diff(time_s) > 0)):
            raise ValueError("time_s must have at least two entries and increase")
        curvature = np.divide(
            yaw_rate_radps, speed_mps, out=np.zeros_like(speed_mps), where=np.abs(speed_mps) > 0.05
        )
        return cls(
            time_s=time_s,
            distance_m=integrate(speed_mps, time_s),
            speed_mps=speed_mps,
            accel_long_mps2=np.gradient(speed_mps, time_s),
            accel_lat_mps2=speed_mps * yaw_rate_radps,
            yaw_rate_radps=yaw_rate_radps,
            grade_rad=np.zeros_like(time_s) if grade_rad is None else grade_rad,
            heading_rad=heading_start_rad + integrate(yaw_rate_radps, time_s),
            steering_rad=np.arctan(wheelbase_m * curvature),
        )


_ARRAYS = (
    "time_s",
    "distance_m",
    "speed_mps",
    "accel_long_mps2",
    "accel_lat_mps2",
    "yaw_rate_radps",
    "grade_rad",
    "heading_rad",
    "steering_rad",
)


@dataclass(frozen=True)
class Car:
    """Car as configured; effects say how far the truth is from it."""

    radius_m: FloatArray
    """(4,) nominal effective rolling radius."""
    geometry: WheelPositions
    driven: NDArray[np.bool_]
    """(4,) which wheels the engine drives."""
    teeth_per_rev: float = 48.0
    antenna_forward_m: float = 0.0
    antenna_left_m: float = 0.0
    steering_ratio: float = 15.0
    """Angle of the steering wheel per angle of the road wheels; a common one where it is not configured."""

    def with_tracks(self, front_m: float, rear_m: float) -> WheelPositions:
        """Return the geometry with the tracks changed by these amounts."""
        return replace(
            self.geometry,
            track_front_m=self.geometry.track_front_m + front_m,
            track_rear_m=self.geometry.track_rear_m + rear_m,
        )


def driven_mask(driven_axle: str) -> NDArray[np.bool_]:
    """(4,) mask of the driven wheels for `front`, `rear` or `all`."""
    masks = {"front": IS_FRONT, "rear": ~IS_FRONT, "all": np.ones(4, dtype=np.bool_)}
    return masks[driven_axle].copy()


def integrate(rate: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return the cumulative trapezoidal integral over the first axis, 0 at the first time; same shape as
    `rate`."""
    steps = np.diff(time_s).reshape(-1, *([1] * (rate.ndim - 1)))
    out = np.zeros_like(rate)
    np.cumsum(0.5 * steps * (rate[1:] + rate[:-1]), axis=0, out=out[1:])
    return out
