"""The wheels of the driven axle turn alike in bends, by a share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.kinematics import wheel_speeds
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import IS_FRONT, WHEELS, FloatArray

MIN_MPS = 0.5
"""Speed of a hub below which its slip is that at this speed."""


@dataclass(frozen=True)
class LockedDifferential(Effect):
    """omega * r = v_i + c * (v_axle - v_i) on driven wheels, v_i the speed of a hub, v_axle the mean of its
    axle's two: c = 0 is an open differential, c = 1 an axle whose wheels turn alike.

    In a bend the inner driven wheel turns faster than it rolls and the outer one slower. It reads like a
    track that is narrower by c: what a track error may be, 0.25 m or c = 0.15, goes by that name.
    Source: kinematics of an axle; limited-slip differentials lock by a quarter to three quarters, viscous
    couplings by a tenth to a half (Milliken, Race Car Vehicle Dynamics, 1995, chapter 20).
    """

    name = "locked_differential"
    wording = Wording(
        formula="omega * r = v_i + c * (v_axle - v_i) on driven wheels, v_axle the mean of the axle",
        sentence="the wheels of the driven axle turn alike in bends",
        noun="a locked differential",
        answers=("the wheels of the driven axle turn alike in bends, by {coefficient:just %}",),
        distinguished_by="drive full circles slowly, to both sides: load transfer is small there",
    )
    identification = Identification(shows_in=("wheel_ratio", "yaw_rate"), contrast=True)
    confounding = Confounding(rare=True, limit="track_width_error")
    one_sign = True
    parameters = (
        Parameter(
            "coefficient",
            "1",
            0.4,
            -0.5,
            2.0,
            "c, 1 is a locked axle",
            probe=1e-3,
            prior=Prior(0.0, 0.3, "a quarter to three quarters: makers"),
            fitted=(0.0, 1.2),
        ),
    )
    coefficient: float

    @classmethod
    def acting_wheels(cls, car: Car, fitted: tuple[str, ...]) -> tuple[str, ...]:
        """Return the driven wheels."""
        return tuple(wheel for wheel, drives in zip(WHEELS, car.driven, strict=True) if drives)

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """Return (n, 4) c * (v_axle - v_i) / v_i on the driven wheels."""
        hubs = wheel_speeds(motion.speed_mps, motion.yaw_rate_radps, car.geometry)
        front, rear = hubs[:, IS_FRONT].mean(axis=1), hubs[:, ~IS_FRONT].mean(axis=1)
        axle = np.where(IS_FRONT, front[:, None], rear[:, None])
        size = np.copysign(np.maximum(np.abs(hubs), MIN_MPS), hubs)
        return np.asarray(self.coefficient * (axle - hubs) / size * car.driven)
