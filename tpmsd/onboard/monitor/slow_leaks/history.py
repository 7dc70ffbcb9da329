"""Readings of one set of tyres: the contrasts of its radii, bounded in number and in age.

In: per drive the contrasts of `state` with their variances. Out: a `Trend`. Each drive is a reading of
its own: where estimates scatter with heavy tails, the mean over a day's drives knows less than each of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from tpmsd.foundation.bounds import number
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.settings import READINGS, TREND
from tpmsd.onboard.monitor.slow_leaks.filter import LeakFilter
from tpmsd.onboard.monitor.slow_leaks.settings import TrendSettings
from tpmsd.onboard.monitor.slow_leaks.trend import Trend, has_ended, trend_of

Three = tuple[float, float, float]
_FIRST = 7
"""Values of a saved entry that has no front against rear (states of earlier versions), ..."""
_MERGED = 9
"""... and of one that is the mean over a day's drives, with their number."""


@dataclass(frozen=True, slots=True)
class Reading:
    """Differences between radii (m) that one drive measured, with their variances and its day."""

    day: float
    """Days since the epoch of the host's clock."""
    difference_m: Three
    """Left minus right of the front and of the rear axle, front minus rear; NaN where it is not known."""
    variance_m2: Three
    known_step: bool = False
    """True if the driver asked for a reset before it."""


class LeakHistory:
    """The readings of one set of tyres."""

    def __init__(self, settings: TrendSettings = TREND) -> None:
        self._settings = settings
        self.readings: list[Reading] = []
        self._filters: dict[Three, tuple[LeakFilter, int]] = {}
        """Filters by metres per per cent, with how many of the last readings are still to be taken; after a
        restart made from `readings`.
        """
        self._step_next = False

    def add(self, day: float, difference_m: FloatArray, variance_m2: FloatArray) -> bool:
        """Add the reading of one drive, (3,) each; return False if it is left out, being of a day before the
        last."""
        last = self.readings[-1].day if self.readings else day
        same = math.floor(day) == math.floor(last)
        if day < last and last - day <= READINGS.stepped_back_d and not same:
            return False
        if day - last > READINGS.longest_gap_d or (day < last and not same):
            self.readings.clear()
            self._filters.clear()
            last = day
        # A clock that was set back within the day does not turn the order of its readings.
        one = Reading(max(day, last), _three(difference_m), _three(variance_m2), self._step_next)
        self._step_next = False
        self.readings.append(one)
        self._filters = {scale: (past, new + 1) for scale, (past, new) in self._filters.items()}
        young = [r for r in self.readings if day - r.day <= READINGS.oldest_d]
        self.readings = young[-READINGS.max_readings :]
        return True

    def mark_step(self) -> None:
        """Record that the driver asked for a reset before the next reading: levels may change there, rates go
        on."""
        self._step_next = bool(self.readings)

    def forget_before(self, day: float) -> None:
        """Drop the readings before this day."""
        self.readings = [r for r in self.readings if r.day >= day]
        self._filters.clear()

    def trend(self, metres_per_percent: Three) -> Trend | None:
        """Return the likeliest leak; None without readings, or if its probability is below one half.
        `metres_per_percent`: of each contrast."""
        if not self.readings:
            return None
        first = (LeakFilter(self._settings), len(self.readings))
        past, new = self._filters.get(metres_per_percent, first)
        self._add_readings(past, self.readings[max(len(self.readings) - new, 0) :], metres_per_percent)
        self._filters[metres_per_percent] = (past, 0)
        return trend_of(past, self._settings)

    def leak_has_ended(
        self, metres_per_percent: Three, wheel: int, rate: tuple[float, float], since_day: float
    ) -> bool:
        """Return whether the last days, from `since_day` on, show that a leak of this wheel has ended; `rate`
        and its standard deviation in per cent per week."""
        since = LeakFilter(self._settings, (wheel, *rate))
        self._add_readings(since, self.recent_readings(since_day), metres_per_percent)
        return has_ended(since, self._settings)

    def recent_readings(self, day: float) -> list[Reading]:
        """Return the readings of the last `clear_days` days, from this one on, by which it is judged whether
        a leak goes on."""
        since = [r for r in self.readings if r.day >= day]
        last = sorted({math.floor(r.day) for r in since})[-self._settings.clear_days :]
        return [r for r in since if math.floor(r.day) in last]

    @staticmethod
    def _add_readings(into: LeakFilter, readings: list[Reading], metres_per_percent: Three) -> None:
        """Update a filter by readings, in per cent of pressure."""
        scale = np.array(metres_per_percent)
        for one in readings:
            known = np.isfinite(one.variance_m2)
            value = np.where(known, one.difference_m, math.nan) / scale
            if np.isfinite(value).any():
                into.add(one.day, value, np.array(one.variance_m2) / scale**2, one.known_step)

    def to_json(self) -> dict[str, Any]:
        """Return plain numbers for the state file."""
        return {
            "step_next": self._step_next,
            "days": [
                [
                    r.day,
                    *map(_finite_or_none, r.difference_m),
                    *map(_finite_or_none, r.variance_m2),
                    r.known_step,
                ]
                for r in self.readings
            ],
        }

    @classmethod
    def from_json(cls, saved: dict[str, Any]) -> LeakHistory:
        """Restore from the state file; ValueError if it is none."""
        out = cls()
        try:
            readings = [_read_entry(entry) for entry in saved["days"]]
            step_next = saved["step_next"]
        except (KeyError, TypeError, IndexError) as error:
            raise ValueError(f"the saved days of the tyres are none: {error}") from error
        rising = all(one.day <= other.day for one, other in pairwise(readings))
        if not rising or len(readings) > READINGS.max_readings or not isinstance(step_next, bool):
            raise ValueError("the saved days of the tyres are none")
        out.readings, out._step_next = readings, step_next
        return out


def _three(values: Sequence[float] | FloatArray) -> Three:
    first, second, third = map(float, values)
    return first, second, third


def _read_entry(entry: list[Any]) -> Reading:
    """Return the reading of a saved entry, of earlier versions too; ValueError if it is none."""
    if len(entry) == _FIRST:
        entry = [*entry[:3], None, *entry[3:5], None, *entry[5:]]
    if len(entry) == _MERGED:
        entry = [*entry[:7], entry[8]]
    if len(entry) != _MERGED - 1:
        raise ValueError("the saved days of the tyres are none")
    day, known = entry[0], entry[7]
    if not isinstance(known, bool):
        raise ValueError("the saved days of the tyres are none")
    most = READINGS.max_difference_m
    return Reading(
        number(day, -1e6, 1e6, "day"),
        _three([math.nan if x is None else number(x, -most, most, "difference") for x in entry[1:4]]),
        _three([math.nan if x is None else number(x, 0.0, most**2, "variance") for x in entry[4:7]]),
        known,
    )


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None
