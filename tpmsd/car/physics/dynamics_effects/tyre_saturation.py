"""The tyres' side force is limited by friction."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.car import DynamicCar
from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class TyreSaturation(DynamicsEffect):
    """F = f * F_linear with f = (2 - l) l below l = 1, l = mu F_z / (2 F_linear): Dugoff's law with this
    friction; with a shape of 1 the brush model's f = 1 - x + x^2 / 3, x = F_linear / (3 mu F_z), with
    a shape of -1 the Magic Formula's, a mean of neighbours between.

    Where the baseline's tyres are linear there is no limit without it. Source: [Liu 2022], eqs (9)-(12); mu
    of 0.7 to 1.1 on dry asphalt, racing tyres to 1.6 ([Pacejka 2012], sections 3.2 and 4.3).
    """

    name = "tyre_saturation"
    kind = PHYSICS
    wording = Wording(
        formula="F = (2 - l) l * F_linear, l = mu * F_z / (2 * F_linear) < 1",
        sentence="the tyres' side force is limited by friction",
        distinguished_by="steer slowly into a bend until the tyres slide",
    )
    channel = "accel_lat"
    covariate = "accel_lat"
    composes = False
    confounded_with = ("load_dependent_stiffness", "cg_height_error")
    grid = (
        *({"friction": mu, "shape": 0.0} for mu in (0.3, 0.45, 0.6, 0.75, 0.9, 1.05, 1.25, 1.5)),
        *({"friction": mu, "shape": 1.0} for mu in (0.6, 0.9, 1.2, 1.6)),
        *({"friction": mu, "shape": -1.0} for mu in (0.6, 0.8, 1.0, 1.3)),
    )
    parameters = (
        Parameter(
            "friction",
            "1",
            0.9,
            0.05,
            3.0,
            "mu",
            probe=0.001,
            prior=Prior(1.0, 0.25, "0.7 to 1.1: Pacejka, section 4.3"),
            neutral=1.0,
        ),
        Parameter(
            "shape",
            "1",
            0.5,
            -2.0,
            2.0,
            "law between linear and sliding: 0 Dugoff, 1 brush model, -1 Magic Formula",
            probe=0.001,
            prior=Prior(0.0, 1.0, "all three laws are in use: Pacejka, sections 3.2 and 4.3"),
        ),
    )
    friction: float = 1.0
    shape: float = 0.0

    @classmethod
    def near_neutral(cls, nonlinear: bool) -> bool:
        """Return True where the baseline's tyres have a limit."""
        return nonlinear

    @classmethod
    def neutral_values(cls, car: DynamicCar, nonlinear: bool) -> dict[str, float]:
        """Return the configured friction."""
        return {"friction": car.friction, "shape": 0.0}

    @classmethod
    def has_neutral(cls, nonlinear: bool) -> bool:
        """Return True if the baseline's tyres have a limit; without one no friction does nothing."""
        return nonlinear

    def adapt_car(self, frame: Frame) -> None:
        """Set friction and the shape of the force curve."""
        frame.friction = self.friction
        frame.tyre_shape = self.shape
