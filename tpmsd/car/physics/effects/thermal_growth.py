"""Tyres grow as they warm up."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Grid, NoiseResemblance, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Nonlinear, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.physics.priors import WARMTH_M
from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True)
class ThermalGrowth(Effect):
    """Rolling warms the tyre and the air in it: delta_r = A * (1 - exp(-t / tau)), t since the drive's start.

    Source: first-order warm-up of the tyre's air (gas law at constant volume: 20 K is 7 % of absolute
    pressure), turned into radius by the tyre's stiffness: about 0.56 mm for 20 K on a 205/60R15; time
    constants of ten minutes, give or take a factor of two. Negative A is a tyre that cools.
    """

    name = "thermal_growth"
    wording = Wording(
        formula="delta_r = A * (1 - exp(-t / tau)) on all wheels",
        sentence="the tyres grow as they warm up",
        noun="growth by warmth",
        answers=(
            "the tyres {amplitude_m:grow|shrink} by {amplitude_m:size mm} in warming up"
            " ({time_constant_s:min})",
        ),
        distinguished_by="after half an hour, hold the speed of the first minutes once more",
    )
    identification = Identification(shows_in=("wheel", "time"))
    confounding = Confounding(resembles=NoiseResemblance.COMMON)
    nonlinear = Nonlinear(
        # Tyres take ten minutes, give or take a factor of two.
        grid=Grid(
            "time_constant_s",
            values=(120.0, 200.0, 300.0, 450.0, 650.0, 1000.0, 1600.0, 3000.0),
            middle=450.0,
            range=(60.0, 6000.0),
            penalty=lambda tau: 1.5 + 0.5 * (math.log(tau / 500.0) / 0.7) ** 2,
            step=1.4,
        )
    )
    one_sign = True
    parameters = (
        Parameter(
            "amplitude_m",
            "m",
            6e-4,
            -1e-2,
            1e-2,
            "A, reached after several time constants",
            probe=1e-5,
            prior=WARMTH_M,
        ),
        Parameter(
            "time_constant_s",
            "s",
            600.0,
            1.0,
            1e5,
            "tau",
            prior=Prior(500.0, 350.0, "ten minutes, give or take a factor of two"),
        ),
    )
    amplitude_m: float
    time_constant_s: float = 600.0

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) the same warm-up curve on every wheel."""
        growth = -self.amplitude_m * np.expm1(-motion.time_s / self.time_constant_s)
        return np.repeat(growth[:, None], 4, axis=1)
