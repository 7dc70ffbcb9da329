"""The tread wears off: all tyres grow smaller over thousands of kilometres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, NoiseResemblance, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray

FAR_M = 5e5
"""Way from which a drive can show it: 0.1 mm."""


@dataclass(frozen=True)
class Wear(Effect):
    """delta_r = -rate * distance on all wheels.

    On one day it is hundredths of a millimetre, less than what the air in the tyres does; from one drive to
    the next it is in each drive's own radii, so that a fleet's records show it and a drive of less than 500
    km does not.

    Source: treads of 8 mm are down to 1.6 mm (the wear indicator of UN R30) after 30,000 to 60,000 km, 1e-10
    to 2e-10 m per m.
    """

    name = "wear"
    wording = Wording(
        formula="delta_r = -rate * distance on all wheels",
        sentence="the treads of all tyres wear off",
        noun="wear of the treads",
        answers=("the treads of all tyres wear off, by {rate:mm/km}",),
        distinguished_by="compare the radii of drives that lie thousands of kilometres apart",
    )
    identification = Identification(shows_in=("wheel", "distance"), needs=("gnss",))
    confounding = Confounding(resembles=NoiseResemblance.COMMON)
    one_sign = True
    parameters = (
        Parameter(
            "rate",
            "1",
            2e-10,
            0.0,
            1e-7,
            "radius lost per way",
            probe=1e-10,
            prior=Prior(2e-10, 1e-10, "6.4 mm of tread in 30,000 to 60,000 km"),
            fitted=(0.0, 1e-9),
        ),
    )
    rate: float

    @classmethod
    def observable(cls, motion: Motion, car: Car) -> bool:
        """Return whether the drive is long enough for wear to show."""
        return float(motion.distance_m[-1]) > FAR_M

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """Return the (n, 4) change, the same on all wheels: -rate * distance."""
        return np.repeat(-self.rate * motion.distance_m[:, None], 4, axis=1)
