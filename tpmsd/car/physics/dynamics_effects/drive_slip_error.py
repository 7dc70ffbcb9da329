"""The wheels slip more or less under drive and brake force than configured."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import NUISANCE, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class DriveSlipError(DynamicsEffect):
    """sigma / (1 + sigma) = (1 + relative) F_x / C_sigma.

    A tyre of Dugoff's that slips carries 1 / (1 + sigma) of its side force: the coefficient is the error of
    the longitudinal stiffness, and near -1 for tyres whose side force does not follow that law. Source:
    C_sigma of 10 to 30 times the load ([Pacejka 2012], section 4.3).
    """

    name = "drive_slip_error"
    kind = NUISANCE
    wording = Wording(
        formula="sigma / (1 + sigma) = (1 + relative) * F_x / C_sigma",
        sentence="slip under drive and brake force changes the side forces by another amount than configured",
        distinguished_by="accelerate and brake firmly in bends, and coast through the same bends",
    )
    channel = "yaw_rate"
    covariate = "accel_long"
    confounded_with = ("drive_share_error", "tyre_saturation")
    parameters = (
        Parameter(
            "relative",
            "1",
            0.5,
            -0.98,
            3.0,
            "true slip of a force over the configured one, minus 1",
            probe=0.001,
            prior=Prior(0.0, 0.6, "10 to 30 times the load: Pacejka, section 4.3"),
        ),
    )
    relative: float = 0.0

    @classmethod
    def applies(cls, nonlinear: bool, forces: bool) -> bool:
        """Return True if the tyres' side force depends on the slip along it."""
        return nonlinear

    def adapt_car(self, frame: Frame) -> None:
        """Divide the longitudinal stiffness by 1 + relative."""
        frame.longitudinal = frame.longitudinal / (1.0 + self.relative)
