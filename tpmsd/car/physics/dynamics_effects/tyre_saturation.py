"""The tyres' side force is limited by friction."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.car import DynamicCar
from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class TyreSaturation(DynamicsEffect):
    """F = f * F_linear with f = (2 - l) l below l = 1, l = mu F_z / (2 F_linear): Dugoff's law with this
    friction.

    Where the baseline's tyres are linear there is no limit without it. Source: [Liu 2022], eqs (9)-(12); mu
    of 0.7 to 1.1 on dry asphalt, racing tyres to 1.6 ([Pacejka 2012], section 4.3).
    """

    name = "tyre_saturation"
    kind = PHYSICS
    formula = "F = (2 - l) l * F_linear, l = mu * F_z / (2 * F_linear) < 1"
    sentence = "the tyres' side force is limited by friction"
    telling_drive = "steer slowly into a bend until the tyres slide"
    channel = "accel_lat"
    covariate = "accel_lat"
    twins = ("load_dependent_stiffness", "cg_height_error")
    grid = tuple({"friction": mu} for mu in (0.3, 0.45, 0.6, 0.75, 0.9, 1.05, 1.25, 1.5))
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
    )
    friction: float = 1.0

    @classmethod
    def neutral_values(cls, car: DynamicCar, nonlinear: bool) -> dict[str, float]:
        """Return the configured friction."""
        return {"friction": car.friction}

    def adapt_car(self, frame: Frame) -> None:
        """Set the limit."""
        frame.friction = self.friction
