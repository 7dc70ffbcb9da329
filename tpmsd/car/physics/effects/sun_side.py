"""The side that the sun shines on is warmer, and its tyres larger."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Grid, NoiseResemblance, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Nonlinear, Wording
from tpmsd.car.physics.first_order import accumulated
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import IS_LEFT, FloatArray


@dataclass(frozen=True)
class SunSide(Effect):
    """The radii of a side go with the sun on it over the last minutes: +s on the left, -s on the right, where
    s is east_m * (-sin heading) + north_m * cos heading behind a low-pass of lag_s: what the sun from
    there would do. The car stood as it sets off.

    Source: a dark flank in the sun is 5 to 15 K warmer; 20 K of air is 0.56 mm on a 205/60R15.
    """

    name = "sun_side"
    wording = Wording(
        formula=(
            "delta_r = +-s, + left, - right, lag_s * ds/dt = -east_m * sin(heading) +"
            " north_m * cos(heading) - s"
        ),
        sentence="the sunny side is warmer",
        noun="a sunny side",
        answers=(
            "the sunny side is warmer: with the sun in the east its radii differ by {east_m:mm} in half",
            "with the sun in the north the sides differ by {north_m:mm} in half",
        ),
        distinguished_by="drive the same road there and back in the sun",
    )
    identification = Identification(shows_in=("wheel_ratio", "time"), contrast=True)
    confounding = Confounding(resembles=NoiseResemblance.WHEEL)
    nonlinear = Nonlinear(
        # A flank alone answers within two minutes, tread and air within ten.
        grid=Grid(
            "lag_s",
            values=(75.0, 150.0, 300.0, 600.0),
            middle=300.0,
            range=(30.0, 3000.0),
            penalty=lambda lag: 1.4 + 0.5 * (math.log(lag / 300.0) / 0.7) ** 2,
            step=1.5,
        )
    )
    own_per_drive = True
    stays = "it belongs to the drive on which it was found"
    parameters = (
        Parameter(
            "east_m",
            "m",
            1e-4,
            -2e-3,
            2e-3,
            "half the difference of the sides with the sun in the east on the left",
            probe=1e-5,
            prior=Prior(0.0, 1e-4, "5 to 15 K on the tread side"),
        ),
        Parameter(
            "north_m",
            "m",
            1e-4,
            -2e-3,
            2e-3,
            "the same with the sun in the north",
            probe=1e-5,
            prior=Prior(0.0, 1e-4, "5 to 15 K on the tread side"),
        ),
        Parameter(
            "lag_s",
            "s",
            300.0,
            1.0,
            1e5,
            "time constant of what the sun warms",
            prior=Prior(300.0, 200.0, "five minutes, give or take a factor of two, as tyres warm up"),
        ),
    )
    east_m: float = 0.0
    north_m: float = 0.0
    lag_s: float = 300.0

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """Return the (n, 4) lagged exposure to the sun, positive on the left."""
        heading = motion.heading_rad
        shining = -self.east_m * np.sin(heading) + self.north_m * np.cos(heading)
        step = float(motion.time_s[1] - motion.time_s[0]) if len(motion) > 1 else 1.0
        share = -math.expm1(-step / self.lag_s)
        warm = accumulated(share * shining, 1.0 - share, float(shining[0]))
        return np.asarray(warm[:, None] * np.where(IS_LEFT, 1.0, -1.0))
