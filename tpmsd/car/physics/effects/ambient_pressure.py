"""The air outside is thinner up the hill, and the tyres are fuller."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, NoiseResemblance, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.motion import Car, Motion, integrate
from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True)
class AmbientPressure(Effect):
    """delta_r = k * (height - that at the start) on all wheels: outer pressure falls with height, gauge
    pressure rises.

    Source: barometric formula, 1.2 kPa per 100 m at sea level; 1 % of 220 kPa is 0.07 mm: 3.8e-7 m per m.
    """

    name = "ambient_pressure"
    wording = Wording(
        formula="delta_r = per_m * (height - height at the start) on all wheels",
        sentence="the tyres grow with the height above the sea",
        noun="growth with height",
        answers=(
            "the tyres {per_m:grow|shrink} with the height above the sea, by {per_m} of the radius per metre",
        ),
        distinguished_by="drive up and down a mountain of 500 m",
    )
    identification = Identification(shows_in=("wheel", "grade"), needs=("gnss", "slopes"))
    confounding = Confounding(resembles=NoiseResemblance.COMMON)
    one_sign = True
    stays = "the height since the start is not kept"
    parameters = (
        Parameter(
            "per_m",
            "1",
            4e-7,
            -1e-5,
            1e-5,
            "k, radius per height",
            probe=1e-8,
            prior=Prior(4e-7, 2e-7, "1.2 kPa per 100 m, 0.07 mm per 2.2 kPa"),
        ),
    )
    per_m: float

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) k times the height climbed since the start."""
        climbed = integrate(motion.speed_mps * np.sin(motion.grade_rad), motion.time_s)
        return np.repeat(self.per_m * climbed[:, None], 4, axis=1)
