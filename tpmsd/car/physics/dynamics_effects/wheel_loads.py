"""An axle's two wheels carry unequal loads in a bend, and the inner one slides first."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import NUISANCE, DynamicsEffect
from tpmsd.car.physics.dynamics_parameters import formula_coefficient
from tpmsd.car.physics.effect_records import Wording


@dataclass(frozen=True)
class WheelLoads(DynamicsEffect):
    """F_axle = sum of two wheels with F_z / 2 * (1 +- z), z the lateral load transfer over the static load.

    It shows where friction is limited on axles. The coefficient is 1 by statics; it holds errors of the
    height of the centre of gravity and of the axles' roll stiffness too. Source: [Gillespie 1992], ch. 6.
    """

    name = "wheel_loads"
    kind = NUISANCE
    wording = Wording(
        formula="F_axle = F(F_z / 2 * (1 - z)) + F(F_z / 2 * (1 + z)), z = 2 h u r / (g t)",
        sentence="an axle's two wheels carry unequal loads in bends",
        distinguished_by="hold steady bends up to the limit",
    )
    channel = "accel_lat"
    covariate = "accel_lat"
    confounded_with = ("tyre_saturation", "load_dependent_stiffness")
    grid = ({"coefficient": 1.0},)
    parameters = (
        formula_coefficient(
            "share of the quasi-static load transfer",
            "1 by statics; roll stiffness splits it between the axles",
        ),
    )
    coefficient: float = 0.0

    @classmethod
    def applies(cls, nonlinear: bool, forces: bool) -> bool:
        """Return True if the baseline's contacts are axles."""
        return not nonlinear

    def adapt_car(self, frame: Frame) -> None:
        """Set how far axle forces are sums over their two wheels' loads."""
        frame.wheel_loads = self.coefficient
