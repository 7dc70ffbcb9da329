"""Pose of the car from fixes alone: to start the filter and to find it again when lost.

In: fixes. Out: a `PoseStart` once the fixes agree on a heading, either by the receiver's course or by the
chord between two fixes far enough apart.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Fix


@dataclass(frozen=True, slots=True)
class PoseStart:
    """A pose of the antenna good enough to start particles from."""

    fix: Fix
    heading_rad: float
    heading_std_rad: float


class PoseFinder:
    """Collects fixes until they determine a heading."""

    def __init__(self) -> None:
        self._fixes: deque[Fix] = deque(maxlen=400)

    def reset(self) -> None:
        """Forget all fixes."""
        self._fixes.clear()

    def update(self, fix: Fix, moving: bool) -> PoseStart | None:
        """Update by a fix; return the pose that it completes, or None while the heading is not known.

        `moving`: whether the wheels are faster than `start_speed_mps`.
        """
        if not math.isnan(fix.heading_rad) and fix.speed_mps >= SETTINGS.start_speed_mps:
            at_rest, by_speed = SETTINGS.start_heading_std_rad
            return PoseStart(fix, fix.heading_rad, at_rest + by_speed / fix.speed_mps)
        while self._fixes and fix.time_s - self._fixes[0].time_s > SETTINGS.chord_max_s:
            self._fixes.popleft()
        if not moving:
            self._fixes.clear()
        for earlier in reversed(self._fixes):
            east, north = fix.east_m - earlier.east_m, fix.north_m - earlier.north_m
            chord = math.hypot(east, north)
            # Within a short chord the correlated part of the error cancels; a third of it is taken as
            # independent.
            least, share = SETTINGS.chord_noise_m
            noise = least + share * math.hypot(fix.position_std_m, earlier.position_std_m)
            if chord > max(SETTINGS.chord_min_m, SETTINGS.chord_in_std * noise):
                # The chord is the mean heading of the way, so a bend leaves a heading error at its end.
                return PoseStart(fix, math.atan2(north, east), noise / chord + SETTINGS.chord_bend_rad)
        self._fixes.append(fix)
        return None
