"""The gyro's zero drifts while it warms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True)
class GyroDrift(Effect):
    """reading = truth + rate * t, t since the drive's start.

    Source: zero-rate level of automotive gyros over temperature, 1e-4 to 5e-4 rad/s per K, at some K in ten
    minutes.
    """

    name = "gyro_drift"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="reading = truth + rate * t",
        sentence="the gyro's zero drifts through the drive",
        noun="drift of the gyro's zero",
        answers=("the gyro's zero drifts by {rate:deg/h/s} each second",),
        distinguished_by="stand still for a minute at the beginning and at the end",
    )
    identification = Identification(shows_in=("yaw_rate", "time"), needs=("yaw_rate",))
    confounding = Confounding(drifts_into="yaw_rate")
    own_per_drive = True
    stays = "it belongs to the drive on which it was found"
    parameters = (
        Parameter(
            "rate",
            "rad/s2",
            1e-6,
            -1e-4,
            1e-4,
            "drift of the zero",
            probe=1e-7,
            prior=Prior(0.0, 2e-6, "1e-4 to 5e-4 rad/s per K, some K in ten minutes"),
        ),
    )
    rate: float

    def yaw_rate_error_radps(self, motion: Motion, car: Car) -> FloatArray:
        """(n,) rate times the time since the start."""
        return np.asarray(self.rate * motion.time_s)
