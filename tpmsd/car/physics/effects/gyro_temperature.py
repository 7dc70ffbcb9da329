"""The gyro's zero goes with the temperature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.covariates import covariate
from tpmsd.car.physics.effect import Effect, Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray

ROOM_K = 293.15
"""At which gyros are trimmed."""


@dataclass(frozen=True)
class GyroTemperature(Effect):
    """reading = truth + c * (T - 293 K), T the ambient temperature on the bus.

    Source: zero-rate level of automotive gyros over temperature, 1e-4 to 5e-4 rad/s per K.
    """

    name = "gyro_temperature"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="reading = truth + per_kelvin * (T - 293 K)",
        sentence="the gyro's zero goes with the temperature",
        noun="warmth in the gyro's zero",
        answers=("the gyro's zero goes with the temperature, by {per_kelvin}",),
        distinguished_by="drive from a warm garage into the cold",
    )
    identification = Identification(shows_in=("yaw_rate", "temperature"), needs=("yaw_rate", "temperature"))
    parameters = (
        Parameter(
            "per_kelvin",
            "rad/(s.K)",
            1e-4,
            -1e-2,
            1e-2,
            "zero per temperature",
            probe=1e-5,
            prior=Prior(0.0, 3e-4, "data sheets"),
        ),
    )
    per_kelvin: float

    def yaw_rate_error_radps(self, motion: Motion, car: Car) -> FloatArray:
        """Return the (n,) shift of the gyro's zero, rad/s; 0 where no temperature is known."""
        kelvin = covariate(motion, car, "temperature")
        return np.where(np.isnan(kelvin), 0.0, self.per_kelvin * (kelvin - ROOM_K))
