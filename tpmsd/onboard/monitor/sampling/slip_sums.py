"""Regression of slips on accelerations, window by window.

In: points of a window. Out: `SlopeSums`, which add up, and the `Slope` that they give.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import NamedTuple

from tpmsd.car.physics.priors import DRIVE_SLIP_S2PM
from tpmsd.onboard.monitor.settings import SLIP_SLOPE

MAX_SLIP_S2PM = DRIVE_SLIP_S2PM.mean + DRIVE_SLIP_S2PM.std
"""Per m/s2, of most cars on a dry road."""


class SlipSecond(NamedTuple):
    """Longitudinal acceleration and slip of the driven wheels (1), means over one second."""

    accel_mps2: float
    slip: float
    aged: float = 0.0
    """Slip per second of the receiver's age: acceleration over speed, 1/s; 0 without a receiver."""


class Slope(NamedTuple):
    """Slip per acceleration (s2/m) with its variance, from sums over windows of driving."""

    slip_s2pm: float
    """Slip per m/s2, and ..."""
    variance: float
    per_age: float = 0.0
    """... by how much a second of the receiver's age adds to it."""


@dataclass(frozen=True, slots=True)
class SlopeSums:
    """Sums of squares about each window's mean; windows add up."""

    freedom: int = 0
    """Seconds less one for each window."""
    accel2: float = 0.0
    """Sum of squared accelerations, (m/s2)2."""
    both: float = 0.0
    """Sum of accelerations times slips, m/s2."""
    slip2: float = 0.0
    """Sum of squared slips."""
    aged: float = 0.0
    """Sum of accelerations times slips per second of age, m/s3."""

    @classmethod
    def from_points(cls, points: Sequence[SlipSecond]) -> SlopeSums:
        """Return the sums of one window; zeros for fewer than two points."""
        if len(points) < 2:
            return cls()
        mean = [sum(values) / len(points) for values in zip(*points, strict=True)]
        apart = [(x - mean[0], y - mean[1], z - mean[2]) for x, y, z in points]
        return cls(
            len(points) - 1,
            sum(x * x for x, _, _ in apart),
            sum(x * y for x, y, _ in apart),
            sum(y * y for _, y, _ in apart),
            sum(x * z for x, _, z in apart),
        )

    def __add__(self, other: SlopeSums) -> SlopeSums:
        return SlopeSums(*(one + two for one, two in zip(astuple(self), astuple(other), strict=True)))

    def slope(self) -> Slope | None:
        """Return the slip per acceleration with its variance; None where the car was hardly accelerated."""
        if self.freedom < SLIP_SLOPE.min_seconds or self.accel2 < SLIP_SLOPE.min_accel2:
            return None
        slope = self.both / self.accel2
        noise2 = max(self.slip2 - slope * self.both, 0.0) / (self.freedom - 1)
        # The slope of the road changes within a window, and so does the force at the same acceleration.
        hills2 = (MAX_SLIP_S2PM * SLIP_SLOPE.hill_std_mps2) ** 2 * SLIP_SLOPE.hill_s
        variance = (SLIP_SLOPE.noise_share * noise2 + hills2) / self.accel2
        return Slope(slope, variance, self.aged / self.accel2)
