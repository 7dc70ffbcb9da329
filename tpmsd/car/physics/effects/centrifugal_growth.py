"""Tyres grow with speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, NoiseResemblance, Parameter
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.physics.priors import GROWTH_S2PM
from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True)
class CentrifugalGrowth(Effect):
    """The belt's own mass pulls it outwards: delta_r = k * v^2 on all wheels.

    Source: the free radius r0 * (1 + q_V1 * (omega * r0 / v0)^2) of the Magic Formula 6.1 ([Besselink 2010]).
    A 205/60R15 gains 1.1 mm from 10 to 36 m/s: k is about 1e-6 s2/m.
    """

    name = "centrifugal_growth"
    wording = Wording(
        formula="delta_r = k * v^2 on all wheels",
        sentence="the tyres grow with speed",
        noun="growth with speed",
        answers=("the tyres {coefficient:grow|shrink} with speed, by {coefficient:size} times its square",),
        distinguished_by="hold 30 m/s for two minutes, then coast to 15 m/s, twice",
    )
    identification = Identification(shows_in=("wheel", "speed"))
    confounding = Confounding(resembles=NoiseResemblance.COMMON)
    in_calibration = (("growth", "coefficient", "s2/m"),)
    one_sign = True
    parameters = (
        Parameter(
            "coefficient",
            "s2/m",
            1e-6,
            -2e-5,
            2e-5,
            "k in delta_r = k * v^2",
            probe=1e-8,
            prior=GROWTH_S2PM,
        ),
    )
    coefficient: float

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) k * v^2 on every wheel."""
        growth = self.coefficient * motion.speed_mps**2
        return np.repeat(growth[:, None], 4, axis=1)
