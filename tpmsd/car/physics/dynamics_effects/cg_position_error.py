"""The centre of gravity lies further ahead or back."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class CgPositionError(DynamicsEffect):
    """a = configured - forward_m, b = configured + forward_m.

    Source: load and passengers move it by 2 to 8 % of the wheelbase.
    """

    name = "cg_position_error"
    kind = PHYSICS
    wording = Wording(
        formula="a = configured - forward_m, b = configured + forward_m",
        sentence="the centre of gravity is not where configured",
        distinguished_by="hold steady bends at two speeds and change lanes quickly",
    )
    channel = "yaw_rate"
    covariate = "accel_lat"
    confounded_with = ("cornering_stiffness_error",)
    parameters = (
        Parameter(
            "forward_m",
            "m",
            0.08,
            -1.0,
            1.0,
            "true minus configured position, ahead",
            probe=0.001,
            prior=Prior(0.0, 0.06, "2 to 8 % of the wheelbase"),
        ),
    )
    forward_m: float = 0.0

    def adapt_car(self, frame: Frame) -> None:
        """Move both axles relative to the centre of gravity."""
        frame.front = frame.front - self.forward_m
        frame.rear = frame.rear + self.forward_m
