"""Tyres resist rolling."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class RollingResistance(DynamicsEffect):
    """F_x = -c * load, summed over the wheels; `wheel_resistance` says where it acts.

    Source: c of 0.007 to 0.015 for passenger tyres on asphalt (ISO 28580 classes; [Gillespie 1992], ch. 4).
    """

    name = "rolling_resistance"
    kind = PHYSICS
    wording = Wording(
        formula="F_x = -c * m * g",
        sentence="the tyres resist rolling",
        distinguished_by="coast in neutral from 20 m/s to 5 m/s, both ways",
    )
    channel = "speed"
    covariate = "time"
    confounded_with = ("road_grade", "accelerometer_bias")
    needs_forces = True
    positive = True
    parameters = (
        Parameter(
            "coefficient",
            "1",
            0.012,
            -0.05,
            0.1,
            "c, force per load",
            probe=0.0001,
            prior=Prior(0.0, 0.012, "0.007 to 0.015: ISO 28580"),
        ),
    )
    coefficient: float = 0.0

    def adapt_car(self, frame: Frame) -> None:
        """Add c to the car's rolling resistance."""
        frame.rolling_resistance = frame.rolling_resistance + self.coefficient
