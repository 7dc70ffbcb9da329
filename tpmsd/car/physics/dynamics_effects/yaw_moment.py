"""Drive or brake forces are unequal on the left and the right, always or in bends."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class YawMoment(DynamicsEffect):
    """M_z = c * F_x + lateral_m * F_y, F_x the sum of drive and brake forces (m a_x where none are given),
    F_y that of all side forces.

    c is half the track times the difference of the sides' shares, positive where the right side carries more;
    lateral_m is positive where the wheels' forces turn the car into its bends. Source: brake forces that
    differ by 5 to 25 % per axle are tolerated at inspections (directive 2014/45/EU); torque vectoring makes
    500 to 2000 N m at 5 m/s2, that is 0.05 to 0.2 m times m a_y.
    """

    name = "yaw_moment"
    order = 2  # after all side forces
    kind = PHYSICS
    wording = Wording(
        formula="M_z = c * F_x + lateral_m * F_y",
        sentence="drive or brake forces turn the car",
        distinguished_by="brake firmly on a straight with the steering wheel held",
    )
    channel = "yaw_rate"
    covariate = "accel_long"
    confounded_with = ("accelerometer_tilt", "cg_position_error", "roll_steer")
    separable = True
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
        Parameter(
            "lateral_m",
            "m",
            0.1,
            -1.0,
            1.0,
            "lever of the sum of the side forces",
            probe=0.0001,
            prior=Prior(0.0, 0.1, "500 to 2000 N m at 5 m/s2: torque vectoring of road cars"),
        ),
    )
    coefficient: float = 0.0
    lateral_m: float = 0.0

    def add_forces(self, frame: Frame) -> None:
        """Add a yaw moment in proportion to drive less brake force and to lateral force."""
        frame.moment = (
            frame.moment + self.coefficient * (frame.drive - frame.brake) + self.lateral_m * frame.force_y
        )
