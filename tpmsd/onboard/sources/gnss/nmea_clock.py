"""Turns the receiver's time of day into Unix time.

In: a time of day, the date if the sentence has one, the host's time of arrival. Out: Unix seconds. Midnight,
dates that come rarely or never, receivers whose GPS week number rolled over (1024 weeks) and second 60 are
dealt with.
"""

from __future__ import annotations

import math

DAY_S = 86400.0
ROLLOVER_S = 1024 * 7 * DAY_S
"""GPS counts weeks in 10 bits (IS-GPS-200, 20.3.3.3.1.1): old firmware takes today for 1024 weeks ago."""
_PLAUSIBLE_HOST_S = 1.0e9
"""A host clock before 2001 was never set, and cannot say which date is right."""
_LONG_SILENCE_S = 6 * 3600.0


def nearest_day(time_of_day_s: float, reference_s: float) -> float:
    """Return the Unix time with this time of day that is nearest to the reference."""
    return time_of_day_s + DAY_S * round((reference_s - time_of_day_s) / DAY_S)


class ReceiverClock:
    """Follows one receiver's date. `rollovers` is the number of 1024-week periods that are being added."""

    def __init__(self) -> None:
        self.rollovers = 0
        self.dated = False
        self._utc_s = math.nan
        self._arrival_s = math.nan

    def resolve(self, time_of_day_s: float, unix_day: int | None, arrival_s: float) -> float:
        """Return Unix seconds of this time of day; NaN if there is none.

        A time without a date takes the day that brings it nearest to the last known time, or, before any
        date, to the arrival. Only a long silence makes the arrival the reference again: a host clock may step
        at any time.
        """
        if math.isnan(time_of_day_s):
            return math.nan
        if unix_day is not None:
            utc_s = self._without_rollover(unix_day * DAY_S + time_of_day_s, arrival_s)
            self.dated = True
        elif self.dated or abs(arrival_s - self._arrival_s) < _LONG_SILENCE_S:
            utc_s = nearest_day(time_of_day_s, self._utc_s)
        else:
            utc_s = nearest_day(time_of_day_s, arrival_s) if math.isfinite(arrival_s) else time_of_day_s
        self._utc_s, self._arrival_s = utc_s, arrival_s
        return utc_s

    def _without_rollover(self, utc_s: float, arrival_s: float) -> float:
        """Return the Unix time with the 1024-week periods added by which the receiver's date is off, judged
        by the arrival."""
        if arrival_s >= _PLAUSIBLE_HOST_S and math.isfinite(arrival_s):
            periods = round((arrival_s - utc_s) / ROLLOVER_S)
            # Off by whole periods and nothing else: the host is right about the date. Any other difference
            # says only that one of the clocks is wrong, and the receiver's is the better one.
            if abs(arrival_s - utc_s - periods * ROLLOVER_S) <= DAY_S:
                self.rollovers = periods
        return utc_s + self.rollovers * ROLLOVER_S
