"""Bends shift load to the outer wheels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Nonlinear, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.physics.priors import LATERAL_LOAD_S2
from tpmsd.foundation.wheels import IS_FRONT, IS_LEFT, FloatArray

ROLL_DIFFERENCE_S2 = Prior(0.0, 3e-5, "35 to 65 % of what bends shift, in front")


@dataclass(frozen=True)
class LoadTransferLateral(Effect):
    """More load, smaller effective radius: delta_r = +(c +- d) * a_y on the left, -(c +- d) * a_y right.

    In a left turn (a_y > 0) the right wheels are the outer ones and carry more. The axle that is stiffer in
    roll takes the greater share: c + d in front, c - d at the rear.
    Source: moment balance in the lateral plane, [Gillespie 1992], ch. 6. About 270
    N per wheel and m/s2 on a 1500 kg car, and 0.25 mm per 500 N, give c of about 1.3e-4 s2.
    """

    name = "load_transfer_lateral"
    wording = Wording(
        formula="delta_r = +(c + d) * a_y left, -(c + d) * a_y right in front; c - d at the rear",
        sentence="bends shift load between the sides and change the radii",
        noun="load shifted by bends",
        answers=(
            "bends shift load between the sides and change the radii, by {coefficient}",
            "they do by {front_more} more in front, and as much less at the rear",
        ),
        distinguished_by="drive the same bend slowly and fast, to both sides",
    )
    identification = Identification(shows_in=("wheel_ratio", "accel_lat"), contrast=True)
    confounding = Confounding(common=True)
    nonlinear = Nonlinear(ratio_limits=(-0.7, 0.7))
    in_calibration = (("load_lateral", "coefficient", "s2"),)
    one_sign = True
    parameters = (
        Parameter(
            "coefficient",
            "s2",
            1e-4,
            -2e-3,
            2e-3,
            "c, metres of radius per m/s2",
            probe=1e-6,
            prior=LATERAL_LOAD_S2,
        ),
        Parameter(
            "front_more",
            "s2",
            0.0,
            -1e-3,
            1e-3,
            "d, what the front axle has more and the rear axle less, metres of radius per m/s2",
            probe=1e-6,
            prior=ROLL_DIFFERENCE_S2,
        ),
    )
    coefficient: float
    front_more: float = 0.0

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) +(c + d)*a_y on the front left wheel, -(c - d)*a_y on the rear right one, and so on."""
        per_accel = self.coefficient + self.front_more * np.where(IS_FRONT, 1.0, -1.0)
        return motion.accel_lat_mps2[:, None] * per_accel * np.where(IS_LEFT, 1.0, -1.0)
