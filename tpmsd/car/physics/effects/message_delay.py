"""The wheels of one message are older than those of another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import IS_FRONT, WHEELS, FloatArray

MIN_MPS = 1.0
"""Below, the share is that at this speed."""
BURST_S = 1e-3
"""Up to this age it is usual: wheels that were read at once are sent in two frames, stamped one after the
other (0.25 ms at 500 kbit/s, more behind frames of higher priority)."""


@dataclass(frozen=True)
class MessageDelay(Effect):
    """The front wheels are `front_s` older than the rear ones: they show the speed of a moment ago.

    Source: shown speed v(t - d) = v - d * a to first order; messages of 10 to 50 ms that are sent in turn.
    """

    name = "message_delay"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="front wheels show v(t - front_s)",
        sentence="the wheels of one message are older than those of another",
        noun="wheels of unequal age",
        answers=(
            "the front wheels' readings are {front_s:size ms} {front_s:older|younger} than the rear ones",
        ),
        distinguished_by="accelerate and brake firmly on a straight, ten times",
    )
    identification = Identification(
        shows_in=("wheel_ratio", "accel_long"),
        # With slopes from heights, drive force is too uncertain to be distinguished from a delay.
        needs=("accelerometer",),
        contrast=True,
    )
    parameters = (
        Parameter(
            "front_s",
            "s",
            0.02,
            -1.0,
            1.0,
            "age of the front wheels beyond that of the rear ones",
            probe=0.001,
            prior=Prior(0.0, 0.015, "messages of 10 to 50 ms, sent in turn"),
            fitted=(-0.05, 0.05),  # no longer than a period
        ),
    )
    front_s: float

    @classmethod
    def acting_wheels(cls, car: Car, fitted: tuple[str, ...]) -> tuple[str, ...]:
        """Return the front wheels."""
        return WHEELS[:2]

    @classmethod
    def tolerance_note(cls, value: float, std: float, speeds: bool) -> str:
        """Return the note on two frames of one reading (`BURST_S`); empty where it is plainly beyond."""
        if abs(value) - 2.0 * std > BURST_S:
            return ""
        return (
            f"the front wheels' frames are {value * 1e3:.2f} +- {std * 1e3:.2f} ms older than the rear ones';"
            " taken into account"
        )

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) -front_s * a / v on the front wheels, by the kinematic acceleration."""
        share = -self.front_s * motion.accel_long_mps2 / np.maximum(motion.speed_mps, MIN_MPS)
        return share[:, None] * IS_FRONT.astype(np.float64)
