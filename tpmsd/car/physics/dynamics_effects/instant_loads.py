"""Loads and roll follow the instantaneous accelerations."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import NUISANCE, DynamicsEffect
from tpmsd.car.physics.dynamics_parameters import formula_coefficient
from tpmsd.car.physics.effect_records import Wording


@dataclass(frozen=True)
class InstantLoads(DynamicsEffect):
    """a_y = u r + c * (F_y / m - u r), a_x likewise from (F_drive - F_brake) / m to F_x / m, c = 1.

    Loads, and what the body's roll does, follow these. With 0 they follow the steady accelerations alone, in
    which no force waits for a load; a car that turns in has dv/dt beside u r. Source: [Liu 2022], eqs (1) and
    (8).
    """

    name = "instant_loads"
    kind = NUISANCE
    wording = Wording(
        formula="loads and roll follow a_y = u * r + c * (F_y / m - u * r), a_x likewise",
        sentence="wheel loads follow the instantaneous accelerations",
        distinguished_by="change lanes quickly near the limit",
    )
    channel = "accel_lat"
    covariate = "steering_rate"
    confounded_with = ("cg_height_error", "wheel_loads")
    grid = ({"coefficient": 1.0},)
    parameters = (
        formula_coefficient(
            "share of the accelerations beside the steady ones",
            "1 by statics; springs and dampers delay it",
        ),
    )
    coefficient: float = 0.0

    @classmethod
    def applies(cls, nonlinear: bool, forces: bool) -> bool:
        """Return True if the baseline's tyres feel their loads: to linear ones the steady loads do."""
        return nonlinear

    def adapt_car(self, frame: Frame) -> None:
        """Set the share of the instantaneous accelerations in load transfer."""
        frame.instant_loads = self.coefficient
