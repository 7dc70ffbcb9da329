"""The receiver smooths its velocity."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.effect import Effect, Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.first_order import low_passed
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray

TOLERANCE_S, OWN = 0.25, 6.0
"""Up to which time constant smoothing is the receiver's own, and the nats that such a one costs: it can
hardly be distinguished from a lag."""


@dataclass(frozen=True)
class GnssSmoothing(Effect):
    """Speed and course are those of a first-order low-pass: dy/dt = (x - y) / time_constant_s.

    For slow changes that is a lag of the time constant; what tells the two apart is that a low-pass rounds
    the ends of an acceleration and a lag shifts them. Source: velocity filters of receivers that are set up
    for pedestrians or ships, time constants of 0.5 to 3 s (dynamic models in receivers' manuals).
    """

    name = "gnss_smoothing"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="speed and course shown = first-order low-pass of time_constant_s",
        sentence="the receiver smooths its speed and course",
        noun="smoothing in the receiver",
        answers=("the receiver smooths its speed and course over {time_constant_s}",),
        distinguished_by="accelerate and brake as hard as the traffic allows, ten times",
    )
    identification = Identification(shows_in=("gnss_speed", "accel_long"), needs=("gnss_speed",))
    confounding = Confounding(tested_jointly_with=("velocity_lag",))
    one_sign = True
    stays = "what a low-pass took away cannot be given back"
    parameters = (
        Parameter(
            "time_constant_s",
            "s",
            1.0,
            0.0,
            30.0,
            "of the low-pass",
            probe=0.5,
            prior=Prior(0.0, 0.5, "0.5 to 3 s for pedestrians and ships, next to none for cars"),
            fitted=(0.0, 10.0),
        ),
    )
    time_constant_s: float

    @classmethod
    def penalty(cls, value: float) -> float:
        """Return a penalty on a short constant: a lag has the better known name."""
        return OWN if value < TOLERANCE_S else 0.0

    @classmethod
    def tolerance_note(cls, value: float, std: float, speeds: bool) -> str:
        """Return the note on a low-pass as short as receivers have; empty for a longer one."""
        if value - 2.0 * std > TOLERANCE_S:
            return ""
        return f"the receiver smooths its speed over {value:.2f} +- {std:.2f} s; taken into account"

    def gnss_speed_error_mps(self, motion: Motion, car: Car) -> FloatArray:
        """(n,) smoothed minus true speed."""
        return low_passed(motion.speed_mps, motion.time_s, self.time_constant_s) - motion.speed_mps

    def gnss_course_error_rad(self, motion: Motion, car: Car) -> FloatArray:
        """(n,) smoothed minus true course, by that of the body."""
        return low_passed(motion.heading_rad, motion.time_s, self.time_constant_s) - motion.heading_rad
