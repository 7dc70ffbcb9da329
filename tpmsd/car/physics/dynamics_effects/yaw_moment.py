"""Drive or brake forces are unequal on the left and the right."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class YawMoment(DynamicsEffect):
    """M_z = c * F_x, F_x the sum of drive and brake forces (m a_x where none are given); c is half the
    track times the difference of the sides' shares, positive where the right side carries more.

    Source: brake force differences of 5 to 25 % per axle are tolerated at inspections (directive 2014/45/EU).
    """

    name = "yaw_moment"
    kind = PHYSICS
    wording = Wording(
        formula="M_z = c * F_x",
        sentence="drive or brake forces turn the car",
        distinguished_by="brake firmly on a straight with the steering wheel held",
    )
    channel = "yaw_rate"
    covariate = "accel_long"
    confounded_with = ("accelerometer_tilt",)
    parameters = (
        Parameter(
            "coefficient",
            "m",
            0.05,
            -1.0,
            1.0,
            "c, lever of the resulting force",
            probe=0.0001,
            prior=Prior(0.0, 0.05, "5 to 25 % of half a track: directive 2014/45/EU"),
        ),
    )
    coefficient: float = 0.0

    def add_forces(self, frame: Frame) -> None:
        """Add the moment."""
        frame.moment = frame.moment + self.coefficient * (frame.drive - frame.brake)
