"""Readings taken at once against the same readings one by one, to the last bit."""

from __future__ import annotations

import copy
import warnings
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.onboard.sources.ahead.regular_readings import RegularReadings
from tpmsd.onboard.sources.can.faults import FaultLog
from tpmsd.onboard.sources.events import Event, RotationSample
from tpmsd.onboard.sources.wheel_counter import WheelCounter
from tpmsd.onboard.sources.wheel_speed import WheelSpeedIntegrator

KNOWN = 40
"""Readings that the tracker has taken before."""
Tracker = WheelCounter | WheelSpeedIntegrator


def state(tracker: Tracker) -> dict[str, Any]:
    """All that a tracker knows; what a still wheel once knew is of no more use."""
    names = set(type(tracker).__slots__) - {"_faults", "_withheld", "_run_speed"}
    return {name: repr(getattr(tracker, name)) for name in names}


def assert_alike(
    tracker: Tracker, taken: RegularReadings, times: list[float], values: list[Any], period_s: float
) -> None:
    """Readings before the first irregular one give the same angles; if all are regular, the same state."""
    other = copy.deepcopy(tracker)
    out: list[Event] = []
    for time_s, value in zip(times[: taken.regular], values[: taken.regular], strict=True):
        other.update(time_s, value, period_s, out)
    angles = [event.angle_rad for event in out if isinstance(event, RotationSample)]
    assert angles == taken.angle_rad[: taken.regular].tolist()
    assert len(angles) == len(out)
    if taken.regular == len(times) > 0:
        taken.commit()
        assert state(other) == state(tracker)


def drive(period_s: float, speed_mps: float, accel_mps2: float, jitter: list[float]) -> tuple[Any, Any]:
    """Times on a host clock of today, at multiples of the period but for the jitter, and ways."""
    count = KNOWN + len(jitter)
    late = np.concatenate([np.zeros(KNOWN), 0.3 * period_s * np.array(jitter)])
    time_s = np.round(1719820800.0 + period_s * np.arange(count) + late, 6)
    since = period_s * np.arange(count)
    return time_s, speed_mps * since + 0.5 * accel_mps2 * np.maximum(since - KNOWN * period_s, 0.0) ** 2


PERIODS = st.sampled_from([0.005, 0.01, 0.02, 0.025, 0.05, 0.1])
JITTER = st.lists(st.sampled_from([0.0, 0.0, 0.0, 0.1, 0.9]), min_size=1, max_size=120)


@settings(derandomize=True, deadline=None, max_examples=200)
@given(
    PERIODS,
    st.floats(-8.0, 60.0),
    st.floats(-9.0, 9.0),
    JITTER,
    st.sampled_from([0.5, 1.0, 4.0]),
    st.sampled_from([256, 1001, 65536]),
    st.lists(st.tuples(st.integers(0, 119), st.integers(-300, 300)), max_size=2),
)
def test_counters(
    period_s: float,
    speed_mps: float,
    accel_mps2: float,
    jitter: list[float],
    per_bit: float,
    modulus: int,
    odd: list[tuple[int, int]],
) -> None:
    """At any speed, forward or back, braking to a stop or with odd values: the same angles and state."""
    time_s, distance_m = drive(period_s, speed_mps, accel_mps2, jitter)
    raw = np.floor(distance_m / (2 * np.pi * 0.316) * 48 / per_bit).astype(np.int64)
    for place, error in odd:
        if place < len(jitter):
            raw[KNOWN + place] += error
    raw %= modulus
    tracker = WheelCounter(0, modulus, per_bit, 48.0, 0.316, FaultLog())
    for at in range(KNOWN):
        tracker.update(float(time_s[at]), int(raw[at]), period_s, [])
    later, values = time_s[KNOWN:], raw[KNOWN:]
    taken = tracker.regular_readings(later, values, np.full(len(later), period_s))
    assert_alike(tracker, taken, later.tolist(), values.tolist(), period_s)


@settings(derandomize=True, deadline=None, max_examples=100)
@given(
    PERIODS, JITTER, st.sampled_from([256, 65536]), st.lists(st.integers(0, 119), max_size=1), st.booleans()
)
def test_counters_that_stand(
    period_s: float, jitter: list[float], modulus: int, moved: list[int], released: bool
) -> None:
    """Once the wheels together have shown that the car stands, all is regular up to the next change."""
    time_s, _ = drive(period_s, 0.0, 0.0, jitter)
    raw = np.full(len(time_s), 17)
    for place in moved:
        raw[KNOWN + place :] += 1
    tracker = WheelCounter(0, modulus, 1.0, 48.0, 0.316, FaultLog())
    for at in range(KNOWN):
        tracker.update(float(time_s[at]), int(raw[at]), period_s, [])
    if released:
        tracker.mark_standstill()
    later, values = time_s[KNOWN:], raw[KNOWN:]
    taken = tracker.regular_readings(later, values, np.full(len(later), period_s))
    assert min([*moved, len(later)]) * released == taken.regular
    assert_alike(tracker, taken, later.tolist(), values.tolist(), period_s)


@settings(derandomize=True, deadline=None, max_examples=100)
@given(PERIODS, st.floats(0.0, 60.0), st.floats(-9.0, 9.0), JITTER, st.sampled_from([0.0, 0.01, 0.5]))
def test_speeds(
    period_s: float, speed_mps: float, accel_mps2: float, jitter: list[float], step_mps: float
) -> None:
    """Fine and coarse speeds, also such as stay the same for long: the same angles and state."""
    time_s, distance_m = drive(period_s, speed_mps, accel_mps2, jitter)
    speed = np.diff(distance_m, append=distance_m[-1]) / period_s
    omega = (np.round(speed / step_mps) * step_mps if step_mps else speed) / 0.316
    tracker = WheelSpeedIntegrator(0, 0.316, FaultLog())
    for at in range(KNOWN):
        tracker.update(float(time_s[at]), float(omega[at]), period_s, [])
    later, values = time_s[KNOWN:], omega[KNOWN:]
    taken = tracker.regular_readings(later, values, np.full(len(later), period_s))
    assert_alike(tracker, taken, later.tolist(), values.tolist(), period_s)


@pytest.mark.parametrize("modulus", [256, 1001, 65536])
@pytest.mark.parametrize(("period_s", "speed_mps"), [(0.01, 20.0), (0.02, 20.0), (0.05, 20.0), (0.02, -5.0)])
def test_a_steady_drive_is_regular(period_s: float, speed_mps: float, modulus: int) -> None:
    """At a steady speed, forward or back, on a steady clock no reading is irregular."""
    time_s, distance_m = drive(period_s, speed_mps, 0.0, [0.0] * 100)
    raw = np.floor(distance_m / (2 * np.pi * 0.316) * 48).astype(np.int64) % modulus
    tracker = WheelCounter(0, modulus, 1.0, 48.0, 0.316, FaultLog())
    for at in range(KNOWN):
        tracker.update(float(time_s[at]), int(raw[at]), period_s, [])
    assert 100 == tracker.regular_readings(time_s[KNOWN:], raw[KNOWN:], np.full(100, period_s)).regular


def turning(readings: int, speed_mps: float = 20.0) -> tuple[WheelCounter, list[float], list[int]]:
    """A counter after `KNOWN` readings at 100 Hz, and those that come then."""
    time_s, distance_m = drive(0.01, speed_mps, 0.0, [0.0] * readings)
    raw = np.floor(distance_m / (2 * np.pi * 0.316) * 48).astype(np.int64) % 65536
    tracker = WheelCounter(0, 65536, 1.0, 48.0, 0.316, FaultLog())
    for at in range(KNOWN):
        tracker.update(float(time_s[at]), int(raw[at]), 0.01, [])
    return tracker, time_s[KNOWN:].tolist(), raw[KNOWN:].tolist()


def ahead(tracker: WheelCounter, times: list[float], values: list[int]) -> RegularReadings:
    return tracker.regular_readings(np.array(times), np.array(values), np.full(len(times), 0.01))


def test_a_value_that_was_not_renewed_ends_what_is_regular() -> None:
    """At 20 m/s an unchanged count is no reading after 10 ms, with all that follows taken one by one."""
    tracker, times, values = turning(30)
    values[12] = values[13] = values[11]
    taken = ahead(tracker, times, values)

    assert 12 == taken.regular
    assert_alike(tracker, taken, times, values, 0.01)


@pytest.mark.parametrize("readings", [3, 7, 8, 12])
def test_a_new_segment_keeps_the_speed_of_before_for_80_ms(readings: int) -> None:
    """A speed over less than that is too coarse to bound the next reading."""
    tracker, times, values = turning(readings, 20.3)
    times = [time_s + 61.0 for time_s in times]
    tracker.update(times[0] - 0.01, values[0] - 5, 0.01, [])
    taken = ahead(tracker, times, values)

    assert readings == taken.regular
    assert_alike(tracker, taken, times, values, 0.01)


def test_a_wheel_that_creeps_is_regular() -> None:
    """At 0.8 m/s a count lasts for 50 ms, in which a wheel that brakes may have stopped: no value is old."""
    tracker, times, values = turning(100, 0.8)
    changed = [k for k in range(1, 100) if values[k] != values[k - 1]]
    begin, end = changed[0] + 1, changed[-1] + 1
    for time_s, value in zip(times[:begin], values[:begin], strict=True):
        tracker.update(time_s, value, 0.01, [])
    times, values = times[begin:end], values[begin:end]
    taken = ahead(tracker, times, values)

    assert len(values) == taken.regular > 80
    assert_alike(tracker, taken, times, values, 0.01)


def test_bounds_are_narrow_again_soon_after_a_gap() -> None:
    """After a gap of a second 25 bits too many are possible in 100 ms; a few readings later they are not."""
    period_s, gap_s = 0.1, 1.0
    times = np.append(period_s * np.arange(40), 3.9 + gap_s + period_s * np.arange(12))
    raw = np.floor(times * 5.0 / (2 * np.pi * 0.316) * 48).astype(np.int64)
    raw[-3] += 25
    tracker = WheelCounter(0, 65536, 1.0, 48.0, 0.316, FaultLog())
    for at in range(41):
        tracker.update(float(times[at]), int(raw[at]), period_s, [])
    later, values = times[41:].tolist(), raw[41:].tolist()
    taken = tracker.regular_readings(np.array(later), np.array(values), np.full(len(later), period_s))

    assert 8 == taken.regular
    assert_alike(tracker, taken, later, values, period_s)


def test_a_gap_over_which_the_counter_may_roll_over_is_not_regular() -> None:
    """A counter of six bits at 6.2 m/s: 45 bits in 300 ms may be 109 as well."""
    times = np.append(0.02 * np.arange(KNOWN + 5), 0.02 * (KNOWN + 4) + 0.3)
    raw = np.floor(times * 6.2 / (2 * np.pi * 0.316) * 48).astype(np.int64) % 64
    tracker = WheelCounter(0, 64, 1.0, 48.0, 0.316, FaultLog())
    for at in range(KNOWN):
        tracker.update(float(times[at]), int(raw[at]), 0.02, [])
    later, values = times[KNOWN:].tolist(), raw[KNOWN:].tolist()
    taken = tracker.regular_readings(np.array(later), np.array(values), np.full(len(later), 0.02))

    assert 5 == taken.regular
    assert_alike(tracker, taken, later, values, 0.02)


def test_nothing_is_regular_while_no_speed_is_known() -> None:
    """Behind the first reading of all the bounds are those of a wheel of which nothing is known."""
    tracker = WheelCounter(0, 65536, 1.0, 48.0, 0.316, FaultLog())
    tracker.update(1.0, 17, 0.01, [])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert 0 == ahead(tracker, [1.01, 1.02], [17, 18]).regular


@pytest.mark.parametrize("odd", [1, 2])
def test_nothing_is_regular_while_a_reading_is_doubted(odd: int) -> None:
    """Behind a value that nothing bears out the readings go one by one until it is dropped."""
    tracker, times, values = turning(30)
    for at in range(odd):
        tracker.update(times[at], values[at] + 20000 + 7000 * at, 0.01, [])
    assert 0 == ahead(tracker, times[odd:], values[odd:]).regular
    tracker.update(times[odd], values[odd], 0.01, [])
    tracker.update(times[odd + 1], values[odd + 1], 0.01, [])
    taken = ahead(tracker, times[odd + 2 :], values[odd + 2 :])
    assert len(times) - odd - 2 == taken.regular
    assert_alike(tracker, taken, times[odd + 2 :], values[odd + 2 :], 0.01)


def test_nothing_is_regular_behind_a_value_that_was_not_renewed() -> None:
    """The next that changed goes by itself: it is judged over the time since the last that counted."""
    tracker, times, values = turning(30)
    tracker.update(times[0], values[0], 0.01, [])
    for at in range(1, 4):
        tracker.update(times[at], values[0], 0.01, [])
    assert 0 == ahead(tracker, times[4:], values[4:]).regular
