"""The steering's ratio changes with its angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class VariableSteeringRatio(DynamicsEffect):
    """Road-wheel angle = d * (1 + c * abs(d)), d the angle by the configured ratio.

    Source: racks that turn the wheels by 15 to 30 % more at 90 degrees of the steering wheel, a road-wheel
    angle of 0.1 rad, than about the centre ([Pfeffer 2017]).
    """

    name = "variable_steering_ratio"
    kind = PHYSICS
    formula = "delta = reading / ratio * (1 + c * abs(reading / ratio))"
    sentence = "the steering's ratio changes with its angle"
    distinguished_by = "drive slow circles of several radii, to both sides"
    channel = "yaw_rate"
    covariate = "steering"
    twins = ("steering_ratio_error",)
    parameters = (
        Parameter(
            "coefficient",
            "1/rad",
            2.0,
            -10.0,
            10.0,
            "c, relative gain of angle per angle of the road wheels",
            probe=0.001,
            prior=Prior(0.0, 2.0, "15 to 30 % at 0.1 rad: Pfeffer 2017"),
        ),
    )
    coefficient: float = 0.0

    def adapt_inputs(self, frame: Frame) -> None:
        """Enlarge the angle."""
        frame.steer = frame.steer * (1.0 + self.coefficient * np.abs(frame.steer))
