"""One wheel's angle as a function of time, from readings that come when they come.

In: `RotationSample`s. Out: the angle at any instant between two readings, and so the rotation in a tick.
Wheels whose messages have other periods and phases meet here: each is interpolated to the same instants, and
because the angles are exact, rotations of adjoining ticks add up to the counter's own difference.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from tpmsd.sources.events import RotationSample

MAX_BRIDGE_S = 0.6
"""Readings further apart than this are not interpolated between."""


class RotationTrack:
    """Recent readings of one wheel."""

    def __init__(self) -> None:
        self._samples: deque[RotationSample] = deque()

    def add(self, sample: RotationSample) -> None:
        """Take a reading; readings that are not newer than the last are left out."""
        if self._samples and sample.time_s <= self._samples[-1].time_s:
            return
        self._samples.append(sample)

    def extend(self, samples: Sequence[RotationSample]) -> None:
        """Take readings, each newer than the one before it."""
        if samples and self._samples and samples[0].time_s <= self._samples[-1].time_s:
            for sample in samples:
                self.add(sample)
        else:
            self._samples.extend(samples)

    def forget_before(self, time_s: float) -> None:
        """Drop readings no longer needed to interpolate at `time_s` or later."""
        while len(self._samples) > 2 and self._samples[1].time_s < time_s:
            self._samples.popleft()

    def clear(self) -> None:
        """Drop all."""
        self._samples.clear()

    def at(self, time_s: float) -> tuple[float, int, float] | None:
        """(angle, segment, quantum) at an instant, or None where no two readings of one segment enclose
        it."""
        before: RotationSample | None = None
        for sample in self._samples:
            if sample.time_s >= time_s:
                if sample.time_s == time_s:
                    return sample.angle_rad, sample.segment, sample.quantum_rad
                if before is None or before.segment != sample.segment:
                    return None
                span = sample.time_s - before.time_s
                if span > MAX_BRIDGE_S:
                    return None
                share = (time_s - before.time_s) / span
                angle = before.angle_rad + share * (sample.angle_rad - before.angle_rad)
                return angle, sample.segment, sample.quantum_rad
            before = sample
        return None


def rotation_between(track: RotationTrack, begin_s: float, end_s: float) -> tuple[float, float]:
    """(rotation, its reading error's standard deviation) over an interval; NaNs where it is not known.

    A count is uniform within its quantum at both ends: variance 2 * q^2 / 12.
    """
    begin, end = track.at(begin_s), track.at(end_s)
    if begin is None or end is None or begin[1] != end[1]:
        return math.nan, math.nan
    return end[0] - begin[0], end[2] / math.sqrt(6.0)
