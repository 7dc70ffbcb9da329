"""Wheels that lean out with the body push outwards."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class CamberThrust(DynamicsEffect):
    """F_y = -c * F_z * u r / g on each axle, c the camber stiffness per load times the roll per g.

    Source: camber stiffness of about 1 per rad of load, roll of 3 to 7 degrees per g of which half remains
    between wheel and road: c of 0.02 to 0.06 ([Pacejka 2012], section 4.3).
    """

    name = "camber_thrust"
    kind = PHYSICS
    wording = Wording(
        formula="F_y = -c * F_z * u * r / g on each axle",
        sentence="leaning wheels push outwards in bends",
        distinguished_by="hold steady bends at two speeds and change lanes quickly",
    )
    channel = "velocity_lat"
    covariate = "accel_lat"
    confounded_with = ("cornering_stiffness_error", "mass_error")
    parameters = (
        Parameter(
            "coefficient",
            "1",
            0.05,
            -0.5,
            0.5,
            "c",
            probe=0.0001,
            prior=Prior(0.0, 0.04, "0.02 to 0.06: Pacejka, section 4.3"),
        ),
    )
    coefficient: float = 0.0

    def add_forces(self, frame: Frame) -> None:
        """Push both axles outwards."""
        pull = -self.coefficient * frame.across / GRAVITY_MPS2
        if frame.axles:
            front, rear = frame.load[0] * pull, frame.load[1] * pull
        else:
            front = (frame.load[0] + frame.load[1]) * pull
            rear = (frame.load[2] + frame.load[3]) * pull
        frame.force_y = frame.force_y + front + rear
        frame.moment = frame.moment + frame.front * front - frame.rear * rear
