"""The tyres are stiffer or softer than configured."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class CorneringStiffnessError(DynamicsEffect):
    """C = configured * (1 + front), (1 + rear) of the axles.

    Source: make, pressure, wear and temperature change cornering stiffness by 10 to 30 % ([Pacejka 2012],
    section 1.3).
    """

    name = "cornering_stiffness_error"
    kind = PHYSICS
    wording = Wording(
        formula="C = configured * (1 + front | rear)",
        sentence="the axles' cornering stiffness is not the configured one",
        distinguished_by="hold steady bends at two speeds and change lanes quickly",
    )
    channel = "yaw_rate"
    covariate = "accel_lat"
    confounded_with = ("cg_position_error", "mass_error", "compliance_steer")
    separable = True
    parameters = (
        Parameter(
            "front",
            "1",
            0.15,
            -0.8,
            3.0,
            "true over configured, minus 1, front axle",
            probe=0.001,
            prior=Prior(0.0, 0.2, "10 to 30 %: Pacejka, section 1.3"),
        ),
        Parameter(
            "rear",
            "1",
            0.15,
            -0.8,
            3.0,
            "true over configured, minus 1, rear axle",
            probe=0.001,
            prior=Prior(0.0, 0.2, "10 to 30 %: Pacejka, section 1.3"),
        ),
    )
    front: float = 0.0
    rear: float = 0.0

    def adapt_car(self, frame: Frame) -> None:
        """Scale the cornering stiffness of the axles by 1 + front and 1 + rear."""
        frame.cornering_front = frame.cornering_front * (1.0 + self.front)
        frame.cornering_rear = frame.cornering_rear * (1.0 + self.rear)
