"""The drive force acts on the axles in other shares than configured."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class DriveShareError(DynamicsEffect):
    """front share of the drive force = configured + relative, within 0 and 1.

    A tyre that pulls carries less side force. Source: centre differentials and clutches send 30 to 60 % to
    the front ([Rajamani 2012], ch. 4); a car driven by the axle that is not configured has an error of 1.
    """

    name = "drive_share_error"
    kind = PHYSICS
    wording = Wording(
        formula="front share of the drive force = configured + relative",
        sentence="the drive force acts on the axles in other shares than configured",
        distinguished_by="accelerate firmly in bends, and coast through the same bends",
    )
    channel = "yaw_rate"
    covariate = "accel_long"
    confounded_with = ("tyre_saturation", "yaw_moment")
    parameters = (
        Parameter(
            "relative",
            "1",
            -0.5,
            -1.0,
            1.0,
            "true share of the front axle minus the configured one",
            probe=0.001,
            prior=Prior(0.0, 0.5, "30 to 60 % by centre differentials; 1 where the axle is wrong"),
        ),
    )
    relative: float = 0.0

    @classmethod
    def applies(cls, nonlinear: bool, forces: bool) -> bool:
        """Return True if the tyres' side force depends on the force along it."""
        return nonlinear

    def adapt_car(self, frame: Frame) -> None:
        """Add the error to the front share of the drive force."""
        frame.drive_front_share = frame.drive_front_share + self.relative
