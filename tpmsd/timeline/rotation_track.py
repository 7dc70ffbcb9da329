"""One wheel's angle as a function of time, from readings that come when they come.

In: `RotationSample`s. Out: the angle at any instant between two readings, and so the rotation in a tick.
Wheels whose messages have other periods and phases meet here: each is interpolated to the same instants, and
because the angles are exact, rotations of adjoining ticks add up to the counter's own difference.
"""

from __future__ import annotations

import math
from bisect import bisect_left

from tpmsd.sources.events import RotationSample

MAX_BRIDGE_S = 0.6
"""Readings further apart than this are not interpolated between."""


Instant = tuple[float, int, float]
"""Angle (rad), segment and quantum (rad) at an instant."""


class RotationTrack:
    """Recent readings of one wheel."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._angles: list[float] = []
        self._marks: list[tuple[int, float]] = []
        """Segment and quantum of each."""
        self._found: tuple[float, Instant] | None = None
        """What was asked for last: a tick begins where the one before ended."""

    def add(self, sample: RotationSample) -> None:
        """Take a reading; readings that are not newer than the last are left out."""
        self._add(sample.time_s, sample.angle_rad, (sample.segment, sample.quantum_rad))

    def _add(self, time_s: float, angle_rad: float, mark: tuple[int, float]) -> None:
        if self._times and time_s <= self._times[-1]:
            return
        self._times.append(time_s)
        self._angles.append(angle_rad)
        self._marks.append(mark)

    def extend(self, times_s: list[float], angles_rad: list[float], segment: int, quantum_rad: float) -> None:
        """Take readings of one segment, each newer than the one before it."""
        mark = (segment, quantum_rad)
        if times_s and self._times and times_s[0] <= self._times[-1]:
            for time_s, angle_rad in zip(times_s, angles_rad, strict=True):
                self._add(time_s, angle_rad, mark)
        else:
            self._times += times_s
            self._angles += angles_rad
            self._marks += [mark] * len(times_s)

    def forget_before(self, time_s: float) -> None:
        """Drop readings no longer needed to interpolate at `time_s` or later."""
        older = min(bisect_left(self._times, time_s) - 1, len(self._times) - 2)
        if older > 0:
            del self._times[:older], self._angles[:older], self._marks[:older]

    def clear(self) -> None:
        """Drop all."""
        self._times.clear()
        self._angles.clear()
        self._marks.clear()
        self._found = None

    def at(self, time_s: float) -> Instant | None:
        """What is known at an instant, or None where no two readings of one segment enclose it."""
        if self._found is not None and self._found[0] == time_s:
            return self._found[1]
        after = bisect_left(self._times, time_s)
        if after == len(self._times):
            return None
        segment, quantum = self._marks[after]
        there_s, angle = self._times[after], self._angles[after]
        if there_s != time_s:
            if after == 0 or self._marks[after - 1][0] != segment:
                return None
            before_s = self._times[after - 1]
            span = there_s - before_s
            if span > MAX_BRIDGE_S:
                return None
            before = self._angles[after - 1]
            angle = before + (time_s - before_s) / span * (angle - before)
        # Later readings are newer: they change nothing of it.
        self._found = time_s, (angle, segment, quantum)
        return self._found[1]


def rotation_between(track: RotationTrack, begin_s: float, end_s: float) -> tuple[float, float]:
    """(rotation, its reading error's standard deviation) over an interval; NaNs where it is not known.

    A count is uniform within its quantum at both ends: variance 2 * q^2 / 12.
    """
    begin, end = track.at(begin_s), track.at(end_s)
    if begin is None or end is None or begin[1] != end[1]:
        return math.nan, math.nan
    return end[0] - begin[0], end[2] / math.sqrt(6.0)
