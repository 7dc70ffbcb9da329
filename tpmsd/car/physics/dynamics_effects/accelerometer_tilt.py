"""The accelerometers are turned in their mount."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import INSTRUMENT, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class DynamicsAccelerometerTilt(DynamicsEffect):
    """a_y reads a_y - yaw_rad * a_x + g * sin(roll_rad), a_x reads a_x + yaw_rad * a_y + g * sin(pitch_rad).

    Pitch (nose up) and roll (left side up) read as a bias does, and no drive of one car tells them from it.
    Source: rotation of a vector; tolerances of brackets and floors, 1 to 3 degrees.
    """

    name = "accelerometer_tilt"
    kind = INSTRUMENT
    wording = Wording(
        formula="(a_x + yaw_rad * a_y + g * sin(pitch_rad), a_y - yaw_rad * a_x + g * sin(roll_rad)) is read",
        sentence="the accelerometers are turned in their mount",
        distinguished_by="brake firmly on a straight ten times",
    )
    channel = "accel_lat"
    covariate = "accel_long"
    separable = True
    shows_in = MappingProxyType({"pitch_rad": "accel_long", "roll_rad": "accel_lat"})
    confounded_with = ("yaw_moment", "accelerometer_bias")
    parameters = (
        Parameter(
            "yaw_rad",
            "rad",
            0.06,
            -0.8,
            0.8,
            "turn about the vertical, to the left",
            probe=0.0001,
            prior=Prior(0.0, 0.03, "1 to 3 degrees: brackets"),
        ),
        *(
            Parameter(
                name, "rad", 0.03, -0.8, 0.8, what, probe=0.0001, prior=Prior(0.0, 0.03, "1 to 3 degrees")
            )
            for name, what in (("pitch_rad", "nose up"), ("roll_rad", "left side up"))
        ),
    )
    yaw_rad: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0

    def read(self, frame: Frame) -> None:
        """Mix the axes and add what gravity reads; an a_x that is an input was read by the turned
        instrument."""
        out = frame.outputs
        across = out["accel_lat"]
        along = out.get("accel_long", frame.accel_long - self.yaw_rad * across)
        out["accel_lat"] = across - self.yaw_rad * along + GRAVITY_MPS2 * np.sin(self.roll_rad)
        if "accel_long" in out:
            gravity = GRAVITY_MPS2 * np.sin(self.pitch_rad)
            out["accel_long"] = out["accel_long"] + self.yaw_rad * across + gravity
