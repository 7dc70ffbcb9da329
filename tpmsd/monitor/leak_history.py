"""Days of one set of tyres: the contrasts of its radii, bounded in number and in age.

In: per drive the contrasts of `leak_state` with their variances. Out: a `Trend`. Drives of one day are one
reading: load and weather are the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from tpmsd.bounds import number, whole
from tpmsd.monitor.leak_filter import LeakFilter
from tpmsd.monitor.leak_settings import TrendSettings
from tpmsd.monitor.leak_trend import Trend, has_ended, trend_of
from tpmsd.monitor.settings import READINGS, TREND
from tpmsd.wheels import FloatArray

Three = tuple[float, float, float]
_BEFORE = 7
"""Values of a saved day that has no front against rear (states of earlier versions)."""


@dataclass(frozen=True, slots=True)
class Day:
    """One day's drives."""

    day: float
    """Days since the epoch of the host's clock."""
    difference_m: Three
    """Left minus right of the front and of the rear axle, front minus rear; NaN where it is not known."""
    variance_m2: Three
    drives: int = 1
    known_step: bool = False
    """Whether the driver asked for a reset before it."""


class LeakHistory:
    """The days of one set of tyres."""

    def __init__(self, settings: TrendSettings = TREND) -> None:
        self._settings = settings
        self.days: list[Day] = []
        self._filters: dict[Three, LeakFilter] = {}
        """By metres per per cent, of all days but the last; after a restart made from `days`."""
        self._step_next = False

    def add(self, day: float, difference_m: FloatArray, variance_m2: FloatArray) -> bool:
        """Take the reading of one drive, (3,) each; whether it was taken."""
        last = self.days[-1].day if self.days else day
        if day < last and last - day <= READINGS.stepped_back_d and math.floor(day) != math.floor(last):
            return False
        if day - last > READINGS.longest_gap_d or (day < last and math.floor(day) != math.floor(last)):
            self.days.clear()
            self._filters.clear()
        one = Day(
            day,
            _three(difference_m),
            _three(variance_m2),
            known_step=self._step_next,
        )
        same = bool(self.days) and math.floor(self.days[-1].day) == math.floor(day)
        if same and not self._step_next:
            self.days[-1] = _merged(self.days[-1], one)
        else:
            # A clock that was set back within the day does not turn the order of its readings.
            self.days.append(replace(one, day=max(day, last)) if same else one)
        self._step_next = False
        self.days = [d for d in self.days if day - d.day <= READINGS.oldest_d][-READINGS.most_days :]
        return True

    def mark_step(self) -> None:
        """The driver asked for a reset: levels may change here, rates go on."""
        self._step_next = bool(self.days)

    def forget_before(self, day: float) -> None:
        """What was before has been dealt with."""
        self.days = [d for d in self.days if d.day >= day]
        self._filters.clear()

    def trend(self, metres_per_percent: Three) -> Trend | None:
        """The likeliest leak; None with too few days. `metres_per_percent`: of each contrast."""
        if not self.days:
            return None
        past = self._filters.setdefault(metres_per_percent, LeakFilter(self._settings))
        over = -math.inf if past.day is None else past.day
        self._play(past, [d for d in self.days[:-1] if d.day > over], metres_per_percent)
        # The last day may have further drives: it is taken for good when it is over.
        now = past.copy()
        self._play(now, self.days[-1:], metres_per_percent)
        return trend_of(now, self._settings)

    def ended(
        self, metres_per_percent: Three, wheel: int, rate: tuple[float, float], since_day: float
    ) -> bool:
        """Whether the last days, from `since_day` on, speak against a leak of this wheel going on; `rate` and
        its standard deviation in per cent per week."""
        since = LeakFilter(self._settings, (wheel, *rate))
        self._play(since, self.last_since(since_day), metres_per_percent)
        return has_ended(since, self._settings)

    def last_since(self, day: float) -> list[Day]:
        """The last days from this one on, by which it is judged whether a leak goes on."""
        return [d for d in self.days if d.day >= day][-self._settings.clear_days :]

    @staticmethod
    def _play(into: LeakFilter, days: list[Day], metres_per_percent: Three) -> None:
        scale = np.array(metres_per_percent)
        for one in days:
            known = np.isfinite(one.variance_m2)
            value = np.where(known, one.difference_m, math.nan) / scale
            if np.isfinite(value).any():
                into.add(one.day, value, np.array(one.variance_m2) / scale**2, one.known_step)

    def to_json(self) -> dict[str, Any]:
        """Plain numbers for the state file."""
        return {
            "step_next": self._step_next,
            "days": [
                [d.day, *map(_or_none, d.difference_m), *map(_or_none, d.variance_m2), d.drives, d.known_step]
                for d in self.days
            ],
        }

    @classmethod
    def from_json(cls, saved: dict[str, Any]) -> LeakHistory:
        """Back from the state file; ValueError if it is none."""
        out = cls()
        try:
            days = [_day(entry) for entry in saved["days"]]
            step_next = saved["step_next"]
        except (KeyError, TypeError, IndexError) as error:
            raise ValueError(f"the saved days of the tyres are none: {error}") from error
        rising = all(one.day <= other.day for one, other in pairwise(days))
        if not rising or len(days) > READINGS.most_days or not isinstance(step_next, bool):
            raise ValueError("the saved days of the tyres are none")
        out.days, out._step_next = days, step_next
        return out


def _merged(one: Day, other: Day) -> Day:
    """The mean over the drives of a day."""
    n = min(one.drives, READINGS.most_drives)
    difference, variance = list(other.difference_m), list(other.variance_m2)
    for k in range(3):
        if math.isfinite(difference[k]) and math.isfinite(one.difference_m[k]):
            difference[k] = (n * one.difference_m[k] + difference[k]) / (n + 1)
            variance[k] = (n**2 * one.variance_m2[k] + variance[k]) / (n + 1) ** 2
        elif math.isfinite(one.difference_m[k]):
            difference[k], variance[k] = one.difference_m[k], one.variance_m2[k]
    return replace(one, difference_m=_three(difference), variance_m2=_three(variance), drives=n + 1)


def _three(values: Sequence[float] | FloatArray) -> Three:
    first, second, third = map(float, values)
    return first, second, third


def _day(entry: list[Any]) -> Day:
    if len(entry) == _BEFORE:
        entry = [*entry[:3], None, *entry[3:5], None, *entry[5:]]
    if len(entry) != _BEFORE + 2:
        raise ValueError("the saved days of the tyres are none")
    day, drives, known = entry[0], *entry[7:]
    if not isinstance(known, bool):
        raise ValueError("the saved days of the tyres are none")
    most = READINGS.most_difference_m
    return Day(
        number(day, -1e6, 1e6, "day"),
        _three([math.nan if x is None else number(x, -most, most, "difference") for x in entry[1:4]]),
        _three([math.nan if x is None else number(x, 0.0, most**2, "variance") for x in entry[4:7]]),
        whole(drives, 1, READINGS.most_drives + 1, "number of drives"),
        known,
    )


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None
