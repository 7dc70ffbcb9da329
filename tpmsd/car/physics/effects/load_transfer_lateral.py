"""Bends shift load to the outer wheels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Parameter
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.physics.priors import LATERAL_LOAD_S2
from tpmsd.foundation.wheels import IS_LEFT, FloatArray


@dataclass(frozen=True)
class LoadTransferLateral(Effect):
    """More load, smaller effective radius: delta_r = -c * a_y on the right wheels, +c * a_y on the left.

    In a left turn (a_y > 0) the right wheels are the outer ones and carry more.
    Source: moment balance in the lateral plane, [Gillespie 1992], ch. 6. About 270
    N per wheel and m/s2 on a 1500 kg car, and 0.25 mm per 500 N, give c of about 1.3e-4 s2.
    """

    name = "load_transfer_lateral"
    common = True
    formula = "delta_r = +c * a_y left, -c * a_y right"
    contrast = True
    in_calibration = (("load_lateral", "coefficient", "s2"),)
    sentence = "bends shift load between the sides and change the radii"
    noun = "load shifted by bends"
    answers = ("bends shift load between the sides and change the radii, by {coefficient}",)
    distinguished_by = "drive the same bend slowly and fast, to both sides"
    shows_in = ("wheel_ratio", "accel_lat")
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
    )
    coefficient: float

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) +c*a_y on the left pair, -c*a_y on the right pair."""
        sign = np.where(IS_LEFT, 1.0, -1.0)
        return self.coefficient * motion.accel_lat_mps2[:, None] * sign
