"""The accelerometer rolls with the body."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import INSTRUMENT, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class AccelerometerRoll(DynamicsEffect):
    """a_y reads a_y * (1 + coefficient): a body that rolls outwards by phi adds g * phi, coefficient = g *
    phi / a_y.

    A scale error of the sensor reads the same. Source: roll of 2 to 7 degrees per g ([Gillespie 1992], ch.
    6): 0.035 to 0.12.
    """

    name = "accelerometer_roll"
    kind = INSTRUMENT
    wording = Wording(
        formula="a_y read = a_y * (1 + coefficient)",
        sentence="the accelerometer rolls with the body",
        distinguished_by="hold steady bends from 1 to 6 m/s2 on a level road",
    )
    channel = "accel_lat"
    covariate = "accel_lat"
    confounded_with = ("mass_error",)
    parameters = (
        Parameter(
            "coefficient",
            "1",
            0.06,
            -0.4,
            0.5,
            "g times roll per lateral acceleration",
            probe=0.0001,
            prior=Prior(0.0, 0.05, "2 to 7 degrees per g: Gillespie, ch. 6"),
        ),
    )
    coefficient: float = 0.0

    def read(self, frame: Frame) -> None:
        """Scale the lateral accelerometer's reading by 1 + coefficient."""
        frame.outputs["accel_lat"] = frame.outputs["accel_lat"] * (1.0 + self.coefficient)
