"""The centre of gravity lies higher or lower."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class CgHeightError(DynamicsEffect):
    """h = configured + height_m; it acts by load transfer alone.

    Source: roof loads and tall bodies move it by a tenth of a metre ([Heydinger 1999]).
    """

    name = "cg_height_error"
    kind = PHYSICS
    wording = Wording(
        formula="h = configured + height_m",
        sentence="the height of the centre of gravity is not the configured one",
        distinguished_by="brake and accelerate hard in bends near the limit",
    )
    channel = "accel_lat"
    covariate = "accel_lat"
    confounded_with = ("tyre_saturation", "load_dependent_stiffness")
    parameters = (
        Parameter(
            "height_m",
            "m",
            0.1,
            -0.5,
            1.5,
            "true minus configured",
            probe=0.001,
            prior=Prior(0.0, 0.08, "a tenth of a metre: NHTSA"),
        ),
    )
    height_m: float = 0.0

    def adapt_car(self, frame: Frame) -> None:
        """Raise the centre of gravity by height_m."""
        frame.height = frame.height + self.height_m
