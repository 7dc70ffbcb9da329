"""Time of validity of a fix on the host's clock.

In: each fix's time of arrival (host clock) and its own UTC. Out: the host time at which it was valid.

Transport only ever adds delay, so the lower envelope of (arrival - UTC) is the offset between the clocks. It
drifts by a millisecond per second, which is followed smoothly; it steps when a host clock is set, which is
taken up at once.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import deque

import numpy as np

from tpmsd.foundation.median import median

WINDOW_S = 10.0
"""Memory of the envelope: long against jitter, short against drift (1 ms/s moves it by 5 ms)."""
QUANTILE = 0.15
"""Quantile of the offsets; the minimum would be pulled down for a whole window by one early stamp."""
SMOOTHING_S = 2.0
JUDGE_S = 0.4
"""Period at which the envelope is computed again, s; it moves slower than SMOOTHING_S anyway."""
STEP_S = 0.25
STEP_FIXES = 4
STEP_SPREAD_S = 0.15
MAX_DRIFT = 2e-3
"""Drift of the host clock against UTC, s/s: free-running crystals keep 1e-4, logging hosts reached 1e-3."""
EARLIEST_S, LATEST_S = 0.05, 2.5
"""Delay of a fix's arrival after its validity on a host on UTC, s: none before it (but for the clock's own
error), nor so much later."""
_TREND_SPAN = 1.7
_MAX_FIXES = 4096
_WARM_FIXES = 10


class UtcOffsetTracker:
    """Follows the offset of one receiver's UTC from one host clock.

    After each `update`: `offset_s` (host minus UTC), `lag_s` (arrival minus validity), `step_s` (size of the
    step that was just taken, else 0) and `status`: `ok`; `step`: a new level was taken up with this fix;
    `outlier`: far off the level, not (yet) accepted; `repeated`, `backwards`: UTC stood still or went back;
    `no_utc`: placed by its arrival and the usual lag.
    """

    def __init__(self, latency_s: float = 0.0, host_on_utc: bool = False) -> None:
        """`host_on_utc`: the host's clock is kept on UTC, so a fix's own time is its validity."""
        self._latency_s = latency_s
        self._host_on_utc = host_on_utc
        self.off_utc = False
        """True if the last fix contradicted `host_on_utc`."""
        self._times_s: list[float] = []
        self._offsets: list[float] = []
        """UTC of the last fixes, rising, and the offset that each of them tells."""
        self._candidates: deque[tuple[float, float]] = deque(maxlen=STEP_FIXES)
        self._lags: deque[float] = deque(maxlen=64)
        self._utc_s = self._target_s = self._judged_s = math.nan
        self.offset_s = math.nan
        self.lag_s = math.nan
        self.step_s = 0.0
        self.status = "no_utc"

    def update(self, arrival_s: float, utc_s: float) -> float:
        """Return the host time (s) at which a fix was valid; update the offset of UTC by it.

        It arrived at `arrival_s` and states `utc_s`.

        NaN for `utc_s` means that it says nothing. Never raises.
        """
        self.step_s = 0.0
        if not (math.isfinite(utc_s) and math.isfinite(arrival_s)):
            return self._valid_by_usual_lag(arrival_s)
        if self._host_on_utc:
            self.off_utc = not -EARLIEST_S <= arrival_s - utc_s <= LATEST_S
            if not self.off_utc:
                self.status, self.offset_s, self.lag_s = "ok", 0.0, arrival_s - utc_s
                self._lags.append(self.lag_s)
                return utc_s
        before, self._utc_s = self._utc_s, utc_s
        self.status = "ok"
        if utc_s == before:
            self.status = "repeated"
        else:
            if utc_s < before:
                self.status = "backwards"
            self._update_offset(utc_s, arrival_s - utc_s, math.inf if math.isnan(before) else utc_s - before)
        valid_s = utc_s + self.offset_s - self._latency_s
        self.lag_s = arrival_s - valid_s
        if self.status in ("ok", "step"):
            self._lags.append(self.lag_s)
        return valid_s

    def _valid_by_usual_lag(self, arrival_s: float) -> float:
        """Return the time of validity of a fix without UTC: its arrival less the median lag."""
        self.status = "no_utc"
        self.lag_s = float(median(np.array(self._lags))) if self._lags else self._latency_s
        return arrival_s - self.lag_s

    def _update_offset(self, utc_s: float, offset_s: float, since_s: float) -> None:
        """Update the offset by that of one fix, `since_s` of UTC after the one before."""
        if math.isnan(self.offset_s):
            self._store(utc_s, offset_s)
            self.offset_s = offset_s
        elif abs(offset_s - self.offset_s) > STEP_S:
            self._consider_step(utc_s, offset_s)
        elif since_s > 0.0:
            self._candidates.clear()
            self._store(utc_s, offset_s)
            self._smooth_offset(utc_s, since_s)

    def _consider_step(self, utc_s: float, offset_s: float) -> None:
        """Record an offset far off the present one; take a step to it when several fixes in a row agree on
        it.

        A line that was stalled and then delivers all at once does not agree: there UTC goes on while arrival
        stands.
        """
        self._candidates.append((utc_s, offset_s))
        offsets = [offset for _, offset in self._candidates]
        forward = self._candidates[-1][0] > self._candidates[0][0]
        if len(offsets) < STEP_FIXES or max(offsets) - min(offsets) > STEP_SPREAD_S or not forward:
            self.status = "outlier" if self.status == "ok" else self.status
            return
        level_s = min(offsets)
        self.step_s, self.offset_s = level_s - self.offset_s, level_s
        self._times_s.clear()
        self._offsets.clear()
        for candidate in self._candidates:
            self._store(*candidate)
        self._candidates.clear()
        self.status = "step"

    def _store(self, utc_s: float, offset_s: float) -> None:
        """Add an offset to the window, in the order of UTC."""
        at = bisect_right(self._times_s, utc_s)  # as a rule the last: a receiver's time seldom goes back
        self._times_s.insert(at, utc_s)
        self._offsets.insert(at, offset_s)
        if len(self._times_s) > _MAX_FIXES:
            del self._times_s[0], self._offsets[0]

    def _smooth_offset(self, now_s: float, since_s: float) -> None:
        """Move `offset_s` toward the present envelope, with the time constant `SMOOTHING_S`."""
        warming = len(self._times_s) <= _WARM_FIXES
        if warming or not 0.0 <= now_s - self._judged_s < JUDGE_S:
            self._target_s, self._judged_s = self._present_envelope(now_s), now_s
        gain = 1.0 if warming else -math.expm1(-since_s / SMOOTHING_S)
        self.offset_s += (self._target_s - self.offset_s) * gain

    def _present_envelope(self, now_s: float) -> float:
        """Return the lower envelope of the window's offsets now, drift included; older ones are dropped."""
        # A hundred numbers or two: plain lists take half the time of arrays.
        times_s, offsets = self._times_s, self._offsets
        stale = bisect_left(times_s, True, key=lambda utc_s: now_s - utc_s <= 2.0 * WINDOW_S)
        del times_s[:stale], offsets[:stale]
        half = bisect_left(times_s, True, key=lambda utc_s: now_s - utc_s <= WINDOW_S)
        late = offsets[half:]
        target_s = _lower_quantile(late)
        if half >= _WARM_FIXES and now_s - times_s[0] > _TREND_SPAN * WINDOW_S:
            # The two halves of the window tell the drift; without it the envelope is half a window old.
            early_ages, late_ages = (
                [now_s - utc_s for utc_s in one] for one in (times_s[:half], times_s[half:])
            )
            apart_s = sum(early_ages) / half - sum(late_ages) / len(late_ages)
            drift = (target_s - _lower_quantile(offsets[:half])) / apart_s
            drift = min(max(drift, -MAX_DRIFT), MAX_DRIFT)
            ageing = zip(late_ages, late, strict=True)
            target_s = _lower_quantile([offset_s + drift * age_s for age_s, offset_s in ageing])
        return target_s


def _lower_quantile(offsets: list[float]) -> float:
    """Return the `QUANTILE` of offsets, interpolated between order statistics."""
    at = QUANTILE * (len(offsets) - 1)
    below, lowest = int(at), sorted(offsets)
    above = lowest[min(below + 1, len(offsets) - 1)]
    return lowest[below] + (at - below) * (above - lowest[below])
