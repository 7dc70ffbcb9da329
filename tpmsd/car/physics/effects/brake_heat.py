"""Brakes warm a wheel or an axle, which grows and cools down over minutes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import (
    Effect,
    Grid,
    GroupParameter,
    NoiseResemblance,
    Parameter,
    Prior,
    SecondParameter,
)
from tpmsd.car.physics.effect_records import Confounding, Identification, Nonlinear, Wording
from tpmsd.car.physics.first_order import accumulated
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.physics.spans import wheel_mask
from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True)
class BrakeHeat(Effect):
    """delta_r = k * h on its wheels: braking energy comes from the disc to the rim within `soak_s`, and
    leaves it with `cooling_s`.

    dq/dt = max(-a_x, 0) * v - q / soak_s in the disc, dh/dt = q / soak_s - h / cooling_s in rim and tyre,
    both energy per mass, m2/s2. Source: first-order cooling of a disc and its rim, 2 to 10 minutes (Limpert,
    Brake Design and Safety, 2011, chapter 3); a disc gives its heat to hub and rim by conduction,
    radiation and the air between them, within seconds (a massive disc bolted to the hub) to minutes
    (ibid., section 3.1); a stop from 100 km/h is 386 m2/s2, and a rim that is 10 K warmer by it gives
    0.3 mm: k of 7e-7 s2/m.
    """

    name = "brake_heat"
    wording = Wording(
        formula="delta_r = k * h on its wheels, dh/dt = q / soak_s - h / cooling_s, "
        "dq/dt = max(-a_x, 0) * v - q / soak_s",
        sentence="brakes warm wheels, which grow and cool down again",
        noun="heat of the brakes",
        answers=("brakes warm the wheels {wheels}, which grow by {growth} of braking work per mass",),
        distinguished_by="brake firmly from 30 m/s ten times, then roll for ten minutes",
    )
    identification = Identification(
        shows_in=("wheel_ratio", "time"), wheel_patterns=("front", "rear", "fl", "fr", "rl", "rr")
    )
    confounding = Confounding(resembles=NoiseResemblance.WHEEL)
    nonlinear = Nonlinear(
        # Discs and rims take two to ten minutes; how soon the tyre has it is known to a factor of three.
        grid=Grid(
            "cooling_s",
            values=(80.0, 200.0, 500.0),
            middle=200.0,
            range=(30.0, 2000.0),
            penalty=lambda tau: 1.1 + 0.5 * (math.log(tau / 200.0) / 0.7) ** 2,
            step=1.5,
            second=SecondParameter(
                "soak_s",
                range=(0.3, 300.0),
                penalty=lambda tau: 0.5 * (math.log(tau / 30.0) / 1.1) ** 2,
                step=4.0,
            ),
        )
    )
    one_sign = True
    parameters = (
        GroupParameter("wheels", "front", "wheels that warm up: their names, or front, rear"),
        Parameter(
            "growth",
            "s2/m",
            7e-7,
            -1e-4,
            1e-4,
            "k, radius per braking energy and mass",
            probe=1e-8,
            prior=Prior(7e-7, 7e-7, "0.3 mm after a stop from 100 km/h"),
            fitted=(0.0, 1e-4),  # no brake cools a wheel
        ),
        Parameter(
            "cooling_s",
            "s",
            200.0,
            1.0,
            1e5,
            "time constant of cooling",
            prior=Prior(200.0, 150.0, "2 to 10 minutes: Limpert 2011, ch. 3"),
        ),
        Parameter(
            "soak_s",
            "s",
            10.0,
            0.0,
            1e4,
            "time constant in which a disc's heat reaches its tyre; 0: at once",
            prior=Prior(30.0, 30.0, "half a minute, give or take a factor of three"),
        ),
    )
    wheels: str
    growth: float
    cooling_s: float = 200.0
    soak_s: float = 10.0

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) k times the energy that is left, on its wheels."""
        power = np.maximum(-motion.specific_force_long_mps2, 0.0) * motion.speed_mps
        step = float(motion.time_s[1] - motion.time_s[0]) if len(motion) > 1 else 1.0
        if self.soak_s > 0.0:
            kept = math.exp(-step / self.soak_s)
            power = accumulated((1.0 - kept) * power, kept)
        left = math.exp(-step / self.cooling_s)
        heat = accumulated(self.cooling_s * (1.0 - left) * power, left)
        return np.asarray(self.growth * heat[:, None] * wheel_mask(self.wheels))
