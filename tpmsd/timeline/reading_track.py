"""The readings of one signal other than the wheels', averaged over ticks.

In: times and values. Out: a mean per tick. The last reading is held for a while where none falls into a tick.
"""

from __future__ import annotations

import math
from bisect import bisect_right


class ReadingTrack:
    """Readings that no tick has used yet, by time."""

    def __init__(self, hold_s: float) -> None:
        """`hold_s`: for how long the last reading stands for those that do not come."""
        self._hold_s = hold_s
        self._times: list[float] = []
        self._values: list[float] = []
        self._held_s, self._held = -math.inf, math.nan

    def add(self, time_s: float, value: float) -> None:
        """Take a reading."""
        times = self._times
        if not times or time_s >= times[-1]:
            times.append(time_s)
            self._values.append(value)
        else:  # of before a step of the clock
            place = bisect_right(times, time_s)
            times.insert(place, time_s)
            self._values.insert(place, value)

    def extend(self, times_s: list[float], values: list[float]) -> None:
        """Take readings in the order of their times."""
        if self._times and times_s[0] < self._times[-1]:
            for time_s, value in zip(times_s, values, strict=True):
                self.add(time_s, value)
        else:
            self._times += times_s
            self._values += values

    def clear(self) -> None:
        """Drop what no tick has used."""
        self._times.clear()
        self._values.clear()

    def mean_to(self, end_s: float) -> float:
        """Mean of the readings up to a tick's end, which are used up; NaN where there are none to be had."""
        count = bisect_right(self._times, end_s)
        if count:
            values = self._values[:count]
            del self._times[:count], self._values[:count]
            self._held_s, self._held = end_s, values[-1]
            return sum(values) / count
        return self._held if end_s - self._held_s <= self._hold_s else math.nan
