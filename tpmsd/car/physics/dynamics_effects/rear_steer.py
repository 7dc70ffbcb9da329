"""The rear wheels are steered with the front ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class RearSteer(DynamicsEffect):
    """The rear wheels turn by c * delta, delta the angle of the front wheels; c > 0 to the same side.

    Source: four-wheel steering turns the rear wheels to the same side at speed and to the other one at
    walking pace, by a small part of the front angle up to a half of it ([Gillespie 1992], ch. 8).
    """

    name = "rear_steer"
    kind = PHYSICS
    wording = Wording(
        formula="rear slip angle = geometric + c * delta",
        sentence="the rear wheels are steered with the front ones",
        distinguished_by="hold the same lateral acceleration at 8 and at 25 m/s, and change lanes quickly",
    )
    channel = "velocity_lat"
    covariate = "steering"
    twins = ("cornering_stiffness_error", "steering_ratio_error", "roll_steer")
    parameters = (
        Parameter(
            "coefficient",
            "1",
            0.1,
            -0.6,
            0.6,
            "c, angle of the rear wheels over that of the front ones",
            probe=1e-4,
            prior=Prior(0.0, 0.1, "a small part to a half: Gillespie, ch. 8"),
        ),
    )
    coefficient: float = 0.0

    def adapt_angles(self, frame: Frame) -> None:
        """Turn the rear wheels."""
        turn = self.coefficient * frame.steer
        still = np.zeros_like(turn)
        turned = (still, turn) if frame.axles else (still, still, turn, turn)
        frame.angle = frame.angle + np.stack(np.broadcast_arrays(*turned))
