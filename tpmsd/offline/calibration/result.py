"""Result of a calibration, as records.

In: nothing (plain records). Out: `FittedGeometry`, `WheelResult`, `EstimatedEffect`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tpmsd.foundation.plain import brief


@dataclass(frozen=True, slots=True)
class WheelResult:
    """Rolling radius of one wheel and its standard deviation, m."""

    radius_m: float
    radius_std_m: float

    @property
    def circumference_m(self) -> float:
        """Circumference, m."""
        return 2 * math.pi * self.radius_m

    @property
    def circumference_std_m(self) -> float:
        """Standard deviation of the circumference, m."""
        return 2 * math.pi * self.radius_std_m


@dataclass(frozen=True, slots=True)
class EstimatedEffect:
    """Something else that was estimated too, in SI units."""

    value: float
    std: float
    unit: str


@brief
@dataclass(frozen=True)
class FittedGeometry:
    """Radii and tracks of a car by its drives."""

    method: str
    drives: tuple[str, ...]
    wheels: dict[str, WheelResult]
    """Wheels by the names of `tpmsd.foundation.wheels`; those that were read."""
    difference_std_m: float
    """Standard deviation of rear right minus rear left, which is far better known than either."""
    track_rear_m: float
    track_rear_std_m: float
    track_front_m: float
    track_front_std_m: float
    """NaN where the front wheels were not read, or the method does not give it."""
    reference_speed_mps: float
    """The radii are those at this speed, since tyres grow with it."""
    iterations: int
    stopped_because: str
    pose_error_before_m: float
    pose_error_after_m: float
    effects: dict[str, EstimatedEffect]
    """Effects by the names of the catalogue; those that confound radii and were estimated too."""
    history_m: list[dict[str, float]]
    """Radii after every iteration."""
