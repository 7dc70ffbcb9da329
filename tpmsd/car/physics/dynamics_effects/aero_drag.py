"""The air resists."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class AeroDrag(DynamicsEffect):
    """F_x = -rho / 2 * A * v * abs(v), A the drag coefficient times the frontal area.

    Source: c_d * A of 0.55 to 0.85 m2 for passenger cars ([Gillespie 1992], ch. 4).
    """

    name = "aero_drag"
    kind = PHYSICS
    wording = Wording(
        formula="F_x = -rho/2 * A * v * abs(v)",
        sentence="the air resists",
        distinguished_by="coast in neutral from 35 m/s to 10 m/s, both ways",
    )
    channel = "speed"
    covariate = "speed"
    confounded_with = ("rolling_resistance", "drive_force_error")
    needs_forces = True
    positive = True
    parameters = (
        Parameter(
            "drag_area_m2",
            "m2",
            0.65,
            -2.0,
            5.0,
            "A, drag coefficient times frontal area",
            probe=0.001,
            prior=Prior(0.0, 0.65, "0.55 to 0.85: Gillespie, ch. 4"),
        ),
    )
    drag_area_m2: float = 0.0

    def adapt_car(self, frame: Frame) -> None:
        """Add A to the car's drag area."""
        frame.drag_area = frame.drag_area + self.drag_area_m2
