"""Below a speed a counter loses counts: inductive sensors give too little voltage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, GroupParameter, Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.physics.spans import wheel_mask
from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True)
class CounterLostLowSpeed(Effect):
    """Below `below_mps` the counter shows the share 1 - lost of the wheel's turn, above it all of it.

    Source: the voltage of a variable-reluctance sensor goes with the speed of the teeth; trigger levels of
    anti-lock controllers are reached between 0.5 and 1.5 m/s (Bosch
    Automotive Handbook, wheel-speed sensors).
    """

    name = "counter_lost_low_speed"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="omega shown = omega * (1 - lost) where v < below_mps",
        sentence="counts are lost below a speed",
        noun="counts lost at walking pace",
        answers=("the counters of {wheels} lose {lost:%} of their counts below {below_mps}",),
        distinguished_by="roll at walking pace for a minute, under the open sky",
    )
    identification = Identification(shows_in=("wheel", "speed"), needs=("gnss_speed",), at_walking_pace=True)
    stays = "what was not counted cannot be put back"
    parameters = (
        GroupParameter("wheels", "all", "wheels that lose counts: their names, or all"),
        Parameter(
            "below_mps",
            "m/s",
            1.5,
            0.1,
            10.0,
            "speed below which counts are lost",
            prior=Prior(1.0, 0.7, "trigger levels reached between 0.5 and 1.5 m/s"),
        ),
        Parameter(
            "lost", "1", 1.0, 0.0, 1.0, "share of the counts", prior=Prior(1.0, 0.3, "no trigger, no count")
        ),
    )
    wheels: str
    below_mps: float
    lost: float = 1.0

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) minus the lost share on its wheels below the speed, zero above."""
        slow = (motion.speed_mps < self.below_mps).astype(np.float64)
        return -self.lost * slow[:, None] * wheel_mask(self.wheels)
