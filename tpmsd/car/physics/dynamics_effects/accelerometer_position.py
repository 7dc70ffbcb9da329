"""The accelerometer is not at the centre of gravity."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import INSTRUMENT, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class AccelerometerPosition(DynamicsEffect):
    """a_y reads a_y + forward_m * dr/dt, a_x reads a_x - forward_m * r^2.

    Source: kinematics of a rigid body; sensors sit 0 to 1 m from the centre of gravity.
    """

    name = "accelerometer_position"
    kind = INSTRUMENT
    wording = Wording(
        formula="a_y read = a_y + forward_m * dr/dt",
        sentence="the accelerometer sits ahead of or behind the centre of gravity",
        distinguished_by="change lanes quickly at 20 m/s",
    )
    channel = "accel_lat"
    covariate = "steering_rate"
    confounded_with = ("roll_dynamics",)
    parameters = (
        Parameter(
            "forward_m",
            "m",
            0.5,
            -4.0,
            4.0,
            "sensor ahead of the centre of gravity",
            probe=0.001,
            prior=Prior(0.0, 0.4, "0 to 1 m: installations"),
        ),
    )
    forward_m: float = 0.0

    def read(self, frame: Frame) -> None:
        """Add forward_m * dr/dt to the lateral reading, -forward_m * r^2 to the longitudinal one."""
        out = frame.outputs
        out["accel_lat"] = out["accel_lat"] + self.forward_m * frame.rates["r"]
        if "accel_long" in out:
            out["accel_long"] = out["accel_long"] - self.forward_m * frame.r**2
