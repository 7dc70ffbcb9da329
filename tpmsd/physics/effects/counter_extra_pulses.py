"""A wheel's counter adds pulses at a rate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tpmsd.physics.effect import Effect, Kind, Parameter, Prior, WheelParameter
from tpmsd.physics.motion import Car, Motion
from tpmsd.wheels import WHEELS, FloatArray

LEAST_MPS = 0.5
"""Below, the share of the pulses is that at this speed."""


@dataclass(frozen=True)
class CounterExtraPulses(Effect):
    """The counter of one wheel adds `rate_per_s` pulses a second, so that it shows more than the wheel turns
    by a share that falls with speed, as one over it.

    Source: counting; a disturbance that goes with time and not with the wheel, such as ignition or a loose
    contact.
    """

    name: ClassVar[str] = "counter_extra_pulses"
    kind: ClassVar[Kind] = Kind.INSTRUMENT
    formula: ClassVar[str] = "omega shown = omega + 2 * pi * rate_per_s / teeth on one wheel"
    sentence: ClassVar[str] = "a wheel's counter adds pulses"
    telling_drive: ClassVar[str] = "hold several speeds from 10 to 35 m/s for a minute each"
    shows_in: ClassVar[tuple[str, str]] = ("wheel_ratio", "speed")
    one_sign: ClassVar[bool] = True
    places: ClassVar[tuple[str, ...]] = WHEELS
    mirror_of: ClassVar[str] = "counter_missed_pulses"
    parameters: ClassVar[tuple[WheelParameter | Parameter, ...]] = (
        WheelParameter(),
        Parameter(
            "rate_per_s",
            "1/s",
            0.5,
            -100.0,
            100.0,
            "pulses added per second",
            probe=0.01,
            prior=Prior(0.0, 0.5, "a counter in order misses none"),
        ),
    )
    wheel: str
    rate_per_s: float

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) share of the pulses on its wheel, positive."""
        wheel = WHEELS.index(self.wheel)
        turns_per_s = np.maximum(motion.speed_mps, LEAST_MPS) / (2.0 * np.pi * car.radius_m[wheel])
        out = np.zeros((len(motion), 4))
        out[:, wheel] = self.rate_per_s / (car.teeth_per_rev * turns_per_s)
        return out
