"""A wheel's teeth are unevenly spaced, or their number is wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Kind, Parameter, Prior, WheelParameter
from tpmsd.car.physics.effect_records import Identification, Wording
from tpmsd.car.rings.ring import harmonic_rad
from tpmsd.foundation.wheels import WHEELS, FloatArray

TOLERANCE_RAD = 5e-4
"""Amplitude up to which a ring is usual: 0.025 mm off centre on a ring of 50 mm. Workshop manuals allow a
runout of 0.15 mm, three times that (Chrysler, tone wheel runout)."""


@dataclass(frozen=True)
class ToneRingError(Effect):
    """Either a once-per-revolution error of `amplitude_rad`, or another number of teeth, or both.

    The counter shows theta + amplitude_rad * sin(theta + phase_rad): amplitude and phase are those of the
    first harmonic of the tooth pattern, which an eccentric ring makes (its higher harmonics average out
    between teeth). theta is the wheel's own angle since the counter began. A tooth that is missing or doubled
    makes `teeth_per_rev` differ from the configured number by one; on fine encoders the number may be a
    fraction.
    Source: geometry of an eccentric ring, whose teeth come early on one side and late on the other: 0.1 mm on
    a ring of 50 mm radius is 2e-3 rad.
    """

    name = "tone_ring_error"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="counts = (theta + a * sin(theta + phase)) * teeth / (2 * pi)",
        sentence="a wheel's teeth are unevenly spaced or their number is wrong",
        noun="an uneven ring",
        answers=(
            "the ring of {wheel} is uneven by {amplitude_rad:deg}",
            "the ring of {wheel} has {teeth_per_rev} teeth",
        ),
        distinguished_by="roll at walking pace on a smooth straight for a minute",
    )
    identification = Identification(shows_in=("wheel_ratio", "wheel_angle"), by_teeth=True)
    parameters = (
        WheelParameter(description="which wheel; all of them where it is not given"),
        Parameter(
            "amplitude_rad",
            "rad",
            5e-3,
            -0.5,
            0.5,
            "amplitude of the once-per-revolution error",
            prior=Prior(0.0, 2e-3, "0.1 mm off centre on a ring of 50 mm"),
        ),
        Parameter("teeth_per_rev", "1", 47.0, 1.0, 1e6, "the wheel's true counts per revolution"),
        Parameter("phase_rad", "rad", 0.0, -2 * np.pi, 2 * np.pi, "phase of the once-per-revolution error"),
    )
    wheel: str | None = None
    amplitude_rad: float = 0.0
    teeth_per_rev: float | None = None
    phase_rad: float = 0.0

    @classmethod
    def tolerance_note(cls, value: float, std: float, speeds: bool) -> str:
        """Return the note on a ripple that is usual for rings; empty for a larger one."""
        if abs(value) - 2.0 * std > TOLERANCE_RAD:
            return ""
        return f"uneven by {value:.1e} +- {std:.1e} rad once per revolution, as rings are"

    def tooth_angle_error_rad(self, angle_rad: FloatArray, wheel: int) -> FloatArray:
        """Return the first harmonic on its wheel, zero on the others."""
        if not self._is_on_wheel(wheel):
            return np.zeros_like(angle_rad)
        return harmonic_rad(angle_rad, self.amplitude_rad, self.phase_rad)

    def true_teeth_per_rev(self, wheel: int) -> float | None:
        """Return the wrong wheel's number of teeth, None for the others."""
        return self.teeth_per_rev if self._is_on_wheel(wheel) else None

    def _is_on_wheel(self, wheel: int) -> bool:
        return self.wheel is None or wheel == WHEELS.index(self.wheel)

    def left_in(self) -> str | None:
        """Return the ripple, whose phase is unknown after a restart."""
        if self.amplitude_rad == 0.0:
            return None
        return (
            f"{self.name} of {self.wheel or 'all wheels'}: its ripple stays, for it averages out over a turn"
        )
