"""The wheels of the driven axle turn alike."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class DynamicsLockedDifferential(DynamicsEffect):
    """M_z = -c * C_sigma * t^2 / 2 * r / u, t the track of the driven axle, c = 1 for a locked axle.

    A wheel that must turn with its axle's mean slips by t r / (2 u). Source: kinematics of an axle;
    limited-slip differentials lock by a quarter to three quarters.
    """

    name = "locked_differential"
    kind = PHYSICS
    wording = Wording(
        formula="M_z = -c * C_sigma * t^2 / 2 * r / u",
        sentence="the wheels of the driven axle turn alike",
        distinguished_by="drive tight bends slowly under power",
    )
    channel = "yaw_rate"
    covariate = "yaw_rate"
    confounded_with = ("cornering_stiffness_error", "steering_ratio_error")
    positive = True
    parameters = (
        Parameter(
            "coefficient",
            "1",
            0.3,
            -0.5,
            2.0,
            "c, 1 is a locked axle",
            probe=0.001,
            prior=Prior(0.0, 0.3, "a quarter to three quarters: makers"),
        ),
    )
    coefficient: float = 0.0

    def add_forces(self, frame: Frame) -> None:
        """Add the yaw moment against the turn."""
        share = frame.drive_front_share
        track = share * frame.track_front + (1.0 - share) * frame.track_rear
        stiff = 0.5 * self.coefficient * frame.longitudinal * track**2
        frame.moment = frame.moment - stiff * frame.r / frame.u
