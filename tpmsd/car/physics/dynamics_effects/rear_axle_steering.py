"""The rear wheels are steered with the front ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.dynamics_parameters import DIRECTED, directions
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.kinematics import rear_steer_ratio
from tpmsd.car.physics.parameters import Parameter, Prior

CROSSOVER_MPS = 16.0
"""Speed at which the part by speed changes sign: 50 to 60 km/h ([Sano 1986])."""


@dataclass(frozen=True)
class DynamicsRearAxleSteering(DynamicsEffect):
    """The rear wheels turn by k * delta, delta the angle of the front wheels; k > 0 to the same side.

    k = coefficient + by_speed * (u^2 - v0^2) / (u^2 + v0^2), v0 = 16 m/s: a linkage has the first, a system
    that turns against the front wheels at walking pace and with them at speed the second. Source: the steer
    ratio of no side slip ([Sano 1986]); rear wheels turn by a tenth to a quarter of the front ones.
    """

    name = "rear_axle_steering"
    kind = PHYSICS
    reads_loads = False
    wording = Wording(
        formula="rear slip angle = geometric + k * delta,"
        " k = coefficient + by_speed * (u^2 - v0^2) / (u^2 + v0^2), v0 = 16 m/s",
        sentence="the rear wheels are steered with the front ones",
        distinguished_by="hold the same lateral acceleration at 8 and at 25 m/s, and change lanes quickly",
    )
    channel = "velocity_lat"
    covariate = "steering"
    separable = True
    confounded_with = ("cornering_stiffness_error", "steering_ratio_error", "roll_steer")
    parameters = (
        Parameter(
            "coefficient",
            "1",
            0.1,
            -0.6,
            0.6,
            "angle of the rear wheels over that of the front ones, at all speeds",
            probe=1e-4,
            prior=Prior(0.0, 0.1, "a tenth to a quarter: Sano, SAE 860625"),
        ),
        Parameter(
            "by_speed",
            "1",
            0.1,
            -0.6,
            0.6,
            "the same at high speed, its opposite at walking pace",
            probe=1e-4,
            prior=Prior(0.0, 0.1, "a tenth to a quarter: Sano, SAE 860625"),
        ),
        DIRECTED,
    )
    coefficient: float = 0.0
    by_speed: float = 0.0
    directed: float = 1.0

    @classmethod
    def variants(cls, nonlinear: bool) -> tuple[Mapping[str, float], ...]:
        """Return the values of `directed` to try."""
        return directions(nonlinear)

    def adapt_angles(self, frame: Frame) -> None:
        """Turn the rear wheels by a ratio, which depends on speed, times the front wheels' steer angle."""
        speed = np.asarray(frame.u)
        ratio = self.coefficient + self.by_speed * rear_steer_ratio(speed, CROSSOVER_MPS)
        frame.turn(0.0, ratio * frame.steer, self.directed)
