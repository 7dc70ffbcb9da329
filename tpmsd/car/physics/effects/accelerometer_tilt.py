"""The accelerometers are turned in their mount."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Identification, Wording
from tpmsd.car.physics.motion import GRAVITY_MPS2, Car, Motion
from tpmsd.foundation.wheels import FloatArray

TOLERANCE_RAD = 0.04
"""Up to which a turn in the mount is usual: two degrees."""


@dataclass(frozen=True)
class AccelerometerTilt(Effect):
    """Sensors turned by yaw_rad (to the left) read a_x + yaw * a_y forward and a_y - yaw * a_x to the left;
    pitched by pitch_rad (nose up) they read g * sin(pitch) more forward, rolled by roll_rad (left side up)
    g * sin(roll) more to the left.

    Pitch and roll read as a constant and are reported as such; the turn about the vertical is identified by
    what braking puts to the side, and bends forward. Source: rotation of a vector; tolerances of a bracket
    and of a body's floor, 1 to 3 degrees.
    """

    name = "accelerometer_tilt"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="(a_x + yaw_rad * a_y + g * sin(pitch_rad), a_y - yaw_rad * a_x + g * sin(roll_rad)) is read",
        sentence="the accelerometers are turned in their mount",
        noun="a turned accelerometer",
        answers=(
            "the accelerometers are turned by {yaw_rad:size deg} to the {yaw_rad:left|right} in their mount",
            "they are pitched by {pitch_rad:size deg} {pitch_rad:nose up|nose down}",
            "they are rolled by {roll_rad:size deg} to the {roll_rad:right|left}",
        ),
        distinguished_by="brake firmly on a straight and take bends at a constant speed, ten times each",
    )
    identification = Identification(shows_in=("accel_lat", "accel_long"), reads=("accel_long", "accel_lat"))
    stays = "no estimate depends on the accelerometers' mount"
    parameters = (
        Parameter(
            "yaw_rad",
            "rad",
            0.08,
            -0.8,
            0.8,
            "turn about the vertical, to the left",
            probe=0.01,
            prior=Prior(0.0, 0.03, "1 to 3 degrees: brackets"),
        ),
        Parameter("pitch_rad", "rad", 0.03, -0.8, 0.8, "nose up", prior=Prior(0.0, 0.03, "1 to 3 degrees")),
        Parameter(
            "roll_rad", "rad", 0.03, -0.8, 0.8, "left side up", prior=Prior(0.0, 0.03, "1 to 3 degrees")
        ),
    )
    yaw_rad: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0

    @classmethod
    def tolerance_note(cls, value: float, std: float, speeds: bool) -> str:
        """Return the note on a tilt within that of usual brackets; empty for a larger one."""
        if abs(value) - 2.0 * std > TOLERANCE_RAD:
            return ""
        return f"the accelerometers are turned by {value:.3f} +- {std:.3f} rad, as brackets are"

    def accel_error_mps2(self, motion: Motion, car: Car) -> FloatArray:
        """Return the (n, 2) errors (forward, left) by the other axis and by gravity, m/s2."""
        along, across = motion.specific_force_long_mps2, motion.accel_lat_mps2
        return np.stack(
            [
                self.yaw_rad * across + GRAVITY_MPS2 * math.sin(self.pitch_rad),
                -self.yaw_rad * along + GRAVITY_MPS2 * math.sin(self.roll_rad),
            ],
            axis=1,
        )
