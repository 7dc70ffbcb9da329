"""Ticks: exact sums, the right instants, the same live as replayed, whatever the inputs do."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.exact import exact
from tests.onboard.timeline.events import QUANTUM, START_S, fixes, merged, play, rotations, stamp_of
from tpmsd.onboard.sources.events import (
    Event,
    GnssFix,
    InertialSample,
    RotationRun,
    RotationSample,
    SourceFault,
)
from tpmsd.onboard.timeline.tick import Tick
from tpmsd.onboard.timeline.timeline import HOLDBACK_S, Timeline

QUIET = settings(derandomize=True, deadline=None, max_examples=40)


def test_nothing_is_counted_before_anything_came() -> None:
    """Each count of a new timeline is 0."""
    assert {0} == set(Timeline(10.0).counts.values())


def same(a: list[Tick], b: list[Tick]) -> bool:
    """Whether two lists of ticks are the same, NaN equal to NaN."""
    return exact(a) == exact(b)


@QUIET
@given(data=st.data(), rate_hz=st.sampled_from([1.0, 10.0, 13.0, 100.0]))
def test_rotations_of_ticks_add_up_to_the_counter(data: st.DataObject, rate_hz: float) -> None:
    """Wheels of any periods, phases and jitter: the ticks' rotations telescope to the angle between the first
    tick's begin and the last one's end, and none is lost between ticks."""
    events: list[Event] = []
    lines = []
    for wheel in range(4):
        period = data.draw(st.floats(0.01, 0.25))
        phase = data.draw(st.floats(0.0, 0.2))
        jitter = data.draw(st.floats(0.0, 0.45))
        seed = data.draw(st.integers(0, 2**32 - 1))
        rng = np.random.default_rng(seed)
        times = (
            START_S + phase + period * (np.arange(int(6.0 / period)) + jitter * rng.random(int(6.0 / period)))
        )
        angles = np.cumsum(rng.integers(0, 4, times.size)) * QUANTUM
        lines.append((times, angles))
        events += [
            RotationSample(float(t), wheel, float(a), QUANTUM, 0) for t, a in zip(times, angles, strict=True)
        ]
    timeline = Timeline(rate_hz)
    ticks = play(timeline, merged(events))
    assert len(ticks) > 3
    for wheel, (times, angles) in enumerate(lines):
        known = [tick for tick in ticks if math.isfinite(tick.rotation_rad[wheel])]
        total = math.fsum(tick.rotation_rad[wheel] for tick in known)
        expected = 0.0
        for tick in known:
            before = ticks[tick.index - ticks[0].index - 1] if tick.index > ticks[0].index else None
            begin = before.time_s if before is not None else tick.time_s - tick.dt_s
            expected += float(np.interp(tick.time_s, times, angles) - np.interp(begin, times, angles))
        assert expected == pytest.approx(total, abs=1e-4)
        inner = [t for t in ticks if t.time_s - t.dt_s > START_S + 0.6 and t.time_s < START_S + 5.2]
        missing = sum(math.isnan(tick.rotation_rad[wheel]) for tick in inner)
        assert missing <= timeline.counts["implausible"]


def test_steady_wheels_telescope_to_the_bit() -> None:
    """Rotations of adjoining ticks are differences of the very same numbers, so their sum has no seam."""
    events = rotations(63.0, 8.0, period_s=0.013)
    ticks = play(Timeline(10.0), events)
    first, last = ticks[1], ticks[-2]
    total = math.fsum(tick.rotation_rad[0] for tick in ticks[2:-1])
    assert 63.0 * (last.time_s - first.time_s) == pytest.approx(total, abs=3e-5)  # stamps resolve 0.24 us
    angle_rad = {s.time_s: s.angle_rad for s in events if isinstance(s, RotationSample)}
    times = np.array(sorted(angle_rad))
    angles = np.array([angle_rad[t] for t in times])
    by_interpolation = np.interp(last.time_s, times, angles) - np.interp(first.time_s, times, angles)
    assert by_interpolation == pytest.approx(total, abs=1e-6)


@pytest.mark.parametrize("rate_hz", [1.0, 10.0, 100.0])
def test_ticks_keep_their_rate(rate_hz: float) -> None:
    """At 1, 10 and 100 Hz ticks are as many as the drive is long, on multiples of their period."""
    ticks = play(Timeline(rate_hz), rotations(20.0, 12.0, 0.01))
    assert len(ticks) in (int(12 * rate_hz) - 1, int(12 * rate_hz))
    assert [1] * (len(ticks) - 1) == list(np.diff([tick.index for tick in ticks]))
    assert np.diff([tick.time_s for tick in ticks]) == pytest.approx(1 / rate_hz, abs=1e-6)
    assert [20.0 / rate_hz] * 4 == pytest.approx(ticks[5].rotation_rad, abs=1e-4)
    remainder = np.remainder([tick.time_s * rate_hz for tick in ticks], 1.0)
    assert np.all(np.minimum(remainder, 1 - remainder) < 1e-4)


@QUIET
@given(
    seed=st.integers(0, 2**32 - 1),
    rate_hz=st.sampled_from([1.0, 10.0, 100.0]),
    fix_period=st.sampled_from([0.1, 0.25, 1.0]),
)
def test_extra_advances_change_nothing(seed: int, rate_hz: float, fix_period: float) -> None:
    """A timer that lets time pass between events, as the daemon's does, makes the same ticks as a replay."""
    rng = np.random.default_rng(seed)
    events = merged(
        rotations(40.0, 5.0, 0.02),
        fixes(12.0, 5.0, fix_period, lag_s=float(rng.uniform(0.0, 0.3))),
        [InertialSample(START_S + 0.05 * k, "yaw_rate", 0.01 * k) for k in range(100)],
    )
    replay = play(Timeline(rate_hz), events)
    live = Timeline(rate_hz)
    ticks: list[Tick] = []
    for event, following in zip(events, [*events[1:], None], strict=True):
        ticks += live.add(event)
        if following is not None:
            for share in np.sort(rng.random(int(rng.integers(0, 3)))):
                span = stamp_of(following) - stamp_of(event)
                ticks += live.advance(stamp_of(event) + float(share) * span)
    ticks += live.finish()
    assert same(replay, ticks)


def test_a_tick_does_not_wait_for_and_does_not_see_what_comes_later() -> None:
    """A tick is made as soon as stamps pass its end by the holdback, and later events do not change it."""
    events = merged(rotations(40.0, 6.0, 0.02), fixes(12.0, 6.0))
    ticks = play(Timeline(10.0), events)
    for cut in (150, 300, 700):
        known = play(Timeline(10.0), events[:cut], finish=False)
        assert same(ticks[: len(known)], known)
        last = stamp_of(events[cut - 1])
        assert known[-1].time_s + HOLDBACK_S <= last + 1e-6
        assert known[-1].time_s + HOLDBACK_S > last - 0.1 - 1e-6


def test_known_latency_lengthens_the_holdback() -> None:
    """A receiver whose fixes are known to be 0.8 s old still gets them into their own ticks."""
    timeline = Timeline(10.0, latency_s=0.8)
    ticks = play(timeline, merged(rotations(40.0, 20.0), fixes(10.0, 20.0, 0.2, lag_s=0.8)))
    placed = [fix for tick in ticks for fix in tick.fixes]
    assert len(placed) >= 90
    assert 0 == timeline.counts["late_fixes"]
    utc = np.array([fix.north_m / 10.0 for fix in placed])  # 10 m/s northwards: place tells true time
    assert np.ptp(utc - np.array([fix.time_s for fix in placed])) < 1e-3
    assert START_S + 5.0 == pytest.approx(placed[25].time_s, abs=1e-3)


@pytest.mark.parametrize("rate_hz", [1.0, 10.0, 100.0])
def test_fixes_fall_into_the_tick_in_which_they_were_valid(rate_hz: float) -> None:
    """The fraction tells where in its tick a fix was valid, and the plane keeps the metres between fixes."""
    ticks = play(Timeline(rate_hz), merged(rotations(40.0, 20.0), fixes(15.0, 20.0, 0.3, lag_s=0.12)))
    pairs = [(tick, fix) for tick in ticks for fix in tick.fixes]
    assert len(pairs) >= 62
    for tick, fix in pairs:
        begin = tick.time_s - tick.dt_s
        assert begin - 1e-6 < fix.time_s <= tick.time_s
        assert (fix.time_s - begin) / tick.dt_s == pytest.approx(fix.fraction, abs=1e-5 * rate_hz)
        assert math.pi / 2 == pytest.approx(fix.heading_rad, abs=1e-4)  # course 0 is north
    distances = np.diff([fix.north_m for _, fix in pairs])
    assert 0.3 * 15.0 == pytest.approx(float(np.median(distances)), abs=2e-3)


def test_a_late_fix_is_left_out_and_reported() -> None:
    """A fix whose tick is gone is not put where the car no longer is; it is counted and reported."""
    timeline = Timeline(10.0)
    late = fixes(20.0, 10.0, lag_s=0.1)
    one = late[5]
    assert isinstance(one, GnssFix)
    late[5] = GnssFix(one.arrival_s + 0.7, *list(_values(one))[1:])
    ticks = play(timeline, merged(rotations(60.0, 10.0), late))
    reported = [fault for tick in ticks for fault in tick.faults]
    assert (1, [("gnss", "late")]) == (
        timeline.counts["late_fixes"],
        [(fault.source, fault.kind) for fault in reported],
    )
    errors = [fix.north_m - 20.0 * (fix.time_s - START_S) for tick in ticks for fix in tick.fixes]
    assert np.ptp(errors) < 20.0 * 0.03 + 0.01


def test_a_fix_that_is_valid_seconds_after_it_arrives_is_left_out_and_reported() -> None:
    """One fix whose UTC leaps by 3 s is not kept until then; the others keep their ticks."""
    timeline = Timeline(10.0)
    several = fixes(20.0, 20.0, lag_s=0.1)
    one = several[12]
    assert isinstance(one, GnssFix)
    values = dict(zip(GnssFix.__slots__, _values(one), strict=True))
    several[12] = GnssFix(**{**values, "utc_s": one.utc_s + 3.0})
    ticks = play(timeline, merged(rotations(60.0, 20.0), several))
    assert (1, ["early"]) == (
        timeline.counts["early_fixes"],
        [fault.kind for tick in ticks for fault in tick.faults],
    )
    errors = [fix.north_m - 20.0 * (fix.time_s - START_S) for tick in ticks for fix in tick.fixes]
    assert np.ptp(errors) < 20.0 * 0.03 + 0.01


def _values(fix: GnssFix) -> list[float]:
    return [getattr(fix, name) for name in GnssFix.__slots__]


def test_a_clock_off_by_a_constant_makes_no_difference() -> None:
    """Host time off from UTC by a day: the same ticks, a day later."""
    a = play(Timeline(10.0), merged(rotations(40.0, 10.0), fixes(10.0, 10.0)))
    day = 86400.0
    b = play(
        Timeline(10.0),
        merged(
            rotations(40.0, 10.0, start_s=START_S + day),
            fixes(10.0, 10.0, clock_offset_s=day),
        ),
    )
    assert len(a) == len(b)
    for one, other in zip(a, b, strict=True):
        assert day == pytest.approx(other.time_s - one.time_s, abs=1e-6)
        assert [fix.fraction for fix in one.fixes] == pytest.approx(
            [fix.fraction for fix in other.fixes], abs=1e-4
        )
        assert [fix.north_m for fix in one.fixes] == [fix.north_m for fix in other.fixes]


@pytest.mark.parametrize("back_s", [0.8, 30.0, 3600.0, 1e8])
def test_the_clock_steps_back(back_s: float) -> None:
    """Time goes on: one step is told, at most a second of rotation is lost, fixes are placed again, and the
    host's own time is told to users."""

    def host(event: Event) -> Event:
        true = stamp_of(event)
        shift = -back_s if true >= START_S + 20.0 else 0.0
        if isinstance(event, GnssFix):
            return GnssFix(event.arrival_s + shift, *_values(event)[1:])
        assert isinstance(event, RotationSample)
        return RotationSample(
            event.time_s + shift, event.wheel, event.angle_rad, event.quantum_rad, event.segment
        )

    events = [host(e) for e in merged(rotations(50.0, 40.0), fixes(15.0, 40.0, 0.2))]
    timeline = Timeline(10.0)
    ticks = play(timeline, events)
    assert 1 == timeline.counts["clock_steps"]
    assert ["step_back"] == [f.kind for tick in ticks for f in tick.faults if f.source == "clock"]
    times = np.array([tick.time_s for tick in ticks])
    assert np.all(np.diff(times) > 0.099)
    assert 398 <= len(ticks) <= 401
    turned = math.fsum(np.nan_to_num([tick.rotation_rad[2] for tick in ticks]))
    assert 50.0 * 40.0 == pytest.approx(turned, abs=50.0 * 1.0)
    assert START_S + 40.0 - back_s == pytest.approx(ticks[-1].host_time_s, abs=0.11)
    after = [fix for tick in ticks[260:] for fix in tick.fixes]
    assert len(after) > 50
    # Place against time: 15 m/s north; the clock's new offset is taken up to within a tenth of a second.
    lag = [fix.north_m / 15.0 - fix.time_s for fix in after]
    assert np.ptp(lag) < 0.11


@pytest.mark.parametrize("pause_s", [8.0, 3600.0, 1e9])
def test_a_pause_of_everything_is_one_gap(pause_s: float) -> None:
    """A pause of the logger (or a forward step) makes no empty ticks; the next tick says how long it was."""
    first = merged(rotations(50.0, 10.0), fixes(15.0, 10.0, 0.2))
    shifted = START_S + 10.0 + pause_s
    second = merged(rotations(50.0, 10.0, start_s=shifted), fixes(15.0, 10.0, 0.2, start_s=shifted))
    timeline = Timeline(10.0)
    ticks = play(timeline, [*first, *second])
    gaps = [tick.gap_s for tick in ticks if tick.gap_s > 0]
    assert [pause_s] == pytest.approx(gaps, abs=0.5)
    assert 1 == timeline.counts["gaps"]
    assert len(ticks) <= 201
    assert np.all(np.diff([tick.index for tick in ticks]) == 1)
    assert np.all(np.diff([tick.time_s for tick in ticks]) > 0.05)
    assert sum(not math.isfinite(tick.rotation_rad[0]) for tick in ticks) <= 8


def test_a_silent_bus_beside_a_receiver_makes_empty_ticks() -> None:
    """Where only the wheels are silent, ticks go on without rotation, so that the loss can be noticed."""
    timeline = Timeline(10.0)
    ticks = play(timeline, merged(rotations(50.0, 5.0), fixes(15.0, 30.0, 0.2)))
    assert 0 == timeline.counts["gaps"]
    assert 295 <= len(ticks) <= 301
    assert all(np.all(np.isnan(tick.rotation_rad)) for tick in ticks[55:])
    assert 0.0 == math.fsum(tick.gap_s for tick in ticks)


def test_fixes_without_position_are_not_placed_but_keep_the_clock() -> None:
    """A fix of NaNs makes no Fix, whichever numbers are missing."""
    good = fixes(15.0, 10.0, 0.5)
    nan = math.nan
    bad = [
        GnssFix(START_S + 3.03, START_S + 3.0),
        GnssFix(START_S + 4.03, nan, nan, 8.0, 100.0, 1, 0.9, 2.0),
        GnssFix(START_S + 5.03, START_S + 5.0, 50.0, 8.0, 100.0, 1, nan, nan, nan, nan),
        GnssFix(START_S + 6.03, START_S + 6.0, 50.0, 8.0, 100.0, 1, nan, math.inf, nan, nan),
    ]
    ticks = play(Timeline(10.0), merged(rotations(50.0, 10.0), good, list(bad)))
    placed = [fix for tick in ticks for fix in tick.fixes]
    assert len(good) - 1 <= len(placed) <= len(good)
    assert all(math.isfinite(fix.position_std_m) for fix in placed)


def test_a_fix_without_utc_is_placed_by_its_usual_lag() -> None:
    """Where a sentence lacks its time, arrival minus the usual lag stands in."""
    stream = fixes(10.0, 30.0, 0.5, lag_s=0.2)
    odd = stream[40]
    assert isinstance(odd, GnssFix)
    stream[40] = GnssFix(odd.arrival_s, math.nan, *_values(odd)[2:])
    ticks = play(Timeline(10.0), merged(rotations(30.0, 30.0), stream))
    placed = [fix for tick in ticks for fix in tick.fixes]
    assert 60 == len(placed)
    spacing = np.diff([fix.time_s for fix in placed])
    assert np.all(np.abs(spacing - 0.5) < 0.02)


def test_inertial_signals_are_means_of_their_tick() -> None:
    """Readings in a tick are averaged; where none falls into it the last is held for a second at most."""
    events: list[Event] = [InertialSample(START_S + 0.01 + 0.02 * k, "yaw_rate", float(k)) for k in range(50)]
    events += [InertialSample(START_S + 0.5, "ambient_temp", 285.0)]
    events += [InertialSample(START_S + 0.7, "accel_lat", math.nan)]
    ticks = play(Timeline(10.0), merged(rotations(30.0, 6.0), events))
    assert [2.0, 7.0, 12.0] == pytest.approx([tick.yaw_rate_radps for tick in ticks[:3]])
    assert 49.0 == ticks[15].yaw_rate_radps
    assert math.isnan(ticks[25].yaw_rate_radps)
    assert 285.0 == ticks[55].ambient_temp_k
    assert all(math.isnan(tick.accel_lat_mps2) for tick in ticks)


def test_inertial_readings_out_of_order_go_to_their_own_ticks() -> None:
    """A reading of the next tick that is followed by a late one of this tick is not lost to it."""
    events: list[Event] = rotations(30.0, 3.0)
    at = START_S + 1.0
    odd: list[Event] = [
        InertialSample(at + 0.05, "yaw_rate", 1.0),
        InertialSample(at + 0.15, "yaw_rate", 5.0),
        InertialSample(at + 0.08, "yaw_rate", 3.0),
    ]
    timeline = Timeline(10.0)
    ticks: list[Tick] = []
    for event in events:
        ticks += timeline.add(event)
        if odd and stamp_of(event) >= at + 0.15:
            for sample in odd:
                ticks += timeline.add(sample)
            odd = []
    by_end = {round((tick.time_s - START_S) * 10): tick.yaw_rate_radps for tick in ticks}
    assert (2.0, 5.0) == (by_end[11], by_end[12])


def test_a_wheel_that_turns_unlike_the_others_is_left_out() -> None:
    """A wheel at twice the others' speed is rejected while it does so, and reported; the others stay."""
    odd = [
        RotationSample(e.time_s, e.wheel, e.angle_rad * 2.5, QUANTUM, 0)
        for e in rotations(50.0, 5.0, wheels=[3])
        if isinstance(e, RotationSample)
    ]
    timeline = Timeline(10.0)
    ticks = play(timeline, merged(rotations(50.0, 5.0, wheels=[0, 1, 2]), list(odd)))
    assert all(math.isnan(tick.rotation_rad[3]) for tick in ticks[1:-1])
    assert np.all(np.isfinite([tick.rotation_rad[:3] for tick in ticks[1:-1]]))
    wheels = {fault.wheel for tick in ticks for fault in tick.faults if fault.kind == "implausible"}
    assert {3} == wheels


def test_of_a_rear_pair_that_disagrees_neither_is_believed() -> None:
    """With two wheels alone, a factor between them leaves open which is right."""
    odd = [
        RotationSample(e.time_s, 3, e.angle_rad * 2.5, QUANTUM, 0)
        for e in rotations(50.0, 5.0, wheels=[3])
        if isinstance(e, RotationSample)
    ]
    ticks = play(Timeline(10.0), merged(rotations(50.0, 5.0, wheels=[2]), list(odd)))
    assert all(np.all(np.isnan(tick.rotation_rad)) for tick in ticks)


def test_slow_wheels_may_differ() -> None:
    """At walking pace in a tight bend wheels differ by more than a factor, and that is no fault."""
    events = merged(rotations(2.0, 5.0, wheels=[0, 2]), rotations(6.0, 5.0, wheels=[1, 3]))
    ticks = play(Timeline(10.0), events)
    assert np.all(np.isfinite([tick.rotation_rad for tick in ticks[1:-1]]))


def test_faults_of_the_sources_reach_the_next_tick() -> None:
    """A fault is handed on once, in the first tick that is made after it."""
    fault = SourceFault(START_S + 1.0, "can", "reset", "counter began again", 2)
    ticks = play(Timeline(10.0), merged(rotations(50.0, 3.0), [fault]))
    assert [fault] == [f for tick in ticks for f in tick.faults]


@QUIET
@given(
    st.lists(
        st.tuples(
            st.floats(-20.0, 20.0),
            st.sampled_from(["rotation", "fix", "inertial", "fault", "advance"]),
            st.floats(allow_nan=True, allow_infinity=True),
            st.integers(0, 3),
        ),
        max_size=60,
    )
)
def test_no_sequence_of_events_stops_the_timeline(moves: list[tuple[float, str, float, int]]) -> None:
    """Events with any times and values make ticks whose index and time only rise, and never an exception."""
    timeline = Timeline(10.0)
    now = START_S
    ticks: list[Tick] = []
    for delta, kind, value, wheel in moves:
        now += delta if abs(delta) > 6 else abs(delta) / 10
        if kind == "rotation":
            ticks += timeline.add(RotationSample(now, wheel, 10.0 * (now - START_S), QUANTUM, wheel % 2))
        elif kind == "fix":
            ticks += timeline.add(
                GnssFix(now, now + min(max(value, -5.0), 5.0), 50.0, 8.0, value, 1, 1.0, 2.0)
            )
        elif kind == "inertial":
            ticks += timeline.add(InertialSample(now, "yaw_rate", value))
        elif kind == "fault":
            ticks += timeline.add(SourceFault(now, "can", "lost"))
        else:
            ticks += timeline.advance(now)
    ticks += timeline.finish()
    assert np.all(np.diff([tick.index for tick in ticks]) == 1)
    assert np.all(np.diff([tick.time_s for tick in ticks]) > 0)


@pytest.mark.parametrize("back_s", [0.0, 3600.0])
def test_many_samples_at_once_are_placed_as_each_by_itself(back_s: float) -> None:
    """Wheels and readings at the host's stamps, before and behind a step of its clock."""
    one, many = Timeline(10.0), Timeline(10.0)
    ticks = [play(timeline, rotations(20.0, 2.0, 0.01), finish=False) for timeline in (one, many)]
    begin_s = START_S + 2.0 - back_s
    for timeline, made in zip((one, many), ticks, strict=True):
        made += timeline.advance(begin_s)
    times_s = [begin_s + 0.02 * k for k in range(1, 150)]
    angles = [20.0 * (2.0 + 0.02 * k) for k in range(1, 150)]
    for time_s, angle_rad in zip(times_s, angles, strict=True):
        ticks[0] += one.advance(time_s)
        for wheel in range(4):
            ticks[0] += one.add(RotationSample(time_s, wheel, angle_rad, QUANTUM, 0))
        ticks[0] += one.add(InertialSample(time_s, "yaw_rate", angle_rad))
    shift_s = many.shift_s
    assert (back_s > 0.0) == (shift_s != 0.0)
    frames = list(range(len(times_s)))
    many.add_samples(
        [RotationRun(wheel, 0, QUANTUM, frames, times_s, angles) for wheel in range(4)],
        [("yaw_rate", times_s, angles), ("odometer", times_s, angles)],
        shift_s,
    )
    ticks[1] += many.advance(times_s[-1])
    assert same(ticks[0], ticks[1])
    assert len(ticks[0]) > 40
    assert 2.0 == pytest.approx(ticks[0][-1].rotation_rad[3], abs=1e-4)


@pytest.mark.parametrize(("pause_s", "gaps"), [(5.0, 0), (5.0625, 1)])
def test_a_pause_of_five_seconds_is_filled_with_ticks(pause_s: float, gaps: int) -> None:
    """A longer one is a gap. Stamps are binary fractions, so that the bound itself is met."""
    timeline = Timeline(16.0)
    for k in range(64):
        timeline.add(RotationSample(1024.0 + k / 64, 0, float(k), QUANTUM, 0))
    last_s = 1024.0 + 63 / 64
    assert timeline.follows_without_pause(last_s + pause_s) == (not gaps)
    assert timeline.is_continuous(np.array([last_s + pause_s])) == (not gaps)
    before = timeline.counts["ticks"]
    ticks = timeline.advance(last_s + pause_s)
    assert (gaps, before + len(ticks)) == (timeline.counts["gaps"], timeline.counts["ticks"])
    assert len(ticks) == (math.floor(16 * HOLDBACK_S) if gaps else 80)


def test_time_is_continuous_up_to_half_a_second_back() -> None:
    """Before the first stamp nothing is; a stamp further back is a step of the clock."""
    timeline = Timeline(16.0)
    assert not timeline.is_continuous(np.array([1024.0]))
    timeline.advance(1024.0)
    assert timeline.is_continuous(np.array([1025.0, 1024.5, 1029.5]))
    assert not timeline.is_continuous(np.array([1025.0, 1024.4375]))
    assert not timeline.is_continuous(np.array([1025.0, 1031.0]))
    assert (True, False) == (
        timeline.follows_without_pause(1024.0),
        timeline.follows_without_pause(1023.9375),
    )


@pytest.mark.parametrize(("before_s", "placed"), [(0.0, True), (0.02, True), (0.05, False)])
def test_a_fix_that_missed_its_tick_by_30_ms_is_taken_at_the_start_of_the_next(
    before_s: float, placed: bool
) -> None:
    """One metre on a motorway; an older one is late."""
    timeline, seen = Timeline(10.0), list[GnssFix]()
    timeline.observe_fixes(seen.append)
    first = fixes(0.0, 1.0, lag_s=0.0)
    ticks = play(timeline, merged(first, rotations(20.0, 2.0, 0.01)), finish=False)
    valid_s = ticks[-1].time_s - before_s
    late = GnssFix(START_S + 1.99, valid_s, 50.0, 8.0, 100.0, 1, 0.8, 1.5, 20.0, 0.0)
    timeline.add(late)
    later = play(timeline, rotations(20.0, 2.0, 0.01, begin_s=2.0))
    found = [(tick.index, fix.fraction) for tick in later for fix in tick.fixes]
    assert [(ticks[-1].index + 1, pytest.approx(0.0, abs=1e-4))] * placed == found
    assert (1 - placed, [*first, late]) == (timeline.counts["late_fixes"], seen)


@pytest.mark.parametrize(("ahead_s", "early"), [(0.9, 0), (1.1, 1)])
def test_a_fix_that_is_valid_within_a_second_waits_for_its_tick(ahead_s: float, early: int) -> None:
    """A receiver whose time leaps by more is reported, and the fix is not kept until then."""
    timeline = Timeline(10.0)
    first = fixes(0.0, 2.0, lag_s=0.0)
    leapt = GnssFix(START_S + 2.0, START_S + 2.0 + ahead_s, 50.0, 8.0, 100.0, 1, 0.8, 1.5, 0.0, 0.0)
    ticks = play(timeline, merged([*first, leapt], rotations(20.0, 5.0, 0.01)))
    placed = [fix.time_s - START_S for tick in ticks for fix in tick.fixes]
    assert [0.0, 1.0, *[2.0 + ahead_s] * (not early)] == pytest.approx(placed, abs=1e-4)
    assert early == timeline.counts["early_fixes"]
