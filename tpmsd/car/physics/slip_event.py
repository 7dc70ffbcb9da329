"""Common part of effects that are a slip of some wheels within a time span.

In: wheels, slip, onset and duration of an effect. Out: the slip of each wheel over a motion.
"""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.effect import Effect
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.physics.spans import wheel_mask, within
from tpmsd.foundation.wheels import FloatArray

MIN_SLIP = 0.003
"""Slip below which a tyre creeps on a dry road under ordinary force (F_x/F_z of 0.05 is 0.0023)."""
SHORTEST_S, LONGEST_S = 2.0, 120.0
"""Two windows, and a long stretch of ice: what lasts longer is a changed tyre or a warm brake."""


@dataclass(frozen=True)
class SlipEvent(Effect):
    """Wheels that slip by a constant share within a time span; an effect says the sign and when it fits."""

    stays = "it belongs to the drive on which it was found"
    wheels: str
    slip: float
    onset_s: float
    duration_s: float

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) the slip on its wheels within its span, zero elsewhere."""
        share = within(motion.time_s, self.onset_s, self.duration_s)
        return self.slip * share[:, None] * wheel_mask(self.wheels)
