"""Signals of a car as arrays in SI units, from which a drive of tables is made.

In: nothing (plain records). Out: `Signals`, `Fixes`. Each signal has its own times, on one clock.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True)
class SignalReadings:
    """One signal: n readings; those that are NaN were not made."""

    time_s: FloatArray
    value: FloatArray

    def finite(self) -> SignalReadings:
        """Return the series without the readings that are not finite."""
        known = np.isfinite(self.value) & np.isfinite(self.time_s)
        return SignalReadings(self.time_s[known], self.value[known])


@dataclass(frozen=True)
class Fixes:
    """m fixes, (m,) each; NaN where the receiver said nothing."""

    arrival_s: FloatArray
    """Arrival on the clock of the wheels, s."""
    utc_s: FloatArray
    """The receiver's time of validity, Unix seconds."""
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    altitude_m: FloatArray
    position_std_m: FloatArray
    speed_mps: FloatArray
    course_rad: FloatArray
    """Clockwise from true north."""
    quality: FloatArray
    hdop: FloatArray

    def __len__(self) -> int:
        return len(self.arrival_s)


@dataclass(frozen=True)
class Signals:
    """Signals that a table holds of a drive."""

    angles: dict[str, SignalReadings] = field(default_factory=dict)
    """Wheel -> angle turned, rad."""
    counts: dict[str, SignalReadings] = field(default_factory=dict)
    """Wheel -> counts that rise without rolling over. Either these or the angles."""
    counts_per_rev: float | None = None
    """Counts per revolution of angles that were counted, so that they are weighted as such; None where they
    are exact."""
    inertial: dict[str, SignalReadings] = field(default_factory=dict)
    """Role of an optional signal -> its values."""
    fixes: Fixes | None = None
