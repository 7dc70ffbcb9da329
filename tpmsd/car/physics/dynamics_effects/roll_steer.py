"""The rear wheels steer as the body rolls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class RollSteer(DynamicsEffect):
    """The rear wheels turn by c * a_y into the bend, a_y = u r.

    Source: roll steer of 0.02 to 0.15 rad/rad times a roll of 3 to 7 degrees per g: 1e-4 to 2e-3 rad per m/s2
    ([Gillespie 1992], ch. 6).
    """

    name = "roll_steer"
    kind = PHYSICS
    wording = Wording(
        formula="rear slip angle = geometric + c * u * r",
        sentence="the rear axle steers as the body rolls",
        distinguished_by="hold steady bends from 1 to 6 m/s2 at two speeds",
    )
    channel = "velocity_lat"
    covariate = "accel_lat"
    confounded_with = ("cornering_stiffness_error", "compliance_steer")
    parameters = (
        Parameter(
            "coefficient",
            "rad.s2/m",
            0.0015,
            -0.02,
            0.02,
            "c, angle of the rear wheels per lateral acceleration",
            probe=1e-05,
            prior=Prior(0.0, 0.001, "1e-4 to 2e-3: Gillespie, ch. 6"),
        ),
    )
    coefficient: float = 0.0

    def adapt_angles(self, frame: Frame) -> None:
        """Turn the rear wheels."""
        turn = np.asarray(self.coefficient * frame.across)
        still = np.zeros_like(turn)
        turned = (still, turn) if frame.axles else (still, still, turn, turn)
        frame.angle = frame.angle + np.stack(np.broadcast_arrays(*turned))
