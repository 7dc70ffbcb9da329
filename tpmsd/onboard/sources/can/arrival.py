"""Arrival of the frames of one cyclic message: its period, and frames lost, late or repeated.

In: time stamp and data of each frame of one message (or of one multiplexer branch of it). Out: a verdict per
frame, the number of frames missing before it, the learned period, and whether the message has timed out.
Pure: the only clock is the frames' own.
"""

from __future__ import annotations

import copy
from bisect import bisect_right
from collections import deque
from enum import IntEnum
from itertools import pairwise

import numpy as np

from tpmsd.foundation.wheels import FloatArray

LOST_PERIODS = 1.6
"""A gap from this many periods on is a loss (one missing frame makes it 2), unless jitter is larger."""
LOST_SHARE, GAP_SHARE = 0.5, 0.125
"""Frames missing per frame that came, and gaps per interval, from which on frames are bunched, not lost."""
TIMEOUT_PERIODS = 10.0
MIN_TIMEOUT_S = 0.2
FIRST_TIMEOUT_S = 2.0
"""Time-out while the period is not yet known."""
CLOCK_STEP_S = 1.0
"""Frames that are late in unbroken order for this long are not late: the clock was set back."""


class FrameVerdict(IntEnum):
    """Treatment of a frame by its time stamp: used, or the reason why not."""

    USE = 0
    LATE = 1
    """Its time stamp is not after that of a frame seen before: not used."""
    REPEATED = 2
    """Same time stamp and same data as the frame before: not used."""
    CLOCK_STEP = 3
    """First frame after the clock was set back: used, but times before and after must not be compared."""


def timeout_of(period_s: float) -> float:
    """Return the silence after which a message of this period has timed out; `period_s` is 0 while it is not
    known."""
    return max(MIN_TIMEOUT_S, TIMEOUT_PERIODS * period_s) if period_s else FIRST_TIMEOUT_S


def timeouts_of(periods_s: FloatArray) -> FloatArray:
    """Return the (n,) time-outs of messages of these periods, s: `timeout_of` of each."""
    known_s = np.maximum(MIN_TIMEOUT_S, TIMEOUT_PERIODS * periods_s)
    return np.where(periods_s == 0.0, FIRST_TIMEOUT_S, known_s)


_USE = FrameVerdict.USE
"""Looked up for every frame: a member of an enumeration is found more slowly."""


class MessageArrival:
    """The arrival of one message."""

    __slots__ = (
        "_data",
        "_gap_frames",
        "_gap_s",
        "_intervals",
        "_late_first_s",
        "_late_last_s",
        "_lost_after_s",
        "_stepped",
        "_to_learn",
        "last_s",
        "lost",
        "period_s",
        "timed_out",
        "timeout_s",
    )

    def __init__(self, start_s: float) -> None:
        self.last_s = start_s
        """Time stamp of the last frame used; before the first one, the time at which waiting began."""
        self.period_s = 0.0
        """Mean interval of the last frames; 0 until it is known."""
        self.lost = 0
        """Frames missing, found out with the frame judged last (the second one after the gap)."""
        self.timeout_s = FIRST_TIMEOUT_S
        self.timed_out = False
        """Set by whoever reports the time-out, cleared by the next frame."""
        self._data: bytes | None = None
        self._intervals: deque[float] = deque(maxlen=31)
        self._to_learn = 8
        self._lost_after_s = float("inf")
        self._gap_s, self._gap_frames = 0.0, 0
        self._late_first_s = self._late_last_s = float("inf")
        self._stepped = False

    @property
    def seen(self) -> bool:
        """True if a frame of the message has come."""
        return self._data is not None

    def copied(self) -> MessageArrival:
        """Return an independent copy."""
        other = copy.copy(self)
        other._intervals = self._intervals.copy()
        return other

    def set_last_data(self, data: bytes) -> None:
        """Set the data of the frame judged last, where `judge_regular` was not given them."""
        self._data = data

    def is_overdue(self, time_s: float) -> bool:
        """Return whether no frame came for longer than the time-out."""
        return time_s - self.last_s > self.timeout_s

    def note_clock_step(self) -> None:
        """Treat the next frame as the first after a backward step of the clock, which another input has
        shown."""
        self._stepped = True

    def judge(self, time_s: float, data: bytes) -> FrameVerdict:
        """Return the verdict on a frame; sets `lost` and learns the period."""
        self.lost = 0
        stepped, self._stepped = self._stepped, False
        if stepped and self._data is not None:
            return self._accept_clock_step(time_s, data)
        if self._data is None:
            self.last_s, self._data = time_s, data
            return _USE
        interval = time_s - self.last_s
        if interval <= 0.0:
            return self._judge_late(time_s, interval, data)
        if self._gap_frames:
            self._close_gap(interval)
        if self._lost_after_s < interval <= self.timeout_s and not self._gap_frames:
            self._gap_s, self._gap_frames = interval, 1
        self.last_s, self._data = time_s, data
        self._late_last_s = float("inf")
        self._intervals.append(interval)
        self._to_learn -= 1
        if self._to_learn == 0:
            self._learn_period()
        return _USE

    def judge_regular(self, times_s: list[float]) -> list[float]:
        """Return the periods, s, that `judge` learns at each of these frames, up to the first that is not
        regular: late, repeated, after a loss, a time-out or a step."""
        periods: list[float] = []
        while (at := len(periods)) < len(times_s):
            # As a rule there is nothing to say before the period is learned again.
            some = times_s[at : at + self._to_learn]
            intervals = [after - before for before, after in pairwise((self.last_s, *some))]
            usual = min(intervals) > 0.0 and max(intervals) <= min(self._lost_after_s, self.timeout_s)
            if usual and not (self._data is None or self.timed_out or self._gap_frames or self._stepped):
                self.lost, self.last_s, self._late_last_s = 0, some[-1], float("inf")
                self._intervals.extend(intervals)
                self._to_learn -= len(some)
                periods += [self.period_s] * len(some)
                if self._to_learn == 0:
                    self._learn_period()
                    periods[-1] = self.period_s
                continue
            if self.timed_out or intervals[0] > self.timeout_s:
                break
            if self.judge(some[0], b"") is not _USE or self.lost:
                break
            periods.append(self.period_s)
        return periods

    def _close_gap(self, interval: float) -> None:
        """Count the frames lost in a gap: none if the frames behind it follow at once, for then they were
        held up."""
        if interval < 0.5 * self.period_s:
            self._gap_s += interval
            self._gap_frames += 1
            return
        self.lost = max(0, round(self._gap_s / self.period_s) - self._gap_frames)
        self._gap_frames = 0

    def _judge_late(self, time_s: float, interval: float, data: bytes) -> FrameVerdict:
        """Return the verdict on a frame stamped no later than the last one: repeated, late, or first after a
        clock step."""
        if interval == 0.0 and data == self._data:
            return FrameVerdict.REPEATED
        if time_s <= self._late_last_s:
            self._late_first_s = time_s
        self._late_last_s = time_s
        if time_s - self._late_first_s < CLOCK_STEP_S:
            return FrameVerdict.LATE
        return self._accept_clock_step(time_s, data)

    def _accept_clock_step(self, time_s: float, data: bytes) -> FrameVerdict:
        """Follow the stamps from this frame on, and return the verdict `CLOCK_STEP`."""
        self.last_s, self._data = time_s, data
        self._late_last_s = float("inf")
        self._gap_frames = 0
        return FrameVerdict.CLOCK_STEP

    def _period_intervals(self, ordered: list[float], near: list[float]) -> list[float]:
        """Return the intervals whose mean is the period: `near`, or all of them if frames come in bunches.

        An adapter that hands frames over in bunches makes most intervals far shorter than the period. By
        their mean more frames would be missing in the gaps than `LOST_SHARE` of those that came, and gaps
        would be frequent; single outages are neither.
        """
        short_s = sum(near) / len(near)
        gaps = [interval for interval in ordered[len(near) :] if interval <= self.timeout_s]
        missing = sum(gaps) / short_s - len(gaps)
        bunched = missing > LOST_SHARE * len(ordered) and len(gaps) >= GAP_SHARE * len(ordered)
        return near + gaps if bunched else near

    def _learn_period(self) -> None:
        """Set period and time-out by the last intervals, and the interval beyond which a frame is lost."""
        ordered = sorted(self._intervals)
        median = ordered[len(ordered) // 2]
        # The mean is right however skewed the jitter is; intervals with frames missing do not count in it.
        near = ordered[: bisect_right(ordered, 1.8 * median)]
        self.period_s = sum(near) / len(near)
        if len(near) < len(ordered):
            near = self._period_intervals(ordered, near)
            self.period_s = sum(near) / len(near)
        self.timeout_s = timeout_of(self.period_s)
        typical_late = near[9 * len(near) // 10] + 0.5 * self.period_s
        self._lost_after_s = max(LOST_PERIODS * self.period_s, typical_late)
        # Senders change their rate (some start slowly), so the median follows.
        self._to_learn = 16
