"""The gyro's readings are old: they are filtered, and sampled on their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True)
class GyroDelay(Effect):
    """reading(t) = truth(t) - delay * d truth / dt, to first order.

    Source: group delay of a stability controller's low-pass of 10 to 30 Hz, and half a sampling interval.
    """

    name = "gyro_delay"
    kind = Kind.NUISANCE
    wording = Wording(
        formula="reading = truth - delay_s * d truth / dt",
        sentence="the gyro's readings are old",
        noun="age of the gyro's readings",
        answers=("the gyro's readings are {delay_s:size ms} old",),
    )
    identification = Identification(shows_in=("yaw_rate", "time"), needs=("yaw_rate",), always_fitted=True)
    own_per_drive = True
    parameters = (
        Parameter(
            "delay_s",
            "s",
            0.03,
            -1.0,
            1.0,
            "age of a reading",
            probe=0.1,
            prior=Prior(0.02, 0.03, "low-pass of 10 to 30 Hz"),
        ),
    )
    delay_s: float

    def yaw_rate_error_radps(self, motion: Motion, car: Car) -> FloatArray:
        """(n,) -delay times the yaw acceleration."""
        if len(motion) < 2:
            return np.zeros(len(motion))
        return np.asarray(-self.delay_s * np.gradient(motion.yaw_rate_radps, motion.time_s))
