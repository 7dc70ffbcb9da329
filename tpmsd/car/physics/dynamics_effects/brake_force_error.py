"""The brake force is more or less than the reading."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.dynamics_parameters import FORCE_ERROR
from tpmsd.car.physics.effect_records import Wording


@dataclass(frozen=True)
class BrakeForceError(DynamicsEffect):
    """F_brake = reading * (1 + relative).

    Source: torque by the engine's or the hydraulic model is within 5 to 15 % of the dynamometer's
    ([Rajamani 2012], ch. 5).
    """

    name = "brake_force_error"
    kind = PHYSICS
    wording = Wording(
        formula="F_brake = reading * (1 + relative)",
        sentence="the brake force is not the one stated",
        distinguished_by="brake on the level at several forces, the car weighed",
    )
    channel = "speed"
    covariate = "accel_long"
    confounded_with = ("mass_error",)
    needs_forces = True
    parameters = (FORCE_ERROR,)
    relative: float = 0.0

    def adapt_inputs(self, frame: Frame) -> None:
        """Scale the brake force by 1 + relative."""
        frame.brake = frame.brake * (1.0 + self.relative)
