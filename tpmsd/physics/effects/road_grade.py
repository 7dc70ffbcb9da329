"""Slopes: the wheels roll along them, the receiver reports the horizontal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tpmsd.physics.effect import Effect
from tpmsd.physics.motion import Motion
from tpmsd.wheels import FloatArray


@dataclass(frozen=True)
class RoadGrade(Effect):
    """Horizontal distance = cos(grade) times the distance rolled; no parameters.

    Source: geometry. NMEA's RMC speed and position are horizontal. 5 % of slope shortens by 0.125 %, which
    looks like 0.4 mm of radius.
    """

    name: ClassVar[str] = "road_grade"

    def horizontal_factor(self, motion: Motion) -> FloatArray:
        """(n,) cos(grade)."""
        return np.asarray(np.cos(motion.grade_rad))
