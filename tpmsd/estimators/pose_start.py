"""Where the car is and where it points, from fixes alone: to start the filter and to find it again when lost.

In: fixes. Out: a `PoseStart` once the fixes agree on a heading, either by the receiver's course or by the
chord between two fixes far enough apart.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from tpmsd.timeline.tick import Fix

MIN_COURSE_SPEED_MPS = 3.0
CHORD_IN_STD = 8.0
MIN_CHORD_M = 6.0
MAX_CHORD_S = 20.0


@dataclass(frozen=True, slots=True)
class PoseStart:
    """A pose of the antenna good enough to start particles from."""

    fix: Fix
    heading_rad: float
    heading_std_rad: float


class PoseFinder:
    """Collects fixes until they tell a heading."""

    def __init__(self) -> None:
        self._fixes: deque[Fix] = deque(maxlen=400)

    def reset(self) -> None:
        """Start anew."""
        self._fixes.clear()

    def update(self, fix: Fix, moving: bool) -> PoseStart | None:
        """Take a fix; the pose it completes, or None while the heading is open."""
        if not math.isnan(fix.heading_rad) and fix.speed_mps >= MIN_COURSE_SPEED_MPS:
            return PoseStart(fix, fix.heading_rad, 0.05 + 0.2 / fix.speed_mps)
        while self._fixes and fix.time_s - self._fixes[0].time_s > MAX_CHORD_S:
            self._fixes.popleft()
        if not moving:
            self._fixes.clear()
        for earlier in reversed(self._fixes):
            east, north = fix.east_m - earlier.east_m, fix.north_m - earlier.north_m
            chord = math.hypot(east, north)
            # Within a short chord the correlated part of the error cancels; a third of it is taken as
            # independent.
            noise = 0.1 + 0.33 * math.hypot(fix.position_std_m, earlier.position_std_m)
            if chord > max(MIN_CHORD_M, CHORD_IN_STD * noise):
                # The chord is the mean heading of the way, so a bend leaves a heading error at its end.
                return PoseStart(fix, math.atan2(north, east), noise / chord + 0.15)
        self._fixes.append(fix)
        return None
