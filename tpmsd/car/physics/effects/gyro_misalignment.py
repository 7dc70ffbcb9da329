"""The gyro's axis is not the vertical of the car: what pitches and rolls leaks into the yaw rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray

ROLL_RAD_S2PM = 6e-3
"""Roll of a body outwards per lateral acceleration: 3.4 degrees per g."""
MOVING_MPS = 5.0
"""Below, nothing is compared."""
STEEP_RADPS = 1e-3
"""Standard deviation of the slope's rate from which a drive has hills enough."""


@dataclass(frozen=True)
class GyroMisalignment(Effect):
    """reading = truth + sideways_rad * pitch rate + forward_rad * roll rate, where the gyro's axis is tilted
    by these angles to the left and forward.

    The pitch rate is that of the road, -d(grade)/dt (nose down is positive), the roll rate K * d(a_y)/dt.
    What leaks of rolling goes with the yaw acceleration, as does a delay of the readings, and is not
    distinguished from it. Source: projection of the turning rate onto the sensor's axis; 1 to 3 degrees of a
    bracket; K of 3.4 degrees per g ([Gillespie 1992], ch. 6).
    """

    name = "gyro_misalignment"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="reading = truth - sideways_rad * d(grade)/dt + forward_rad * K * d(a_y)/dt",
        sentence="the gyro is not mounted upright",
        noun="a tilted gyro",
        answers=(
            "the gyro is tilted by {sideways_rad:size deg} to the {sideways_rad:left|right}",
            "the gyro is tilted by {forward_rad:size deg} {forward_rad:forward|back}",
        ),
        distinguished_by="drive straight over sharp crests and dips, ten times",
    )
    identification = Identification(shows_in=("yaw_rate", "grade"), needs=("yaw_rate", "slopes"))
    parameters = (
        Parameter(
            "sideways_rad",
            "rad",
            0.05,
            -0.8,
            0.8,
            "tilt of the gyro's axis to the left",
            probe=0.01,
            prior=Prior(0.0, 0.03, "1 to 3 degrees: brackets"),
            fitted=(-0.3, 0.3),
        ),
        Parameter(
            "forward_rad",
            "rad",
            0.03,
            -0.8,
            0.8,
            "tilt of the gyro's axis forward",
            prior=Prior(0.0, 0.03, "1 to 3 degrees: brackets"),
        ),
    )
    sideways_rad: float = 0.0
    forward_rad: float = 0.0

    @classmethod
    def observable(cls, motion: Motion, car: Car) -> bool:
        """Return whether the road is hilly enough: the pitch rate's spread is above `STEEP_RADPS`."""
        rate = pitch_rate_radps(motion)[motion.speed_mps > MOVING_MPS]
        return bool(rate.size) and float(np.std(rate)) > STEEP_RADPS

    def yaw_rate_error_radps(self, motion: Motion, car: Car) -> FloatArray:
        """Return the (n,) error by the shares of pitch and roll rate in the reading, rad/s."""
        if len(motion) < 2:
            return np.zeros(len(motion))
        roll_rate = ROLL_RAD_S2PM * np.gradient(motion.accel_lat_mps2, motion.time_s)
        return np.asarray(self.sideways_rad * pitch_rate_radps(motion) + self.forward_rad * roll_rate)


def pitch_rate_radps(motion: Motion) -> FloatArray:
    """Return the (n,) pitch rate of a car that follows the road, nose down positive, rad/s."""
    return np.asarray(-np.gradient(motion.grade_rad, motion.time_s))
