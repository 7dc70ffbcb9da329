"""Readings of one wheel, or of one signal, in which nothing is odd: taken at once.

In: what a `WheelCounter` or `WheelSpeedIntegrator` knows, and the readings that come. Out: the angles that it
would give one by one, what it knows behind them, and the first reading that it would doubt. The formulas are
those of `wheel_counter` and `wheel_speed`, in the same order of operations, so that the numbers are the same
to the last bit (`tests/onboard/sources_can/test_even_readings.py`). Nothing is changed before `settle`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.sources.can_arrival import MIN_TIMEOUT_S, TIMEOUT_PERIODS
from tpmsd.onboard.sources.settings import SETTINGS
from tpmsd.onboard.sources.wheel_counter import (
    MAX_ACCEL_MPS2,
    MAX_SPEED_MPS,
    REPEATED_BITS,
    SLACK_BITS,
    SPEED_WINDOW_S,
    STUCK_S,
    WheelCounter,
)
from tpmsd.onboard.sources.wheel_speed import SLACK_MPS, WheelSpeedIntegrator

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Even:
    """n readings."""

    angle_rad: FloatArray
    """(n,) since the segment began."""
    still_since_s: FloatArray
    """(n,) when the value stopped changing; NaN while it changes."""
    odd: int
    """Place of the first reading that is not to be taken like this; n if there is none. What is said of those
    behind it means nothing."""
    settle: Callable[[], None]
    """Makes the tracker one that has taken all n."""


def _nothing() -> None:
    """Settles what was odd from the start."""


def _odd_from_the_start(count: int) -> Even:
    return Even(np.zeros(count), np.full(count, np.nan), 0, _nothing)


def _first(odd: BoolArray) -> int:
    """Place of the first True; the length if there is none."""
    return int(np.argmax(odd)) if odd.any() else len(odd)


def _still(same: BoolArray, before_s: FloatArray) -> tuple[IntArray, FloatArray]:
    """Per reading, where the run of unchanged values began (its own place where there is none), and the time
    of the reading before that (NaN)."""
    places = np.arange(len(same))
    begin = np.maximum.accumulate(np.where(same, -1, places)) + 1
    begin = np.where(same, begin, places)
    return begin, np.where(same, before_s[begin], np.nan)


def _too_long(begin: IntArray, odd: BoolArray) -> int:
    """Where the first run begins that has an odd reading, or goes on beyond the last."""
    return int(begin[odd].min()) if odd.any() else len(odd)


def even_counts(counter: WheelCounter, time_s: FloatArray, raw: IntArray, period_s: FloatArray) -> Even:
    """(n,) readings of a counter at rising times, with the message's period at each. Those of one that
    stands are even as long as they stay the same."""
    count, stands = len(time_s), counter.stands
    if (
        counter._raw is None
        or counter.stuck
        or (counter.still_since is not None and not stands)
        or counter._held is not None
        or counter._suspect is not None
        or counter._odd
        or counter._speed != counter._speed
        or counter._history[-1][0] != counter._time_s
        or counter._same_s != counter._time_s
    ):
        return _odd_from_the_start(count)
    modulus, accel = counter._modulus, counter._accel
    step = np.diff(raw, prepend=counter._raw)
    # Which number of bits a step is depends on the speed, and that on the steps: guessed, then judged.
    bits = (step + modulus // 4) % modulus - modulus // 4
    known = len(counter._history)
    times = np.concatenate([[at for at, _ in counter._history], time_s])
    totals = np.concatenate([[total for _, total in counter._history], counter._total + np.cumsum(bits)])
    before_s = times[known - 1 : -1]
    interval = time_s - before_s

    first = _window(times, known)
    span = time_s - times[first]
    wide = span >= 0.8 * SPEED_WINDOW_S
    latest = np.maximum.accumulate(np.where(wide, np.arange(count), -1))
    with np.errstate(divide="ignore"):
        speeds = np.append((totals[known:] - totals[first]) / span, counter._speed)[latest]
    spans = np.append(span, counter._span)[latest]
    speed, width = np.append(counter._speed, speeds)[:-1], np.append(counter._span, spans)[:-1]

    low, high = _possible(counter, speed, width, interval, period_s)
    least = low + (step - low) % modulus
    odd = (least != bits) | (bits > high) | (bits + modulus <= high)
    same = bits == 0
    begin, since = _still(same, before_s)
    if stands:
        even = _first(odd | ~same)
        since = np.full(count, counter.still_since)
    else:
        run = np.where(same, time_s - since, 0.0)
        way = np.abs(speed[begin]) * run - 0.5 * accel * run * (width + run)
        last = np.arange(count) == count - 1
        long = same & ((way >= REPEATED_BITS) | (run > STUCK_S) | last)
        even = min(_first(odd), _too_long(begin, long))

    def settle() -> None:
        counter._total, counter._raw = int(totals[-1]), int(raw[-1])
        counter._time_s = counter._same_s = float(time_s[-1])
        counter._history.clear()
        counter._history.extend(zip(times[first[-1] :].tolist(), totals[first[-1] :].tolist(), strict=True))
        counter._speed, counter._span = float(speeds[-1]), float(spans[-1])
        counter._released = stands
        if same.any() and not stands:
            counter._run_speed = float(speed[begin[same][-1]])
            counter._withheld = False

    angle = (totals[known:] - counter._base) * counter.rad_per_bit
    return Even(angle, since, even, settle)


def _window(times: FloatArray, known: int) -> IntArray:
    """Per new reading, the place of the last one that is at least `SPEED_WINDOW_S` before it; else 0."""
    time_s = times[known:]
    first = np.maximum(np.searchsorted(times, time_s - SPEED_WINDOW_S, side="right") - 1, 0)
    # The difference is what is compared one by one: it may round otherwise than the time that is sought.
    first += time_s - times[np.minimum(first + 1, len(times) - 1)] >= SPEED_WINDOW_S
    first -= (time_s - times[first] < SPEED_WINDOW_S) & (first > 0)
    return np.minimum(first, np.arange(known - 1, len(times) - 1))


def _possible(
    counter: WheelCounter, speed: FloatArray, span: FloatArray, interval: FloatArray, period_s: FloatArray
) -> tuple[IntArray, FloatArray]:
    """As `WheelCounter._possible`."""
    stamp = np.where(period_s <= 0.0, interval, period_s + np.abs(interval - period_s))
    limit = counter._max_speed * (interval + np.where(period_s > 0.0, period_s, interval))
    way = speed * interval
    slack = 0.5 * counter._accel * interval * (span + interval) + SLACK_BITS + interval / span
    forward = speed >= 0.0
    low = np.where(
        forward, np.minimum(way - slack, -SLACK_BITS), np.maximum(way - slack + speed * stamp, -limit)
    )
    high = np.where(
        forward, np.minimum(way + slack + speed * stamp, limit), np.maximum(SLACK_BITS, way + slack)
    )
    return np.ceil(low).astype(np.int64), high


def even_speeds(
    tracker: WheelSpeedIntegrator, time_s: FloatArray, omega_radps: FloatArray, period_s: FloatArray
) -> Even:
    """(n,) readings of a speed at rising times, with the message's period at each."""
    count = len(time_s)
    if (
        tracker._omega is None
        or tracker.stuck
        or tracker.still_since is not None
        or tracker._suspect is not None
    ):
        return _odd_from_the_start(count)
    radius_m = tracker.radius_m
    before = np.append(tracker._omega, omega_radps)[:-1]
    before_s = np.append(tracker._time_s, time_s)[:-1]
    interval = time_s - before_s
    change = np.abs(omega_radps - before) * radius_m
    odd = np.abs(omega_radps) * radius_m > MAX_SPEED_MPS
    odd |= ~(change <= MAX_ACCEL_MPS2 * (interval + 2.0 * period_s) + SLACK_MPS)
    odd |= interval > np.maximum(MIN_TIMEOUT_S, TIMEOUT_PERIODS * period_s)
    turned = 0.5 * (before + omega_radps) * interval
    angle = np.add.accumulate(np.append(tracker._angle, turned))
    way = np.add.accumulate(np.append(tracker._turned, turned))
    same = omega_radps == before
    begin, since = _still(same, before_s)
    run = np.where(same, time_s - since, 0.0)
    last = np.arange(count) == count - 1
    long = same & ((run > np.where(omega_radps == 0.0, STUCK_S, SETTINGS.frozen_s)) | last)

    def settle() -> None:
        tracker._omega, tracker._time_s = float(omega_radps[-1]), float(time_s[-1])
        tracker._angle, tracker._turned = float(angle[-1]), float(way[-1])

    return Even(angle[1:], since, min(_first(odd), _too_long(begin, long)), settle)
