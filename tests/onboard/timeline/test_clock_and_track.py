"""The host clock's own line of time, and one wheel's angle along it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.onboard.sources.events import RotationRun, RotationSample
from tpmsd.onboard.timeline.host_clock import HostClock
from tpmsd.onboard.timeline.plausible import implausible_wheels
from tpmsd.onboard.timeline.reading_track import ReadingTrack
from tpmsd.onboard.timeline.rotation_track import MAX_BRIDGE_S, RotationTrack, rotation_between


def test_an_ordinary_clock_is_left_as_it_is() -> None:
    """Logical time is host time until the clock steps back."""
    clock = HostClock()
    assert [5.0, 5.1, 5.05, 90.0] == [clock.advance(t) for t in (5.0, 5.1, 5.05, 90.0)]
    assert (0, 90.0) == (clock.steps, clock.to_host(90.0))


def test_a_step_back_goes_on_from_where_time_was() -> None:
    """After an hour back, time runs on by as much as the host's stamps do, and maps back to them."""
    clock = HostClock()
    clock.advance(10_000.0)
    first = clock.advance(6_400.0)
    assert 10_000.0 < first <= 10_000.1
    assert first + 2.5 == pytest.approx(clock.advance(6_402.5))
    assert 6_402.5 == pytest.approx(clock.to_host(first + 2.5))
    assert 1 == clock.steps


@settings(derandomize=True, deadline=None)
@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=40))
def test_logical_time_never_goes_back_further_than_jitter(stamps: list[float]) -> None:
    """Whatever stamps come, logical time stays within half a second of its latest; steps are counted."""
    clock = HostClock()
    latest = -math.inf
    for stamp in stamps:
        logical = clock.advance(stamp)
        assert logical >= latest - 0.5 - 1e-6
        assert stamp == pytest.approx(clock.to_host(logical), abs=1e-6)
        latest = max(latest, logical)
    assert (clock.steps == 0) == all(stamp >= max(stamps[: k + 1]) - 0.5 for k, stamp in enumerate(stamps))


def sample(time_s: float, angle_rad: float, segment: int = 0, quantum_rad: float = 0.13) -> RotationSample:
    return RotationSample(time_s, 2, angle_rad, quantum_rad, segment)


def track(*samples: RotationSample) -> RotationTrack:
    made = RotationTrack()
    for reading in samples:
        made.add(reading)
    return made


def test_the_angle_between_readings_is_interpolated() -> None:
    """Halfway between two readings the angle is halfway too, and at a reading it is the reading."""
    two = track(sample(1.0, 10.0), sample(1.2, 14.0))
    assert (12.0, 0) == pytest.approx(two.angle_at(1.1)[:2])  # type: ignore[index]
    assert (14.0, 0, 0.13) == two.angle_at(1.2)
    assert two.angle_at(0.99) is None
    assert two.angle_at(1.21) is None


def test_nothing_is_interpolated_across_segments_or_pauses() -> None:
    """Between readings of two segments, or too far apart, the angle is not known."""
    assert track(sample(1.0, 10.0), sample(1.1, 0.0, segment=1)).angle_at(1.05) is None
    assert track(sample(1.0, 10.0), sample(1.0 + MAX_BRIDGE_S + 0.01, 20.0)).angle_at(1.3) is None
    both = track(sample(1.0, 10.0), sample(1.1, 11.0), sample(1.2, 0.0, 1), sample(1.3, 1.0, 1))
    rotation, std = rotation_between(both, 1.05, 1.25)
    assert math.isnan(rotation)
    assert math.isnan(std)


def test_readings_that_are_not_newer_are_left_out() -> None:
    """A repeated or late reading does not bend the angle."""
    late = track(
        sample(1.0, 10.0), sample(1.2, 14.0), sample(1.2, 99.0), sample(1.1, 77.0), sample(1.4, 18.0)
    )
    assert (12.0, 0) == pytest.approx(late.angle_at(1.1)[:2])  # type: ignore[index]
    assert (16.0, 0) == pytest.approx(late.angle_at(1.3)[:2])  # type: ignore[index]


def test_the_reading_error_is_that_of_two_uniform_counts() -> None:
    """Variance of a difference of two floors of one quantum: q^2 / 6."""
    _, std = rotation_between(track(sample(0.0, 0.0), sample(0.5, 6.0)), 0.1, 0.2)
    assert 0.13**2 / 6 == pytest.approx(std**2)


def test_forgetting_keeps_what_the_next_instant_needs() -> None:
    """After dropping old readings the angle from that instant on is as before."""
    full = track(*(sample(k * 0.1, k * 1.0) for k in range(20)))
    before = [full.angle_at(1.25), full.angle_at(1.3), full.angle_at(1.61)]
    full.forget_before(1.25)
    assert before == [full.angle_at(1.25), full.angle_at(1.3), full.angle_at(1.61)]
    assert full.angle_at(1.0) is None


@pytest.mark.parametrize(("back_s", "steps"), [(0.5, 0), (0.5625, 1)])
def test_half_a_second_back_is_a_late_frame(back_s: float, steps: int) -> None:
    """More is a step of the clock, over which 10 ms are taken to have passed."""
    clock = HostClock()
    clock.advance(64.0)
    expected_s = 64.01 if steps else 64.0 - back_s
    assert (expected_s, steps) == (clock.advance(64.0 - back_s), clock.steps)
    assert clock.latest_s == max(expected_s, 64.0)
    clock.advance(8.0)
    assert (steps + 1, 8.0) == (clock.steps, pytest.approx(clock.to_host(clock.latest_s)))


@pytest.mark.parametrize(("span_s", "known"), [(MAX_BRIDGE_S, True), (MAX_BRIDGE_S + 0.01, False)])
def test_readings_are_bridged_over_600_ms(span_s: float, known: bool) -> None:
    """One by one and ahead alike, up to the bound itself."""
    assert 0.6 == MAX_BRIDGE_S
    half = track(sample(0.0, 10.0), sample(span_s, 20.0)).angle_at(span_s / 2.0)
    assert (half == pytest.approx((15.0, 0, 0.13))) if known else half is None
    ahead = track(sample(0.0, 10.0)).rotations_ahead(
        np.array([span_s]), np.array([20.0]), 0, 0.13, np.array([0.0, span_s / 2.0])
    )
    assert ahead is not None
    assert [5.0 if known else math.nan] == pytest.approx(ahead.rotation_rad.tolist(), nan_ok=True)


def test_before_the_first_reading_nothing_is_known_ahead() -> None:
    """Of four intervals the first two begin before it; a reading on an edge is enough for that edge."""
    ahead = RotationTrack().rotations_ahead(
        np.array([0.25, 0.5, 1.0]),
        np.array([3.0, 4.0, 8.0]),
        0,
        0.13,
        np.array([0.0, 0.125, 0.25, 0.5, 0.75]),
    )
    assert ahead is not None
    assert [math.nan, math.nan, 1.0, 2.0] == pytest.approx(ahead.rotation_rad.tolist(), nan_ok=True)
    assert [1, 1, 2, 3] == ahead.needs.tolist()
    assert [True, True, False, False] == np.isnan(ahead.std_rad).tolist()


def test_one_edge_bounds_no_interval() -> None:
    """A reading behind the first edge alone gives nothing ahead."""
    assert (
        RotationTrack().rotations_ahead(np.array([1.0]), np.array([1.0]), 0, 0.13, np.array([0.5, 1.5]))
        is None
    )
    assert (
        RotationTrack().rotations_ahead(np.array([1.0]), np.array([1.0]), 0, 0.13, np.array([0.5, 1.0]))
        is not None
    )


def test_a_cleared_track_knows_nothing() -> None:
    """Not even the instant that was asked for last."""
    made = track(sample(1.0, 10.0), sample(1.2, 14.0))
    assert not made.is_empty
    assert made.angle_at(1.1) is not None
    made.clear()
    assert (True, None) == (made.is_empty, made.angle_at(1.1))


@pytest.mark.parametrize("first_s", [1.1, 1.2])
def test_a_run_that_begins_with_known_readings_leaves_them_out(first_s: float) -> None:
    """Up to the last that is known, whose angle stays; behind it the run is taken."""
    made = track(sample(1.0, 10.0), sample(1.2, 14.0))
    made.extend(RotationRun(2, 0, 0.13, [0, 1], [first_s, 1.4], [99.0, 16.0]))
    made.extend(RotationRun(2, 0, 0.13, [], [], []))
    assert [14.0, 15.0, 16.0] == pytest.approx([made.angle_at(t)[0] for t in (1.2, 1.3, 1.4)])  # type: ignore[index]


def test_forgetting_keeps_the_last_two_readings() -> None:
    """However late the instant: the next reading may have to be interpolated from them."""
    made = track(*(sample(0.5 * k, float(k)) for k in range(5)))
    made.forget_before(100.0)
    assert (None, 3.0, 3.5) == (made.angle_at(1.49), made.angle_at(1.5)[0], made.angle_at(1.75)[0])  # type: ignore[index]


@pytest.mark.parametrize(
    ("turned", "implausible"),
    [
        ([1.0, 1.0, 1.0, 2.0], []),
        ([1.0, 1.0, 1.0, 2.01], [3]),
        ([2.0, 1.0, 2.0, 2.0], []),
        ([2.0, 0.99, 2.0, 2.0], [1]),
        ([1.0, 1.2, 1.4, 2.59], []),  # of four the mean of the two in the middle, 1.3
        ([1.0, 1.2, 1.4, 2.61], [3]),
        ([math.nan, 1.0, 3.0, 1.0], [2]),
        ([2.0, math.nan, 1.0, math.nan], []),  # of two the one is twice the other
        ([2.0, math.nan, 0.99, math.nan], [0, 2]),
        ([math.nan, 5.0, math.nan, math.nan], []),
        ([-1.0, 1.0, 1.0, 1.0], [0]),
        ([math.nan] * 4, []),
        ([0.3, 0.3, 0.3, 0.89], []),  # too slow to be judged
        ([0.3, 0.3, 0.3, 0.91], [3]),
    ],
)
@pytest.mark.parametrize("dt_s", [0.1, 0.01])
def test_a_wheel_that_turns_twice_the_median_is_still_plausible(
    turned: list[float], implausible: list[int], dt_s: float
) -> None:
    """Or half of it; more is not, at any rate of ticks."""
    assert implausible == implausible_wheels([one * (dt_s / 0.1) for one in turned], dt_s)


def test_a_reading_is_held_for_its_time() -> None:
    """Up to a second behind the end of the tick that it fell into, and no longer."""
    made = ReadingTrack(1.0)
    assert math.isnan(made.take_mean(0.0))
    for time_s, value in ((0.25, 3.0), (0.5, 5.0), (0.5, 10.0)):
        made.add(time_s, value)
    ends_s = (0.25, 0.5, 0.75, 1.5, 1.5625)
    assert [3.0, 7.5, 10.0, 10.0, math.nan] == pytest.approx([made.take_mean(t) for t in ends_s], nan_ok=True)
    made.add(3.0, 4.0)
    made.clear()
    assert math.isnan(made.take_mean(3.0))


def test_readings_of_one_stamp_stay_in_their_order() -> None:
    """The later one is held, also where it came with an older stamp than the newest."""
    made = ReadingTrack(1.0)
    for time_s, value in ((1.0, 1.0), (2.0, 2.0), (1.0, 7.0)):
        made.add(time_s, value)
    assert [4.0, 7.0, 2.0] == [made.take_mean(end_s) for end_s in (1.0, 1.5, 2.0)]
