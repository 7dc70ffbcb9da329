"""The yaw inertia is not the configured one."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class YawInertiaError(DynamicsEffect):
    """I_z = configured * (1 + relative).

    Source: I_z / (m a b) of 0.8 to 1.2 over passenger cars ([Heydinger 1999], NHTSA inertia data base).
    """

    name = "yaw_inertia_error"
    kind = PHYSICS
    wording = Wording(
        formula="I_z = configured * (1 + relative)",
        sentence="the yaw inertia is not the configured one",
        distinguished_by="steer quickly from side to side at 20 m/s",
    )
    channel = "yaw_rate"
    covariate = "steering_rate"
    confounded_with = ("tyre_relaxation", "steering_delay")
    parameters = (
        Parameter(
            "relative",
            "1",
            0.15,
            -0.7,
            2.0,
            "true over configured, minus 1",
            probe=0.001,
            prior=Prior(0.0, 0.15, "I_z / (m a b) of 0.8 to 1.2: NHTSA"),
        ),
    )
    relative: float = 0.0

    def adapt_car(self, frame: Frame) -> None:
        """Scale the yaw inertia by 1 + relative."""
        frame.inertia = frame.inertia * (1.0 + self.relative)
