"""The rear wheels steer with the front ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class RearSteering(DynamicsEffect):
    """Rear road-wheel angle = c * front road-wheel angle; positive: to the same side.

    Source: rear angles of 1 to 5 degrees beside front ones of 30, against them at low speed and with them at
    high speed ([Furukawa 1989]).
    """

    name = "rear_steering"
    kind = PHYSICS
    formula = "rear slip angle = geometric + c * delta"
    sentence = "the rear wheels steer with the front ones"
    distinguished_by = "drive full circles slowly, to both sides, and change lanes at two speeds"
    channel = "velocity_lat"
    covariate = "steering"
    twins = ("locked_differential", "cg_position_error")
    parameters = (
        Parameter(
            "coefficient",
            "1",
            0.06,
            -0.5,
            0.5,
            "c, rear angle per front angle",
            probe=0.0001,
            prior=Prior(0.0, 0.05, "1 to 5 degrees beside 30: Furukawa 1989"),
        ),
    )
    coefficient: float = 0.0

    def adapt_angles(self, frame: Frame) -> None:
        """Turn the rear wheels."""
        turn = self.coefficient * frame.steer
        still = np.zeros_like(turn)
        turned = (still, turn) if frame.axles else (still, still, turn, turn)
        frame.angle = frame.angle + np.stack(np.broadcast_arrays(*turned))
