"""The air presses the axles down."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame, stack_contacts
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class AeroDownforce(DynamicsEffect):
    """F_z = rho / 2 * A * v^2 more load on each axle; negative A is lift.

    Source: lift coefficients times area of -0.3 to 0.5 m2 per axle, racing cars to 2 m2 ([Katz 1995], ch. 2).
    """

    name = "aero_downforce"
    kind = PHYSICS
    wording = Wording(
        formula="F_z = rho/2 * A * v^2 per axle",
        sentence="the air changes the axles' loads",
        distinguished_by="take the same bend at its limit at two speeds",
    )
    channel = "accel_lat"
    covariate = "speed"
    confounded_with = ("tyre_saturation",)
    parameters = (
        Parameter(
            "front_m2",
            "m2",
            0.3,
            -3.0,
            6.0,
            "A of the front axle",
            probe=0.01,
            prior=Prior(0.0, 0.4, "-0.5 to 0.3 per axle: Katz, ch. 2"),
        ),
        Parameter(
            "rear_m2",
            "m2",
            0.3,
            -3.0,
            6.0,
            "A of the rear axle",
            probe=0.01,
            prior=Prior(0.0, 0.4, "-0.5 to 0.3 per axle: Katz, ch. 2"),
        ),
    )
    front_m2: float = 0.0
    rear_m2: float = 0.0

    def adapt_loads(self, frame: Frame) -> None:
        """Add the axle's force, halves on its wheels."""
        press = 0.5 * frame.air_kgpm3 * frame.u**2
        front, rear = self.front_m2 * press, self.rear_m2 * press
        if len(frame.load) == 2:
            frame.load = frame.load + stack_contacts(front, rear)
            return
        halves = (0.5 * front, 0.5 * front, 0.5 * rear, 0.5 * rear)
        frame.load = frame.load + stack_contacts(*halves)
