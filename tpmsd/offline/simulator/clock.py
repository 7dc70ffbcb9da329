"""The clocks of a simulated drive.

In: seconds since the drive's start. Out: UTC, or the host's clock, which is off from UTC and drifts.
"""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.foundation.wheels import FloatArray

DEFAULT_START_UTC_S = 1_719_820_800.0
"""2024-07-01 08:00:00 UTC."""


@dataclass(frozen=True, slots=True)
class Clocks:
    """Host clock = UTC + host_offset_s + drift * time since the start."""

    start_utc_s: float = DEFAULT_START_UTC_S
    host_offset_s: float = 0.0
    host_drift_ppm: float = 0.0

    def utc_s(self, time_s: FloatArray) -> FloatArray:
        """Return the UTC of times since the start."""
        return self.start_utc_s + time_s

    def host_s(self, time_s: FloatArray) -> FloatArray:
        """Return the host clock at times since the start."""
        return self.start_utc_s + self.host_offset_s + time_s * (1.0 + 1e-6 * self.host_drift_ppm)
