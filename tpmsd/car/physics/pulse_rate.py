"""Common part of effects that lose or add pulses at a rate.

In: wheel and rate of an effect. Out: the share of the wheel's pulses over a motion. An effect says the sign.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tpmsd.car.physics.effect import RARE, Effect, Kind, NoiseResemblance, Parameter, Prior, WheelParameter
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.kinematics import wheel_speeds
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.rings.ring import fraction_of_counts, turns_hz
from tpmsd.foundation.wheels import WHEELS, FloatArray

MIN_MPS = 0.5
"""Below, the share of the pulses is that at this speed."""
MAX_SHARE, AT_MPS = 0.1, 20.0
"""Share of its pulses at a speed beyond which a counter is broken: 50 a second of a ring of 48 teeth, 50,000
of an encoder of 40,000 counts."""


def pulse_rate_parameters(description: str) -> tuple[WheelParameter | Parameter, ...]:
    """Return the two parameters: the wheel, and the rate in pulses per second."""
    return (
        WheelParameter(),
        Parameter(
            "rate_per_s",
            "1/s",
            0.5,
            -1e6,
            1e6,
            description,
            probe=0.01,
            prior=Prior(0.0, 0.5, "a counter in order misses none"),
        ),
    )


@dataclass(frozen=True)
class PulseRate(Effect):
    """The counter of one wheel shows pulses more or less than its ring has, at a rate that goes with time."""

    kind = Kind.INSTRUMENT
    wording = Wording(distinguished_by="hold several speeds from 10 to 35 m/s for a minute each")
    identification = Identification(shows_in=("wheel_ratio", "speed"), wheel_patterns=WHEELS)
    confounding = Confounding(resembles=NoiseResemblance.WHEEL)
    one_sign = True
    more: ClassVar[float]
    """Pulses shown for each of the rate: 1 or -1."""
    wheel: str
    rate_per_s: float

    @classmethod
    def limits(cls, car: Car) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of the rate: a share of the pulses that this car's rings make."""
        most = MAX_SHARE * car.teeth_per_rev * turns_hz(AT_MPS, float(np.mean(car.radius_m)))
        return {"rate_per_s": (-most, most)}

    @classmethod
    def penalty(cls, value: float) -> float:
        """Return nats against any rate: a counter in order neither misses nor adds pulses."""
        return RARE + super().penalty(value)

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) share of the pulses on its wheel."""
        wheel = WHEELS.index(self.wheel)
        speed_mps = wheel_speeds(motion.speed_mps, motion.yaw_rate_radps, car.geometry)[:, wheel]
        revolutions_hz: FloatArray = turns_hz(np.maximum(speed_mps, MIN_MPS), car.radius_m[wheel])
        out = np.zeros((len(motion), 4))
        out[:, wheel] = self.more * fraction_of_counts(self.rate_per_s, car.teeth_per_rev, revolutions_hz)
        return out
