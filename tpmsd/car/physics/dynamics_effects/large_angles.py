"""Angles are not small: forces of steered wheels turn with them, and slip angles are arcs of a tangent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.baselines.frame import Frame, stack_contacts
from tpmsd.car.physics.dynamics_effect import NUISANCE, DynamicsEffect
from tpmsd.car.physics.dynamics_parameters import formula_coefficient
from tpmsd.car.physics.effect_records import Wording


@dataclass(frozen=True)
class LargeAngles(DynamicsEffect):
    """F_y = F_f cos(delta) + F_x sin(delta) + F_r, alpha = delta - atan(v_y / u) at the front.

    F_x is the front axle's share of drive and brake force, whose sum is m a_x + F_f sin(delta) with the
    recorded a_x: the wheels pull against the turned side force as well. The coefficient is 1 in every car;
    the linear single-track car takes angles as small and has 0. Source: [Rajamani 2012], ch. 2.
    """

    name = "large_angles"
    kind = NUISANCE
    reads_loads = False
    wording = Wording(
        formula="F_y = F_f * cos(delta) + F_x * sin(delta) + F_r, alpha = delta - atan(v_y / u)",
        sentence="the angles of steering and slip are not small",
        distinguished_by="drive tight bends slowly, accelerate and brake in them",
    )
    channel = "accel_lat"
    covariate = "steering"
    confounded_with = ("steering_ratio_error", "yaw_moment")
    grid = ({"coefficient": 1.0},)
    parameters = (
        formula_coefficient(
            "share of the difference between finite and small angles",
            "1 by geometry; the shares of the forces at the front are known to a third",
        ),
    )
    coefficient: float = 0.0

    @classmethod
    def applies(cls, nonlinear: bool, forces: bool) -> bool:
        """Return True if the baseline takes angles as small."""
        return not nonlinear

    def adapt_angles(self, frame: Frame) -> None:
        """Replace linear slip angles by their arctangents."""
        front = (frame.v + frame.front * frame.r) / frame.u
        rear = (frame.v - frame.rear * frame.r) / frame.u
        less = stack_contacts(front - np.arctan(front), rear - np.arctan(rear))
        frame.angle = frame.angle + self.coefficient * less

    def add_forces(self, frame: Frame) -> None:
        """Turn the forces of the front wheels."""
        # the sine, and 1 - cos, by the tangent of half the angle, which takes a fifth of the sine's time
        half = np.tan(0.5 * frame.steer)
        sine = 2.0 * half / (1.0 + half * half)
        sum_x = frame.drive - frame.brake + frame.side[0] * sine
        along = np.where(sum_x > 0.0, frame.drive_front_share, frame.brake_front_share) * sum_x
        turned = (along - frame.side[0] * half) * sine
        frame.force_y = frame.force_y + self.coefficient * turned
        frame.moment = frame.moment + self.coefficient * frame.front * turned
