"""The host clock's own line of time, and one wheel's angle along it."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.onboard.sources.events import RotationSample
from tpmsd.onboard.timeline.host_clock import HostClock
from tpmsd.onboard.timeline.rotation_track import MAX_BRIDGE_S, RotationTrack, rotation_between


def test_an_ordinary_clock_is_left_as_it_is() -> None:
    """Logical time is host time until the clock steps back."""
    clock = HostClock()
    assert [5.0, 5.1, 5.05, 90.0] == [clock.logical(t) for t in (5.0, 5.1, 5.05, 90.0)]
    assert (0, 90.0) == (clock.steps, clock.host(90.0))


def test_a_step_back_goes_on_from_where_time_was() -> None:
    """After an hour back, time runs on by as much as the host's stamps do, and maps back to them."""
    clock = HostClock()
    clock.logical(10_000.0)
    first = clock.logical(6_400.0)
    assert 10_000.0 < first <= 10_000.1
    assert first + 2.5 == pytest.approx(clock.logical(6_402.5))
    assert 6_402.5 == pytest.approx(clock.host(first + 2.5))
    assert 1 == clock.steps


@settings(derandomize=True, deadline=None)
@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=40))
def test_logical_time_never_goes_back_further_than_jitter(stamps: list[float]) -> None:
    """Whatever stamps come, logical time stays within half a second of its latest; steps are counted."""
    clock = HostClock()
    latest = -math.inf
    for stamp in stamps:
        logical = clock.logical(stamp)
        assert logical >= latest - 0.5 - 1e-6
        assert stamp == pytest.approx(clock.host(logical), abs=1e-6)
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
    assert (12.0, 0) == pytest.approx(two.at(1.1)[:2])  # type: ignore[index]
    assert (14.0, 0, 0.13) == two.at(1.2)
    assert two.at(0.99) is None
    assert two.at(1.21) is None


def test_nothing_is_interpolated_across_segments_or_pauses() -> None:
    """Between readings of two segments, or too far apart, the angle is not known."""
    assert track(sample(1.0, 10.0), sample(1.1, 0.0, segment=1)).at(1.05) is None
    assert track(sample(1.0, 10.0), sample(1.0 + MAX_BRIDGE_S + 0.01, 20.0)).at(1.3) is None
    both = track(sample(1.0, 10.0), sample(1.1, 11.0), sample(1.2, 0.0, 1), sample(1.3, 1.0, 1))
    rotation, std = rotation_between(both, 1.05, 1.25)
    assert math.isnan(rotation)
    assert math.isnan(std)


def test_readings_that_are_not_newer_are_left_out() -> None:
    """A repeated or late reading does not bend the angle."""
    late = track(
        sample(1.0, 10.0), sample(1.2, 14.0), sample(1.2, 99.0), sample(1.1, 77.0), sample(1.4, 18.0)
    )
    assert (12.0, 0) == pytest.approx(late.at(1.1)[:2])  # type: ignore[index]
    assert (16.0, 0) == pytest.approx(late.at(1.3)[:2])  # type: ignore[index]


def test_the_reading_error_is_that_of_two_uniform_counts() -> None:
    """Variance of a difference of two floors of one quantum: q^2 / 6."""
    _, std = rotation_between(track(sample(0.0, 0.0), sample(0.5, 6.0)), 0.1, 0.2)
    assert 0.13**2 / 6 == pytest.approx(std**2)


def test_forgetting_keeps_what_the_next_instant_needs() -> None:
    """After dropping old readings the angle from that instant on is as before."""
    full = track(*(sample(k * 0.1, k * 1.0) for k in range(20)))
    before = [full.at(1.25), full.at(1.3), full.at(1.61)]
    full.forget_before(1.25)
    assert before == [full.at(1.25), full.at(1.3), full.at(1.61)]
    assert full.at(1.0) is None
