"""One wheel's free-running counter, unwrapped to an exact angle.

In: time stamp and raw value of each reading, in order of time. Out: `RotationSample` events; faults to
the log.

    angle = (counts since the segment began) * 2 pi / teeth per revolution        ([Lundquist 2013], eq. 37)

The count is an integer and is never rounded, so a segment's angle is exact however long it is. A reading is
accepted if the wheel can have turned so far since the last one. What it can do follows from its speed before:
it may lock at any time, it gains speed by no more than MAX_ACCEL_MPS2, and the time stamp may be off by a
period. Of all counts that the raw value may stand for (it rolls over at its modulus) one may be possible:

    none                 suspect: the next reading tells a single odd value ('jump') from a new level
                         ('reset' if that began near zero); a new level is a new segment
    one                  taken; if it is zero while the wheel should have turned, the value is 'repeated'
    several (long gap)   the one that fits the speed before without locking, if the frames after the gap are
                         not a backlog; otherwise a new segment
"""

from __future__ import annotations

import itertools
import math
from collections import deque

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.sources.ahead.regular_readings import (
    IntArray,
    RegularReadings,
    first_run_too_long,
    first_true,
    none_regular,
    still_runs,
)
from tpmsd.onboard.sources.can.faults import FaultLog
from tpmsd.onboard.sources.events import Event, RotationSample

MAX_SPEED_MPS = 100.0
MAX_REVERSE_MPS = 10.0
MAX_ACCEL_MPS2 = 25.0
MAX_GAP_S = 60.0
"""Silence after which the counter may have been reset without a trace, s: always a new segment."""
SLACK_BITS = 3.0
"""Quantisation of both ends, and the dither of a counter at rest on an edge."""
SPEED_WINDOW_S = 0.1
"""The speed before is taken over this time: long enough for coarse rings and jittery time stamps."""
REPEATED_BITS = 2.0
"""Rotation in bits from which an unchanged value is not a reading, as the wheel must have moved."""
AGREEING = 6
"""Number of irregular readings in a row that, consistent with each other, are taken as the wheel's."""
STUCK_S = 0.5
STUCK_BITS = 4.0
"""Distance that the other wheels have rolled while this one has not, in bits of this counter."""


class WheelCounter:
    """Unwraps the counter of one wheel."""

    __slots__ = (
        "_accel",
        "_base",
        "_faults",
        "_held",
        "_history",
        "_implausible",
        "_max_speed",
        "_modulus",
        "_raw",
        "_released",
        "_reverse",
        "_run_speed",
        "_same_s",
        "_span",
        "_speed",
        "_suspect",
        "_time_s",
        "_total",
        "_withheld",
        "m_per_bit",
        "rad_per_bit",
        "segment",
        "still_since",
        "stuck",
        "wheel",
    )

    def __init__(
        self,
        wheel: int,
        modulus: int,
        counts_per_bit: float,
        teeth_per_rev: float,
        radius_m: float,
        faults: FaultLog,
    ) -> None:
        self.wheel = wheel
        self.rad_per_bit = counts_per_bit * 2.0 * math.pi / teeth_per_rev
        self.m_per_bit = self.rad_per_bit * radius_m
        self.segment = 0
        self.still_since: float | None = None
        """Time of the last reading before the value stopped changing; None while it changes."""
        self.stuck = False
        self._faults = faults
        self._modulus = modulus
        self._accel = MAX_ACCEL_MPS2 / self.m_per_bit
        self._max_speed = MAX_SPEED_MPS / self.m_per_bit
        self._reverse = MAX_REVERSE_MPS / self.m_per_bit

        self._raw: int | None = None
        self._time_s = 0.0
        self._same_s = 0.0
        """Time of the last frame with the value `_raw`, be it taken as a reading or not."""
        self._total = 0
        self._base = 0
        self._history: deque[tuple[float, int]] = deque()
        self._speed = math.nan
        """Bits per second before the last reading, over `_span` seconds; NaN while not known."""
        self._span = 0.0
        self._run_speed = math.nan
        self._withheld = False
        """True if, since the value stopped changing, it was found 'repeated', and stays so until the wheels
        together show that the car stands."""
        self._released = False
        self._suspect: tuple[float, int] | None = None
        self._implausible: deque[tuple[float, int]] = deque(maxlen=AGREEING)
        self._held: tuple[float, int, int] | None = None

    @property
    def travel_m(self) -> float:
        """Distance rolled since the start over all segments, by the nominal radius, m."""
        return self._total * self.m_per_bit

    @property
    def speed_mps(self) -> float:
        """Speed before the last reading; NaN while not known."""
        return self._speed * self.m_per_bit

    @property
    def stopped_impossibly(self) -> bool:
        """True if the value stopped changing while the wheel must have turned on."""
        return self._withheld and not self._released

    @property
    def at_standstill(self) -> bool:
        """True if the unchanged value was accepted as a reading: the wheels together have shown that the car
        stands."""
        return self.still_since is not None and self._released and not self.stuck

    def update(self, time_s: float, raw: int, period_s: float, out: list[Event]) -> None:
        """Judge one reading; append its sample or its fault. `raw` are the signal's bits, `period_s` the
        message's period (0: not known)."""
        if self._raw is None:
            self._begin_segment(time_s, raw, out)
            return
        if self.stuck:
            if raw != self._raw:
                self._begin_segment(time_s, raw, out)
            return
        if self._held is not None and self._end_gap(time_s, raw, period_s, out):
            return
        # A value that did not change for many frames is no gap, even if none of them was a reading.
        interval = time_s - (self._same_s if raw == self._raw else self._time_s)
        if interval <= 0.0:
            self._faults.note(out, time_s, "late", self.wheel)
            return
        if interval > MAX_GAP_S:
            self._begin_segment(time_s, raw, out)
            return
        low, high = self._possible_bits(interval, period_s)
        bits = low + ((raw - self._raw - low) % self._modulus)
        if bits > high:
            self._judge_implausible(time_s, raw, period_s, out)
        elif bits + self._modulus <= high:
            self._resolve_rollovers(time_s, raw, interval, period_s, out)
        elif bits:
            self._accept(time_s, raw, bits, out)
        else:
            self._accept_unchanged(time_s, out)

    def regular_readings(self, time_s: FloatArray, raw: IntArray, period_s: FloatArray) -> RegularReadings:
        """Return the readings that `update` would make of n readings, as far as they are regular; changes
        nothing.

        `time_s` (n,): rising times; `raw` (n,): the signal's bits; `period_s` (n,): the message's period at
        each. Readings of a counter that stands are regular as long as they stay the same.
        """
        count, at_standstill = len(time_s), self.at_standstill
        if self._raw is None or not self._can_begin_regular_run(at_standstill):
            return none_regular(count)
        modulus = self._modulus
        step = np.diff(raw, prepend=self._raw)
        # Which number of bits a step is depends on the speed, and that on the steps: guessed, then judged.
        bits = (step + modulus // 4) % modulus - modulus // 4
        known = len(self._history)
        times = np.concatenate([[at for at, _ in self._history], time_s])
        totals = np.concatenate([[total for _, total in self._history], self._total + np.cumsum(bits)])
        before_s = times[known - 1 : -1]
        interval = time_s - before_s

        first = _window_starts(times, known)
        span = time_s - times[first]
        wide = span >= 0.8 * SPEED_WINDOW_S
        latest = np.maximum.accumulate(np.where(wide, np.arange(count), -1))
        with np.errstate(divide="ignore"):
            speeds = np.append((totals[known:] - totals[first]) / span, self._speed)[latest]
        spans = np.append(span, self._span)[latest]
        speed, width = np.append(self._speed, speeds)[:-1], np.append(self._span, spans)[:-1]

        low, high = self._possible_bits_all(speed, width, interval, period_s)
        least = low + (step - low) % modulus
        irregular = (least != bits) | (bits > high) | (bits + modulus <= high)
        same = bits == 0
        begin, since = still_runs(same, before_s)
        if at_standstill:
            regular = first_true(irregular | ~same)
            since = np.full(count, self.still_since)
        else:
            run = np.where(same, time_s - since, 0.0)
            min_bits = np.abs(speed[begin]) * run - 0.5 * self._accel * run * (width + run)
            last = np.arange(count) == count - 1
            too_long = same & ((min_bits >= REPEATED_BITS) | (run > STUCK_S) | last)
            regular = min(first_true(irregular), first_run_too_long(begin, too_long))

        def commit() -> None:
            self._total, self._raw = int(totals[-1]), int(raw[-1])
            self._time_s = self._same_s = float(time_s[-1])
            self._history.clear()
            self._history.extend(zip(times[first[-1] :].tolist(), totals[first[-1] :].tolist(), strict=True))
            self._speed, self._span = float(speeds[-1]), float(spans[-1])
            self._released = at_standstill
            if same.any() and not at_standstill:
                self._run_speed = float(speed[begin[same][-1]])
                self._withheld = False

        angle = (totals[known:] - self._base) * self.rad_per_bit
        return RegularReadings(angle, since, regular, commit)

    def _can_begin_regular_run(self, at_standstill: bool) -> bool:
        """Return whether a regular run can begin: the last reading was taken, and its speed is known."""
        return not (
            self.stuck
            or (self.still_since is not None and not at_standstill)
            or self._held is not None
            or self._suspect is not None
            or self._implausible
            or math.isnan(self._speed)
            or self._history[-1][0] != self._time_s
            or self._same_s != self._time_s
        )

    def _possible_bits_all(
        self, speed: FloatArray, span: FloatArray, interval: FloatArray, period_s: FloatArray
    ) -> tuple[IntArray, FloatArray]:
        """Return the bounds of `_possible_bits` for readings (n,) with these speeds before them."""
        stamp = period_s + np.abs(interval - period_s)
        limit = self._max_speed * (interval + np.where(period_s > 0.0, period_s, interval))
        moved = speed * interval
        slack = 0.5 * self._accel * interval * (span + interval) + SLACK_BITS + interval / span
        forward = speed >= 0.0
        low = np.where(
            forward,
            np.minimum(moved - slack, -SLACK_BITS),
            np.maximum(moved - slack + speed * stamp, -limit),
        )
        high = np.where(
            forward, np.minimum(moved + slack + speed * stamp, limit), np.maximum(SLACK_BITS, moved + slack)
        )
        return np.ceil(low).astype(np.int64), high

    def restart(self) -> None:
        """Forget the reading before: the clock stepped. The next reading begins a segment."""
        if self._raw is not None:
            self._raw = None
            self._speed = math.nan
            self._suspect = self._held = None

    def is_stuck(self, time_s: float, others_m: list[float]) -> bool | None:
        """Return whether the value stands still while the wheel turns; None: too early to tell.

        `others_m`: ways that the other wheels have rolled since `still_since`. Two of them must have moved
        (one, if there is but one): a single one may be spinning on ice.
        """
        assert self.still_since is not None
        if time_s - self.still_since <= STUCK_S:
            return None
        moved = sum(map(self.has_rolled, others_m))
        return moved >= min(2, max(1, len(others_m)))

    def has_rolled(self, distance_m: float) -> bool:
        """Return whether another wheel has rolled so far that this one cannot stand with it."""
        return abs(distance_m) >= STUCK_BITS * self.m_per_bit

    def mark_stuck(self) -> None:
        """Withhold samples until the value changes; that begins a new segment."""
        self.stuck = True
        self._suspect = self._held = None

    def mark_standstill(self) -> None:
        """Accept the unchanged value as a reading: the car stands."""
        self._released = True

    def _possible_bits(self, interval: float, period_s: float) -> tuple[int, float]:
        """Return the least (rounded up) and most bits that the wheel can have moved in an interval, s."""
        # The sender's clock ticks on when a frame is held up, and its count may be a period old.
        stamp_s = period_s + abs(interval - period_s)
        limit = self._max_speed * (interval + (period_s if period_s > 0.0 else interval))
        speed = self._speed
        if speed != speed:  # NaN
            return -int(self._reverse * interval + SLACK_BITS), limit
        distance = speed * interval
        slack = self._slack_bits(interval)
        if speed >= 0.0:
            # Comparisons take half the time of min and max, and this is asked for every reading.
            low, high = distance - slack, distance + slack + speed * stamp_s
            if low > -SLACK_BITS:
                low = -SLACK_BITS
            if high > limit:
                high = limit
        else:
            low = max(distance - slack + speed * stamp_s, -limit)
            high = max(SLACK_BITS, distance + slack)
        return math.ceil(low), high

    def _slack_bits(self, interval: float) -> float:
        """Return the difference in bits that distance and speed times interval may have: acceleration and
        quantisation."""
        since = self._span + interval
        return 0.5 * self._accel * interval * since + SLACK_BITS + interval / self._span

    def _begin_segment(self, time_s: float, raw: int, out: list[Event]) -> None:
        """Begin a new segment with this reading as its origin."""
        if self._raw is not None or self._history:
            self.segment += 1
        self._base = self._total
        self._raw, self._time_s, self._same_s = raw, time_s, time_s
        # The wheel's speed did not change with its counter; it stays known until there is a newer one.
        self._history.clear()
        self._history.append((time_s, self._total))
        self.still_since = None
        self.stuck = self._released = False
        self._suspect = self._held = None
        self._implausible.clear()
        out.append(RotationSample(time_s, self.wheel, 0.0, self.rad_per_bit, self.segment))

    def _accept(self, time_s: float, raw: int, bits: int, out: list[Event]) -> None:
        """Accept a reading that is `bits` on from the last one, and append its sample."""
        if self._suspect is not None:
            self._drop_suspect(self._suspect, out)
        self._total += bits
        self._raw, self._time_s, self._same_s = raw, time_s, time_s
        self.still_since = None
        self._released = False
        if self._implausible:
            self._implausible.clear()
        self._append_sample(time_s, out)

    def _append_sample(self, time_s: float, out: list[Event]) -> None:
        """Append the reading's sample, and update the speed over the last SPEED_WINDOW_S."""
        history, total = self._history, self._total
        history.append((time_s, total))
        while len(history) > 2 and time_s - history[1][0] >= SPEED_WINDOW_S:
            history.popleft()
        first_s, first = history[0]
        span = time_s - first_s
        if span >= 0.8 * SPEED_WINDOW_S:
            self._speed, self._span = (total - first) / span, span
        rad_per_bit = self.rad_per_bit
        angle = (total - self._base) * rad_per_bit
        out.append(RotationSample(time_s, self.wheel, angle, rad_per_bit, self.segment))

    def _accept_unchanged(self, time_s: float, out: list[Event]) -> None:
        """Accept an unchanged value: the wheel stands (or creeps), or the value was not renewed and is
        withheld."""
        if self._suspect is not None:
            self._drop_suspect(self._suspect, out)
        self._same_s = time_s
        if self.still_since is None:
            self.still_since = self._time_s
            self._run_speed = self._speed
            self._withheld = False
        if not self._released:
            run = time_s - self.still_since
            # Even braking as hard as it can the wheel must have turned so far; a NaN compares false.
            least = abs(self._run_speed) * run - 0.5 * self._accel * run * (self._span + run)
            self._withheld = self._withheld or least >= REPEATED_BITS
            if self._withheld:
                self._faults.note(out, time_s, "repeated", self.wheel)
                return
        self._time_s = time_s
        self._append_sample(time_s, out)

    def _judge_implausible(self, time_s: float, raw: int, period_s: float, out: list[Event]) -> None:
        """Judge a reading that cannot follow the last one: that one was wrong, this one is (and is held
        as suspect), or the counter was reset or jumped to a new level."""
        suspect = self._suspect
        if suspect is None:
            if not self._replace_last(time_s, raw, period_s, out):
                self._suspect = (time_s, raw)
            return
        interval = time_s - suspect[0]
        if interval <= 0.0 or self._bits_from(suspect[1], raw, interval, period_s) is None:
            self._drop_suspect(suspect, out)
            self._suspect = (time_s, raw)
            if self._agree_at_steady_speed(time_s, raw):
                # The speed before was wrong (frozen frames say 0), or the wheel was lifted off the road.
                self._speed = math.nan
                self._begin_segment(time_s, raw, out)
            return
        distance = self._max_speed * (suspect[0] - self._time_s + max(period_s, interval))
        kind = "reset" if suspect[1] <= min(distance, self._modulus / 4) else "jump"
        self._faults.note(out, suspect[0], kind, self.wheel, f"from {self._raw} to {suspect[1]}")
        self._begin_segment(time_s, raw, out)

    def _agree_at_steady_speed(self, time_s: float, raw: int) -> bool:
        """Return whether the last readings, irregular by the speed before, are those of one wheel at a steady
        speed; keeps this one among them."""
        readings = self._implausible
        readings.append((time_s, raw))
        if len(readings) < AGREEING:
            return False
        pairs = list(itertools.pairwise(readings))
        if not all(0.0 < after[0] - before[0] <= SPEED_WINDOW_S for before, after in pairs):
            return False
        bits = [(after[1] - before[1]) % self._modulus for before, after in pairs]
        limit = self._max_speed * (readings[-1][0] - readings[0][0])
        return 0 < sum(bits) <= limit and max(bits) - min(bits) <= SLACK_BITS + 0.2 * max(bits)

    def _replace_last(self, time_s: float, raw: int, period_s: float, out: list[Event]) -> bool:
        """Accept the reading in place of the last one, if it follows the one before that.

        A wrong value that the wheel could just have reached is taken at first; the next right one shows it.
        """
        assert self._raw is not None
        if len(self._history) < 2 or self._history[-1][0] != self._time_s:
            return False
        before_s, before = self._history[-2]
        before_raw = (self._raw - (self._total - before)) % self._modulus
        bits = self._bits_from(before_raw, raw, time_s - before_s, period_s)
        if bits is None:
            return False
        self._faults.note(out, self._time_s, "jump", self.wheel, f"single odd value {self._raw}")
        self._history.pop()
        self._total = before
        self._accept(time_s, raw, bits, out)
        return True

    def _bits_from(self, start: int, raw: int, interval: float, period_s: float) -> int | None:
        """Return the number of bits from one raw value to another; None if it is impossible or ambiguous."""
        low, high = self._possible_bits(interval, period_s)
        bits = low + ((raw - start - low) % self._modulus)
        return bits if bits <= high < bits + self._modulus else None

    def _drop_suspect(self, suspect: tuple[float, int], out: list[Event]) -> None:
        """Report the suspect reading as a single jump, and forget it."""
        self._faults.note(out, suspect[0], "jump", self.wheel, f"single odd value {suspect[1]}")
        self._suspect = None

    def _resolve_rollovers(
        self, time_s: float, raw: int, interval: float, period_s: float, out: list[Event]
    ) -> None:
        """Hold the reading with the one number of roll-overs that fits the speed; begin a segment where
        several or none fit."""
        assert self._raw is not None
        if self._speed != self._speed:
            # Nothing is known of the speed. Counters are built so that one period is never ambiguous,
            # so the smallest way forward is right unless a frame is missing.
            if 0.0 < interval < 1.5 * period_s:
                self._accept(time_s, raw, (raw - self._raw) % self._modulus, out)
            else:
                self._begin_segment(time_s, raw, out)
            return
        distance, slack = self._speed * interval, self._slack_bits(interval) + abs(self._speed) * period_s
        low, high = math.ceil(distance - slack), distance + slack
        bits = low + ((raw - self._raw - low) % self._modulus)
        if bits > high or bits + self._modulus <= high:
            self._begin_segment(time_s, raw, out)
        else:
            self._held = (time_s, raw, bits)

    def _end_gap(self, time_s: float, raw: int, period_s: float, out: list[Event]) -> bool:
        """Judge the held first reading after a gap by the time of the second one, `raw`; return True if that
        has begun a segment.

        Frames that follow at once were queued up: then it was no gap but a delay, the wheel had turned far
        less than the time stamps say, and the number of roll-overs is not known.
        """
        assert self._held is not None
        held_s, held_raw, bits = self._held
        self._held = None
        if time_s - held_s < 0.25 * period_s:
            self._begin_segment(time_s, raw, out)
            return True
        self._accept(held_s, held_raw, bits, out)
        return False


def _window_starts(times: FloatArray, known: int) -> IntArray:
    """Return the index of the last reading at least `SPEED_WINDOW_S` before each new one (n,), or 0.

    `times` (known + n,): those of the `known` readings of the history, then of the new ones.
    """
    time_s = times[known:]
    first = np.maximum(np.searchsorted(times, time_s - SPEED_WINDOW_S, side="right") - 1, 0)
    # The difference is what is compared one by one: it may round otherwise than the time that is sought.
    first += time_s - times[np.minimum(first + 1, len(times) - 1)] >= SPEED_WINDOW_S
    first -= (time_s - times[first] < SPEED_WINDOW_S) & (first > 0)
    return np.minimum(first, np.arange(known - 1, len(times) - 1))
