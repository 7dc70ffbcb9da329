"""The receiver's speed and course are older than its position."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.effect import Effect, Kind, Parameter
from tpmsd.car.physics.effect_records import Identification, Wording
from tpmsd.car.physics.priors import SPEED_AGE_S

TOLERANCE_S, UNUSUAL_S = 0.05, 0.08
"""Up to the one a lag is usual (every real recording at hand has one of 0.03 to 0.06 s), from the other on it
is not."""
OWN = 6.0
"""Nats by which the usual lag goes before an effect that explains as much, and by which an unusual one stands
behind it: where the positions do not tell, that effect has the better known name."""


@dataclass(frozen=True)
class VelocityLag(Effect):
    """Doppler speed and course are `lag_s` older than the position of the same fix.

    Receivers filter the Doppler, so a lag of some hundredths of a second is their own making: it is taken
    into account and no finding. Source: group delay of a first-order velocity filter, 1 / (2 pi bandwidth),
    16 to 160 ms for 1 to 10 Hz.
    """

    name = "velocity_lag"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="speed and course of t - lag_s stand beside the position of t",
        sentence="the receiver's speed and course are older than its position",
        noun="a lag of the receiver's speed",
        answers=(
            "the receiver's speed and course are {lag_s:size ms} {lag_s:older|younger} than its position",
        ),
        distinguished_by="accelerate and brake firmly on a straight under the open sky, ten times",
    )
    identification = Identification(
        shows_in=("gnss_speed", "accel_long"), needs=("gnss_speed", "gnss_position")
    )
    in_calibration = (("doppler_lag", "lag_s", "s"),)
    parameters = (
        Parameter(
            "lag_s",
            "s",
            0.05,
            -2.0,
            5.0,
            "age of speed and course beyond that of the position",
            probe=0.01,
            prior=SPEED_AGE_S,
            fitted=(-0.2, 1.0),
        ),
    )
    lag_s: float

    @classmethod
    def penalty(cls, value: float) -> float:
        """Return a penalty that rises from the usual lag to an unusual one."""
        beyond = (abs(value) - TOLERANCE_S) / (UNUSUAL_S - TOLERANCE_S)
        return OWN * (2.0 * min(max(beyond, 0.0), 1.0) - 1.0)

    @classmethod
    def tolerance_note(cls, value: float, std: float, speeds: bool) -> str:
        """Return the note on a lag within the tolerance of receivers (`UNUSUAL_S`); empty beyond it."""
        if abs(value) - 2.0 * std > UNUSUAL_S:
            return ""
        return (
            f"the receiver's speed is {value:.3f} +- {std:.3f} s older than its position; taken into account"
        )

    def velocity_age_s(self) -> float:
        """Return the lag."""
        return self.lag_s
