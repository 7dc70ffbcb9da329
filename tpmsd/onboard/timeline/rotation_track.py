"""One wheel's angle as a function of time, from readings that come when they come.

In: `RotationSample`s. Out: the angle at any instant between two readings, and so the rotation in a tick.
Wheels whose messages have other periods and phases meet here: each is interpolated to the same instants, and
because the angles are exact, rotations of adjoining ticks add up to the counter's own difference.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.sources.events import RotationRun, RotationSample

MAX_BRIDGE_S = 0.6
"""Readings further apart than this are not interpolated between."""


Instant = tuple[float, int, float]
"""Angle (rad), segment and quantum (rad) at an instant."""


class Rotations(NamedTuple):
    """Rotations of one wheel in n intervals that follow each other; as `rotation_between` gives them one by
    one."""

    rotation_rad: FloatArray
    """(n,) NaN where it is not known."""
    std_rad: FloatArray
    """(n,)"""
    needs: NDArray[np.intp]
    """(n,) how many of the further readings have to be there for it."""


class RotationTrack:
    """Recent readings of one wheel."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._angles: list[float] = []
        self._marks: list[tuple[int, float]] = []
        """Segment and quantum of each."""
        self._found: tuple[float, Instant] | None = None
        """Rotation at the instant that was last asked for: a tick begins where the one before ended."""

    def add(self, sample: RotationSample) -> None:
        """Add a reading; one that is not newer than the last is left out."""
        self._add(sample.time_s, sample.angle_rad, (sample.segment, sample.quantum_rad))

    def _add(self, time_s: float, angle_rad: float, mark: tuple[int, float]) -> None:
        if self._times and time_s <= self._times[-1]:
            return
        self._times.append(time_s)
        self._angles.append(angle_rad)
        self._marks.append(mark)

    def extend(self, run: RotationRun) -> None:
        """Add readings of one run; those that are not newer than the last are left out."""
        mark = (run.segment, run.quantum_rad)
        if run.time_s and self._times and run.time_s[0] <= self._times[-1]:
            for time_s, angle_rad in zip(run.time_s, run.angle_rad, strict=True):
                self._add(time_s, angle_rad, mark)
        else:
            self._times += run.time_s
            self._angles += run.angle_rad
            self._marks += [mark] * len(run.time_s)

    def forget_before(self, time_s: float) -> None:
        """Drop readings no longer needed to interpolate at `time_s` or later."""
        older = min(bisect_left(self._times, time_s) - 1, len(self._times) - 2)
        if older > 0:
            del self._times[:older], self._angles[:older], self._marks[:older]

    def clear(self) -> None:
        """Drop all readings."""
        self._times.clear()
        self._angles.clear()
        self._marks.clear()
        self._found = None

    def angle_at(self, time_s: float) -> Instant | None:
        """Return angle, segment and quantum at an instant; None where no two readings of one segment enclose
        it closely."""
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

    @property
    def is_empty(self) -> bool:
        """True if there is no reading."""
        return not self._times

    def rotations_ahead(
        self, time_s: FloatArray, angle_rad: FloatArray, segment: int, quantum_rad: float, edges_s: FloatArray
    ) -> Rotations | None:
        """Return the rotations that `rotation_between` will return between rising instants (n + 1,) once
        these further readings (m,) of one segment are added; fewer where readings end before, None where it
        would be none or some readings would be left out."""
        times = np.concatenate([self._times, time_s])
        if not (times[1:] > times[:-1]).all():
            return None
        after = times.searchsorted(edges_s)
        after = after[: int(after.searchsorted(len(times)))]
        if len(after) < 2:
            return None
        angles, edges_s = np.concatenate([self._angles, angle_rad]), edges_s[: len(after)]
        segments = np.concatenate([[mark[0] for mark in self._marks], np.full(len(time_s), segment)])
        quanta = np.concatenate([[mark[1] for mark in self._marks], np.full(len(time_s), quantum_rad)])
        before = after - 1  # of the first reading it is the last: of no account, as `after` is 0
        there_s, before_s, before_rad = times[after], times[before], angles[before]
        span_s = there_s - before_s
        exact = there_s == edges_s
        with np.errstate(divide="ignore", invalid="ignore"):
            between = before_rad + (edges_s - before_s) / span_s * (angles[after] - before_rad)
        known = exact | ((after > 0) & (segments[after] == segments[before]) & (span_s <= MAX_BRIDGE_S))
        at_edge = np.where(exact, angles[after], between)
        known = known[1:] & known[:-1] & (segments[after[1:]] == segments[after[:-1]])
        return Rotations(
            np.where(known, at_edge[1:] - at_edge[:-1], math.nan),
            np.where(known, quanta[after[1:]] / math.sqrt(6.0), math.nan),
            after[1:] + 1 - len(self._times),
        )


def rotation_between(track: RotationTrack, begin_s: float, end_s: float) -> tuple[float, float]:
    """Return (rotation, its reading error's standard deviation) over an interval; NaNs where it is not known.

    A count is uniform within its quantum at both ends: variance 2 * q^2 / 12.
    """
    begin, end = track.angle_at(begin_s), track.angle_at(end_s)
    if begin is None or end is None or begin[1] != end[1]:
        return math.nan, math.nan
    return end[0] - begin[0], end[2] / math.sqrt(6.0)
