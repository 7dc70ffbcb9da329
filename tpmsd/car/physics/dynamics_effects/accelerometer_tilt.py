"""The accelerometers are turned about the vertical in their mount."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import INSTRUMENT, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class DynamicsAccelerometerTilt(DynamicsEffect):
    """a_y reads a_y - yaw_rad * a_x, a_x reads a_x + yaw_rad * a_y; pitch and roll of the mount read as a
    bias.

    Source: rotation of a vector; tolerances of brackets and floors, 1 to 3 degrees.
    """

    name = "accelerometer_tilt"
    kind = INSTRUMENT
    wording = Wording(
        formula="a_y read = a_y - yaw_rad * a_x",
        sentence="the accelerometers are turned in their mount",
        distinguished_by="brake firmly on a straight ten times",
    )
    channel = "accel_lat"
    covariate = "accel_long"
    confounded_with = ("yaw_moment",)
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
    )
    yaw_rad: float = 0.0

    def read(self, frame: Frame) -> None:
        """Mix the axes; an a_x that is an input was read by the turned instrument."""
        out = frame.outputs
        across = out["accel_lat"]
        along = out.get("accel_long", frame.accel_long - self.yaw_rad * across)
        out["accel_lat"] = across - self.yaw_rad * along
        if "accel_long" in out:
            out["accel_long"] = out["accel_long"] + self.yaw_rad * across
