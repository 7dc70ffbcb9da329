"""The readings of one signal other than the wheels', averaged over ticks.

In: times and values. Out: a mean per tick. The last reading is held for a while where none falls into a tick.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray


class Means(NamedTuple):
    """Means of one signal in n ticks; as `take_mean` gives them one by one."""

    value: FloatArray
    """(n,)"""
    needs: NDArray[np.intp]
    """(n,) how many of the further readings have to be there for it."""


class ReadingTrack:
    """Readings that no tick has used yet, by time."""

    def __init__(self, hold_s: float) -> None:
        """`hold_s`: for how long the last reading stands for those that do not come."""
        self._hold_s = hold_s
        self._times: list[float] = []
        self._values: list[float] = []
        self._held_s, self._held = -math.inf, math.nan

    def add(self, time_s: float, value: float) -> None:
        """Insert a reading in the order of the times."""
        index = bisect_right(self._times, time_s)  # the last, but for those of before a step of the clock
        self._times.insert(index, time_s)
        self._values.insert(index, value)

    def extend(self, times_s: list[float], values: list[float]) -> None:
        """Add readings whose times rise; they may begin before the latest one."""
        if self._times and times_s[0] < self._times[-1]:
            for time_s, value in zip(times_s, values, strict=True):
                self.add(time_s, value)
        else:
            self._times += times_s
            self._values += values

    def clear(self) -> None:
        """Drop the readings that no tick has used."""
        self._times.clear()
        self._values.clear()

    def take_mean(self, end_s: float) -> float:
        """Return the mean of the readings up to a tick's end and drop them; without any the last one while it
        is held, then NaN."""
        count = bisect_right(self._times, end_s)
        if count:
            values, total = self._values[:count], 0.0
            del self._times[:count], self._values[:count]
            self._held_s, self._held = end_s, values[-1]
            for value in values:  # `sum` rounds otherwise from Python 3.12 on
                total += value
            return total / count
        return self._held if end_s - self._held_s <= self._hold_s else math.nan

    def means_ahead(self, time_s: FloatArray, values: FloatArray, ends_s: FloatArray) -> Means | None:
        """Return the means that `take_mean` will return for the next ticks, of ends (n,), once these further
        readings (m,) are added; None where they are not in the order of their times."""
        times = np.concatenate([self._times, time_s])
        if not (times[1:] >= times[:-1]).all():
            return None
        all_values = np.concatenate([self._values, values])
        used = times.searchsorted(ends_s, side="right")
        count = np.diff(used, prepend=0)
        tick = np.repeat(np.arange(len(ends_s)), count)
        total = np.bincount(tick, weights=all_values[: used[-1]], minlength=len(ends_s))
        last = np.maximum.accumulate(np.where(count > 0, np.arange(len(ends_s)), -1))
        held_s = np.append(ends_s, self._held_s)[last]
        held = np.append(all_values, self._held)[np.where(last < 0, -1, used[last] - 1)]
        held = np.where(ends_s - held_s <= self._hold_s, held, math.nan)
        mean = np.where(count > 0, total / np.maximum(count, 1), held)
        return Means(mean, np.maximum(used - len(self._times), 0))

    def drop_used(self, ends_s: list[float]) -> None:
        """Drop the readings of ticks, given by their ends in order, that were planned by `means_ahead`; hold
        the last."""
        count = bisect_right(self._times, ends_s[-1])
        if count:
            self._held_s = ends_s[bisect_left(ends_s, self._times[count - 1])]
            self._held = self._values[count - 1]
            del self._times[:count], self._values[:count]
