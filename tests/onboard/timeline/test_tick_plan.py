"""Ticks planned from decoded blocks: the numbers that the tracks give one by one, to the last bit."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.onboard.timeline.events import QUANTUM, START_S, rotations
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.sources.ahead.decoded_block import Angles, DecodedBlock, Frames, Values
from tpmsd.onboard.sources.events import RotationRun
from tpmsd.onboard.timeline.reading_track import ReadingTrack
from tpmsd.onboard.timeline.rotation_track import RotationTrack, rotation_between
from tpmsd.onboard.timeline.tick_plan import TickPlan, TickReadings, plan_ticks
from tpmsd.onboard.timeline.timeline import Timeline

QUIET = settings(derandomize=True, deadline=None, max_examples=100)
SEEDS = st.integers(0, 2**32 - 1)


def rising(rng: np.random.Generator, count: int, step_s: float) -> FloatArray:
    """Times at uneven steps, some of them on a tick's edge and some after a pause."""
    steps = rng.exponential(step_s, count) + 1e-6
    steps[rng.random(count) < 0.05] += 0.7
    times = np.cumsum(steps)
    times[rng.random(count) < 0.1] = np.nan
    at = np.isnan(times)
    times[at] = np.round(np.interp(np.flatnonzero(at), np.flatnonzero(~at), times[~at]), 1)
    return np.unique(times)


def run(times_s: FloatArray, angles_rad: FloatArray, segment: int) -> RotationRun:
    """Of one wheel."""
    return RotationRun(0, segment, 0.1, list(range(len(times_s))), times_s.tolist(), angles_rad.tolist())


@QUIET
@given(seed=SEEDS, known=st.integers(0, 30), segment=st.integers(0, 1))
def test_rotations_ahead_are_those_of_the_track(seed: int, known: int, segment: int) -> None:
    """Intervals over old and further readings, over pauses and another segment, give what the track gives
    once it has as many readings as the interval needs, and not what it gives with one less."""
    rng = np.random.default_rng(seed)
    times_s = rising(rng, 60, 0.04)
    angles = np.cumsum(rng.random(len(times_s)))
    known = min(known, len(times_s) - 2)
    edges_s = np.arange(1, 40) * 0.1
    track = RotationTrack()
    track.extend(run(times_s[:known], angles[:known], 0))
    found = track.rotations_ahead(times_s[known:], angles[known:], segment, 0.1, edges_s)
    if found is None:
        return
    for k, needs in enumerate(found.needs.tolist()):
        other = RotationTrack()
        other.extend(run(times_s[:known], angles[:known], 0))
        further = slice(known, known + max(needs, 0))
        other.extend(run(times_s[further], angles[further], segment))
        expected = rotation_between(other, float(edges_s[k]), float(edges_s[k + 1]))
        assert repr(expected) == repr((float(found.rotation_rad[k]), float(found.std_rad[k])))
        if needs > 0:
            short = RotationTrack()
            short.extend(run(times_s[: known + needs - 1], angles[: known + needs - 1], segment))
            assert math.isnan(rotation_between(short, edges_s[k], edges_s[k + 1])[0])


@QUIET
@given(seed=SEEDS, known=st.integers(0, 20), hold_s=st.sampled_from([0.15, 1.0]))
def test_means_ahead_are_those_of_the_track(seed: int, known: int, hold_s: float) -> None:
    """Means over ticks, of what is held too, are those that a track of all readings gives; a track that
    passes the ticks then goes on as that one does."""
    rng = np.random.default_rng(seed)
    times_s, values = np.sort(np.round(rng.random(50) * 4.0, 2)), rng.standard_normal(50)
    ends_s = np.arange(1, 30) * 0.1
    ahead, usual = ReadingTrack(hold_s), ReadingTrack(hold_s)
    for track in (ahead, usual):
        track.extend(times_s[:known].tolist(), values[:known].tolist())
    found = ahead.means_ahead(times_s[known:], values[known:], ends_s)
    assert found is not None
    for track in (ahead, usual):
        track.extend(times_s[known:].tolist(), values[known:].tolist())
    assert [repr(usual.take_mean(end)) for end in ends_s.tolist()] == [repr(x) for x in found.value.tolist()]
    ahead.drop_used(ends_s.tolist())
    later = [3.0, 3.3, 9.0]
    assert [repr(usual.take_mean(end)) for end in later] == [repr(ahead.take_mean(end)) for end in later]


def test_readings_of_before_a_step_of_the_clock_are_put_in_order() -> None:
    """A block whose first reading is older than the last known one loses none of its readings."""
    track = ReadingTrack(1.0)
    track.extend([1.0, 2.0], [10.0, 20.0])
    track.extend([1.5, 1.6, 2.5], [15.0, 16.0, 25.0])

    assert [10.0, 15.5, 20.0, 25.0] == [track.take_mean(end_s) for end_s in (1.0, 1.8, 2.0, 3.0)]


def test_readings_out_of_order_are_not_planned() -> None:
    """A further reading that is older than what the track has is left to the track."""
    track = ReadingTrack(1.0)
    track.extend([1.0], [2.0])
    assert track.means_ahead(np.array([0.9]), np.array([1.0]), np.array([1.1])) is None


def test_a_plan_waits_for_its_frames() -> None:
    """A tick is told once the frame behind its end and its last reading were played, and not before; nor is
    one with another end."""
    times_s = np.arange(12) * 0.1 + 0.05
    places = np.arange(12) * 10
    groups = (Frames(places, times_s), Frames(places[:8] + 5, times_s[:8] + 0.04))
    wheels = tuple(Angles(0, times_s * (k + 1), k, 0, 0.1) for k in range(4))
    decoded = DecodedBlock(0, 200, groups, wheels, (Values(1, times_s[:8], "yaw_rate"),), lambda: None)
    tracks = [RotationTrack() for _ in range(4)]
    edges_s = np.arange(2, 8) * 0.1
    readings = {"yaw_rate_radps": ("yaw_rate", ReadingTrack(1.0))}
    plan = plan_ticks(decoded, 0.0, tracks, readings, 7, edges_s)
    assert plan is not None
    end = float(edges_s[1])
    assert plan.tick(7, end, 30) is None  # the frame at 0.35 s has place 30
    tick = plan.tick(7, end, 31)
    assert tick is not None
    np.testing.assert_allclose(tick.rotation_rad, 0.1 * np.arange(1, 5), rtol=1e-12)
    assert {"yaw_rate_radps": (times_s[0] + times_s[1] + times_s[2]) / 3} == tick.means
    assert plan.tick(7, end + 0.1, 31) is None
    assert plan.tick(6, float(edges_s[0]), 31) is None


def test_readings_of_one_stamp_are_not_taken_ahead() -> None:
    """A track leaves out the second of two readings of one stamp, so such readings go one by one."""
    edges_s = np.arange(1, 4) * 0.1
    for times_s, planned_ahead in ((np.arange(8) * 0.05, True), (np.repeat(np.arange(4) * 0.1, 2), False)):
        found = RotationTrack().rotations_ahead(times_s, np.arange(8.0), 0, 0.1, edges_s)
        assert planned_ahead == (found is not None)


def test_a_wheel_that_falls_silent_is_not_planned() -> None:
    """A wheel of which the track has readings and the block has none ends all planning; one of which nothing
    ever came ends none."""
    times_s = np.arange(12) * 0.1
    track = RotationTrack()
    track.extend(run(times_s, times_s, 0))
    wheels = (Angles(0, times_s, 1, 0, 0.1),)
    decoded = DecodedBlock(0, 12, (Frames(np.arange(12), times_s),), wheels, (), lambda: None)
    tracks = [track, *(RotationTrack() for _ in range(3))]
    assert plan_ticks(decoded, 0.0, tracks, {}, 1, np.arange(2, 8) * 0.1) is None
    tracks[0] = RotationTrack()
    assert plan_ticks(decoded, 0.0, tracks, {}, 1, np.arange(2, 8) * 0.1) is not None


class Planner:
    """Answers as a plan does, and keeps whether it had each tick that was asked for."""

    def __init__(self, plan: TickPlan) -> None:
        self.plan = plan
        self.found: list[bool] = []

    def planned_tick(self, index: int, end_s: float) -> TickReadings | None:
        tick = self.plan.tick(index, end_s, 6)
        self.found.append(tick is not None)
        return tick


def test_a_plan_covers_the_ticks_up_to_its_last_frame() -> None:
    """Each tick that ends before the last frame of the block is planned, and none behind it."""
    timeline, made = Timeline(10.0), []
    for event in rotations(20.0, 2.0, 0.01):
        made += timeline.add(event)
    times_s: FloatArray = START_S + np.array([2.05, 2.15, 2.25, 2.35, 2.45, 2.573])
    wheels = tuple(Angles(0, 20.0 * (times_s - START_S), wheel, 0, QUANTUM) for wheel in range(4))
    plan = timeline.plan(DecodedBlock(0, 6, (Frames(np.arange(6), times_s),), wheels, (), lambda: None))
    assert plan is not None
    planner = Planner(plan)
    timeline.set_planner(planner)
    timeline.advance(START_S + 4.0)
    count = math.floor((times_s[-1] - made[-1].time_s) / 0.1)
    assert [True] * count == planner.found[:count] and not any(planner.found[count:])
    assert len(planner.found) > count > 4


def test_a_block_without_a_wheel_is_no_plan() -> None:
    """Frames of other messages alone, or none behind the last tick, give no tick ahead."""
    timeline = Timeline(10.0)
    for event in rotations(20.0, 2.0, 0.01):
        timeline.add(event)
    old_s = np.arange(40) * 0.01 + START_S
    wheels = tuple(Angles(0, old_s, wheel, 0, 0.1) for wheel in range(4))
    for groups, angles in (((), ()), ((Frames(np.arange(40), old_s),), wheels)):
        assert timeline.plan(DecodedBlock(0, 40, groups, angles, (), lambda: None)) is None
