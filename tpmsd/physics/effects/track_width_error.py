"""The wheels of an axle are not as far apart as the configuration says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from tpmsd.physics.effect import Effect, Parameter


@dataclass(frozen=True)
class TrackWidthError(Effect):
    """True track minus configured one, at the rear and at the front.

    The wheels' speeds are v -+ yaw rate * track / 2, so the error shows in proportion to the yaw rate.
    Source: paper 000, eq. (6); other rims or spacers change a track by 10 to 60 mm.
    """

    name: ClassVar[str] = "track_width_error"
    sentence: ClassVar[str] = "the track differs from the configured one"
    telling_drive: ClassVar[str] = "drive full circles slowly, to both sides: load transfer is small there"
    shows_in: ClassVar[tuple[str, str]] = ("wheel_ratio", "yaw_rate")
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("rear_m", "m", 0.03, -0.5, 0.5, "rear track, true minus configured", probe=1e-3),
        Parameter("front_m", "m", 0.03, -0.5, 0.5, "front track, true minus configured", probe=1e-3),
    )
    rear_m: float = 0.0
    front_m: float = 0.0

    def track_error_m(self) -> tuple[float, float]:
        """(front, rear), in the order of the wheels."""
        return self.front_m, self.rear_m
