"""The road falls to the side: a bank in bends, a crown on the straight."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Parameter, Prior
from tpmsd.car.physics.effect_records import Identification, Wording
from tpmsd.car.physics.motion import GRAVITY_MPS2, Car, Motion
from tpmsd.foundation.wheels import FloatArray

TOLERANCE = 0.12
"""Share of the lateral acceleration up to which it is usual: flat bends, and a body that rolls by 7 degrees
per g outwards."""


@dataclass(frozen=True)
class RoadBank(Effect):
    """The accelerometer to the left reads a_y * (1 - bank_share) + g * sin(crown_rad).

    In a banked bend gravity bears bank_share of a_y, and the tyres carry the rest; crown_rad is positive
    where the left side is higher. A body that rolls outwards reads as a negative share, a crown as a constant
    of the sensor; what the bank takes off the outer wheels is in the coefficient of their load. Source: a
    superelevation of 4 to 8 % in bends driven at 2 to 3 m/s2, a crown of 1.5 to 2.5 % (AASHTO, A Policy on
    Geometric Design of Highways and Streets, 2018, chapters 3 and 4).
    """

    name = "road_bank"
    wording = Wording(
        formula="a_y read = a_y * (1 - bank_share) + g * sin(crown_rad)",
        sentence="the road is banked: gravity bears a share of the force in bends",
        noun="bank of the road",
        answers=(
            "the road is banked: gravity bears {bank_share:%} of the force in bends",
            "the road is banked by {crown_rad:size deg} to the {crown_rad:right|left}",
        ),
        distinguished_by="drive the same bends at two speeds, and flat ones",
    )
    identification = Identification(shows_in=("accel_lat", "accel_lat"), reads=("accel_lat",))
    stays = "it belongs to the road"
    parameters = (
        Parameter(
            "bank_share",
            "1",
            0.25,
            -0.5,
            1.0,
            "share of the lateral acceleration that gravity bears",
            probe=0.1,
            prior=Prior(0.1, 0.15, "4 to 8 % in bends of 2 to 3 m/s2: AASHTO 2018, ch. 3"),
        ),
        Parameter(
            "crown_rad",
            "rad",
            0.02,
            -0.3,
            0.3,
            "constant cross slope, left side up",
            prior=Prior(0.02, 0.005, "1.5 to 2.5 %: AASHTO 2018, ch. 4"),
        ),
    )
    bank_share: float = 0.0
    crown_rad: float = 0.0

    @classmethod
    def tolerance_note(cls, value: float, std: float, speeds: bool) -> str:
        """Return the note on a share that roll or the sensor's scale may make; empty for a larger one."""
        if abs(value) - 2.0 * std > TOLERANCE:
            return ""
        return f"a share of {value:.2f} +- {std:.2f} of the lateral acceleration is not read; bodies roll so"

    def accel_error_mps2(self, motion: Motion, car: Car) -> FloatArray:
        """Return (n, 2) errors forward, 0, and to the left, g sin(crown) - bank_share * a_y, in m/s2."""
        out = np.zeros((len(motion), 2))
        out[:, 1] = GRAVITY_MPS2 * math.sin(self.crown_rad) - self.bank_share * motion.accel_lat_mps2
        return out
