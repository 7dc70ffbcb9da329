"""The host's clock runs too fast or too slow, or is set during the drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Identification, Wording
from tpmsd.foundation.wheels import FloatArray

TOLERANCE_RATE = 1.5e-4
"""Up to which a rate is usual: crystals, also cold ones."""


@dataclass(frozen=True)
class ClockDrift(Effect):
    """host clock - UTC = constant + rate * t, and step_s more from at_s on.

    Frames and sentences are stamped by the same clock, so that wheels and fixes keep together: the drift
    shows in the receiver's own UTC alone, and is followed. A step is taken up when it happens.

    Source: crystals keep 2e-5 to 1e-4 over temperature (data sheets); a host that slews its clock onto
    another one reaches 5e-4 (NTP, RFC 5905).
    """

    name = "clock_drift"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="host clock - UTC = constant + rate * t + step_s * (t >= at_s)",
        sentence="the host's clock drifts against UTC",
        noun="drift of the host's clock",
        answers=("the host's clock runs {rate:size ppm} {rate:fast|slow}",),
        distinguished_by="any drive of ten minutes with fixes that carry UTC",
    )
    identification = Identification(shows_in=("clock", "time"), reads=("clock",))
    own_per_drive = True
    stays = "the clock is followed as it drifts"
    parameters = (
        Parameter(
            "rate",
            "1",
            5e-4,
            -0.01,
            0.01,
            "seconds that the host's clock gains per second",
            probe=1e-5,
            prior=Prior(0.0, 5e-5, "crystals, 2e-5 to 1e-4: data sheets"),
        ),
        Parameter("step_s", "s", 1.0, -1e6, 1e6, "by how much the clock is set forward"),
        Parameter("at_s", "s", 300.0, -1e6, 1e6, "when it is set, from the drive's start"),
    )
    rate: float = 0.0
    step_s: float = 0.0
    at_s: float = 0.0

    @classmethod
    def tolerance_note(cls, value: float, std: float, speeds: bool) -> str:
        """Return the note on a rate within the tolerance of crystals; empty for a larger one."""
        if abs(value) - 2.0 * std > TOLERANCE_RATE:
            return ""
        return f"the host's clock gains {1e6 * value:.0f} +- {1e6 * std:.0f} ppm on UTC, as crystals do"

    def clock_error_s(self, time_s: FloatArray) -> FloatArray:
        """(n,) ramp and step."""
        return np.asarray(self.rate * time_s + self.step_s * (time_s >= self.at_s))
