"""A longitudinal force takes side force by the friction ellipse."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import NUISANCE, DynamicsEffect
from tpmsd.car.physics.dynamics_parameters import formula_coefficient
from tpmsd.car.physics.effect_records import Wording


@dataclass(frozen=True)
class CombinedSlip(DynamicsEffect):
    """F_y = F_y(alpha, mu F_z sqrt(1 - (F_x / mu F_z)^2)): the ellipse, with a coefficient of 1.

    With 0 it is the baseline's own way: none on axles with linear tyres, Dugoff's on wheels. F_x is the share
    of drive and brake force that the car's configuration gives. It shows where friction is limited. Source:
    [Hindiyeh 2014]; [Pacejka 2012], section 4.3.2.
    """

    name = "combined_slip"
    kind = NUISANCE
    wording = Wording(
        formula="F_y = F_y(alpha, mu * F_z * sqrt(1 - (F_x / (mu * F_z))^2))",
        sentence="a longitudinal force takes side force by the friction ellipse",
        distinguished_by="accelerate and brake firmly in bends, and coast through the same bends",
    )
    channel = "accel_lat"
    covariate = "accel_long"
    confounded_with = ("drive_slip_error", "drive_share_error")
    grid = ({"coefficient": 1.0},)
    parameters = (
        formula_coefficient(
            "share of the ellipse, 0 for the baseline's own law",
            "1 by the ellipse; the axles' shares of force are known to a third",
        ),
    )
    coefficient: float = 0.0

    def adapt_car(self, frame: Frame) -> None:
        """Set how far side forces follow the friction ellipse."""
        frame.ellipse = self.coefficient
