"""A fix is old when it arrives."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.effect import Effect, Kind, Parameter
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.priors import FIX_AGE_S

FRAME_AGE_S = 0.04
"""Longest interval over which control units average wheel speeds before the stamp."""
COUNT_AGE_S = 0.02
"""Greatest age of a count: the slowest usual task of a control unit that reads its counters."""


@dataclass(frozen=True)
class GnssLatency(Effect):
    """Position, speed and course are `latency_s` older than their arrival (beyond what is configured).

    The sentence's own UTC does not show it, since the host clock's offset from UTC is unknown: it is what
    stands between a fix and the CAN frames of the same instant. Source: receivers compute and transmit after
    the epoch, 30 to 300 ms by make, rate and baud.
    """

    name = "gnss_latency"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="position, speed and course of t arrive at t + latency_s",
        sentence="a fix arrives later than it was valid (GNSS latency)",
        noun="age of the fixes",
        answers=("the fixes are {latency_s:size ms} {latency_s:older|younger} than configured",),
        distinguished_by="accelerate and brake firmly on a straight, ten times",
    )
    identification = Identification(shows_in=("gnss_speed", "accel_long"), needs=("gnss",))
    confounding = Confounding(
        tested_jointly_with=("velocity_lag",), estimated_jointly_with=("lateral_slip", "velocity_lag")
    )
    in_calibration = (("latency", "latency_s", "s"),)
    one_sign = True
    parameters = (
        Parameter(
            "latency_s",
            "s",
            0.1,
            -2.0,
            5.0,
            "age of a fix on arrival",
            probe=0.01,
            prior=FIX_AGE_S,
        ),
    )
    latency_s: float

    def fix_age_s(self) -> float:
        """Return the latency."""
        return self.latency_s

    @classmethod
    def tolerance_note(cls, value: float, std: float, speeds: bool) -> str:
        """Return the note on a negative latency that the usual age of wheel readings explains; else none.

        Speeds are means over an interval before the stamp, counts are those of the last own
        reading.
        """
        usual_s = FRAME_AGE_S if speeds else COUNT_AGE_S
        if -usual_s - 2.0 * std <= value < 0.0:
            return (
                f"the wheels' {'speeds' if speeds else 'counts'} are {-value:.3f} +- {std:.3f} s older than"
                " their stamps; taken into account"
            )
        return ""
