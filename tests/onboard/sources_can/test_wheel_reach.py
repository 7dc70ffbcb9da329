"""How far a wheel can have turned between two readings: the bounds themselves, to the last bit."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.onboard.sources_can.build import RADIUS_M, TEETH, rotations
from tpmsd.onboard.sources.can.faults import FaultLog
from tpmsd.onboard.sources.events import Event, SourceFault
from tpmsd.onboard.sources.wheel_counter import WheelCounter

PERIOD_S = 1.0 / 128.0
"""A binary fraction, so that sums of periods are exact."""
SPAN_S = 13 * PERIOD_S
"""The shortest run of periods that is not less than 0.1 s: over it the speed is taken."""
MODULUS = 1 << 32
START = 1 << 31


class Fine:
    """An encoder of half a millimetre, driven for two seconds by the same number of bits each period."""

    def __init__(self, bits_per_period: int | None) -> None:
        """`bits_per_period`: None for a counter of which one reading is known."""
        self.faults, self.out = FaultLog(), list[Event]()
        self.counter = WheelCounter(0, MODULUS, TEETH / 4000.0, TEETH, RADIUS_M, self.faults)
        self.raw, self.time_s = START, 0.0
        self.read(0.0, 0, PERIOD_S)
        for _ in range(0 if bits_per_period is None else 256):
            assert self.read(PERIOD_S, bits_per_period or 0, PERIOD_S)

    def read(self, interval_s: float, bits: int, period_s: float) -> bool:
        """Whether the next reading is taken for what it says."""
        self.time_s, self.raw, before = self.time_s + interval_s, (self.raw + bits) % MODULUS, len(self.out)
        self.counter.update(self.time_s, self.raw, period_s, self.out)
        return 1 == len(rotations(self.out[before:])) and not self.faults.counts and not self.counter.segment


def bounds(bits_per_period: int | None, interval_s: float, period_s: float) -> tuple[int, int]:
    """Least and greatest number of bits, by the module's own words.

    The wheel gains 25 m/s2, or locks; it turns by 100 m/s at most, by 10 m/s backward while nothing is known;
    the stamp may be off by a period; each end is rounded, and the speed too, by a bit over its span.
    """
    bit_m = 2.0 * math.pi / 4000.0 * RADIUS_M
    late_s = period_s + abs(interval_s - period_s) if period_s else interval_s
    limit = 100.0 / bit_m * (interval_s + (period_s or interval_s))
    if bits_per_period is None:
        return -int(10.0 / bit_m * interval_s + 3.0), math.floor(limit)
    speed = bits_per_period / PERIOD_S
    gain = 0.5 * 25.0 / bit_m * interval_s * (SPAN_S + interval_s)
    slack = gain + 3.0 + interval_s / SPAN_S
    way = speed * interval_s
    if speed >= 0.0:
        return math.ceil(min(way - slack, -3.0)), math.floor(min(way + slack + speed * late_s, limit))
    return math.ceil(max(way - slack + speed * late_s, -limit)), math.floor(max(way + slack, 3.0))


@pytest.mark.parametrize("period_s", [PERIOD_S, 0.0], ids=["periodic", "on event"])
@pytest.mark.parametrize("periods", [1, 4, 64, 4096])
@pytest.mark.parametrize("bits_per_period", [None, 0, 300, 1500, -100])
def test_a_reading_is_taken_up_to_the_last_bit_that_the_wheel_can_have_turned(
    bits_per_period: int | None, periods: int, period_s: float
) -> None:
    """At any speed before, forward and backward, after a period and after seconds without a frame."""
    interval_s = periods * PERIOD_S
    least, most = bounds(bits_per_period, interval_s, period_s)
    taken = {
        bits: Fine(bits_per_period).read(interval_s, bits, period_s)
        for bits in (least - 1, least, most, most + 1)
    }

    assert {least - 1: False, least: True, most: True, most + 1: False} == taken


@pytest.mark.parametrize("period_s", [PERIOD_S, 0.0], ids=["periodic", "on event"])
@pytest.mark.parametrize("periods", [1, 4, 64, 4096])
@pytest.mark.parametrize("bits_per_period", [300, 1500, -100])
def test_a_reading_ahead_is_regular_up_to_the_last_bit(
    bits_per_period: int, periods: int, period_s: float
) -> None:
    """Readings taken at once keep to the same bounds, forward and backward, with and without a period."""
    wheel, interval_s = Fine(bits_per_period), periods * PERIOD_S
    least, most = bounds(bits_per_period, interval_s, period_s)
    at = np.array([wheel.time_s + interval_s])
    regular = {
        bits: wheel.counter.regular_readings(
            at, np.array([(wheel.raw + bits) % MODULUS]), np.array([period_s])
        ).regular
        for bits in (least - 1, least, most, most + 1)
    }

    assert {least - 1: 0, least: 1, most: 1, most + 1: 0} == regular


@pytest.mark.parametrize(("interval_s", "taken"), [(60.0, True), (60.0 + PERIOD_S, False)])
def test_after_a_minute_nobody_knows_the_counter(interval_s: float, taken: bool) -> None:
    """A minute without a frame is bridged, more begins a segment."""
    assert taken == Fine(100).read(interval_s, 128 * 6000, PERIOD_S)


def test_the_distance_is_that_of_all_segments_and_the_speed_that_of_the_last_readings() -> None:
    """Both by the nominal radius; nothing is known of the speed after one reading."""
    wheel = Fine(None)
    assert math.isnan(wheel.counter.speed_mps)
    wheel = Fine(300)
    bit_m = 2.0 * math.pi / 4000.0 * RADIUS_M
    assert math.isclose(256 * 300 * bit_m, wheel.counter.travel_m)
    assert math.isclose(300 / PERIOD_S * bit_m, wheel.counter.speed_mps)
    wheel.counter.restart()
    assert math.isnan(wheel.counter.speed_mps)
    wheel.read(PERIOD_S, 5000, PERIOD_S)
    wheel.read(PERIOD_S, 100, PERIOD_S)
    assert (1, 256 * 300 + 100) == (wheel.counter.segment, round(wheel.counter.travel_m / bit_m))


@pytest.mark.parametrize(
    ("after_s", "others_bits", "stuck"),
    [
        (0.5, [9.0, 9.0], None),
        (0.51, [9.0, 9.0], True),
        (0.51, [4.0, -4.0, 0.0], True),
        (0.51, [9.0, 3.9, 0.0], False),
        (0.51, [9.0], True),
        (0.51, [], False),
    ],
)
def test_a_wheel_is_stuck_when_two_others_have_turned(
    after_s: float, others_bits: list[float], stuck: bool | None
) -> None:
    """By four bits each, either way, for more than half a second; by one where there is but one."""
    wheel = Fine(0)
    since_s = wheel.counter.still_since
    assert since_s == 0.0
    distances = [bits * wheel.counter.m_per_bit for bits in others_bits]

    assert stuck == wheel.counter.is_stuck(since_s + after_s, distances)


def test_a_stuck_counter_begins_anew_when_its_value_changes() -> None:
    """Until then it gives no sample, and nothing is counted."""
    wheel = Fine(0)
    wheel.counter.mark_stuck()
    assert not wheel.read(PERIOD_S, 0, PERIOD_S)
    assert (True, 0) == (wheel.counter.stuck, wheel.counter.segment)
    wheel.read(PERIOD_S, 1, PERIOD_S)

    assert (False, 1, {}) == (wheel.counter.stuck, wheel.counter.segment, dict(wheel.faults.counts))


@pytest.mark.parametrize("ahead", [False, True], ids=["one by one", "ahead"])
@pytest.mark.parametrize("way", [-1, 1])
def test_the_slowest_wheel_has_a_direction(way: int, ahead: bool) -> None:
    """A bit in four seconds, forward or backward: the bounds are those of a wheel that turns that way."""
    fine = Fine(None)
    fine.read(4.0, way, 4.0)
    gain, limit = 0.5 * 25.0 * 4.0 * 8.0 / fine.counter.m_per_bit, 100.0 / fine.counter.m_per_bit * 8.0
    slack = gain + 3.0 + 1.0
    least, most = (-slack - 1.0, slack + 2.0) if way > 0 else (-slack - 2.0, slack - 1.0)
    if way > 0:
        least = -slack + 1.0
    assert most < limit
    taken = {}
    for bits in (math.ceil(least) - 1, math.ceil(least), math.floor(most), math.floor(most) + 1):
        wheel = Fine(None)
        wheel.read(4.0, way, 4.0)
        if ahead:
            at, raw = np.array([wheel.time_s + 4.0]), np.array([(wheel.raw + bits) % MODULUS])
            taken[bits] = 1 == wheel.counter.regular_readings(at, raw, np.array([4.0])).regular
        else:
            taken[bits] = wheel.read(4.0, bits, 4.0)

    assert [False, True, True, False] == list(taken.values())


def test_a_fault_bears_the_time_of_the_reading_that_was_doubted() -> None:
    """A new level is known with the second reading of it; it began with the first."""
    wheel = Fine(300)
    doubted_s = wheel.time_s + PERIOD_S
    wheel.read(PERIOD_S, 1 << 20, PERIOD_S)
    wheel.read(PERIOD_S, 300, PERIOD_S)

    (fault,) = [event for event in wheel.out if isinstance(event, SourceFault)]
    assert ("jump", doubted_s) == (fault.kind, fault.time_s)
