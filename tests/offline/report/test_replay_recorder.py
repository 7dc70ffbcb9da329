"""The recorder: totals from every tick, series in bounded memory."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.offline.report.drives import MONITOR, NOMINAL_M, OFFSET_M, START_S, VEHICLE, Drive, alarm, puncture
from tpmsd.offline.report.replay_recorder import ReplayRecorder
from tpmsd.offline.report.replay_result import AlarmThresholds, ReplayResult
from tpmsd.onboard.monitor.records import WheelState
from tpmsd.onboard.sources.events import SourceFault


def test_series_hold_every_tick_where_there_is_room() -> None:
    """A drive that fits is kept tick for tick, in the order of the wheels."""
    result = Drive(duration_s=30.0).record().result(1.0)

    assert 300 == len(result.time_s)
    assert START_S == pytest.approx(result.start_s, abs=1e-6)
    np.testing.assert_allclose(np.arange(1, 301) * 0.1, result.time_s - START_S, atol=1e-6)
    np.testing.assert_allclose(np.tile(OFFSET_M, (300, 1)), result.deviation_m)
    assert np.isnan(result.change_m).all(), "a wheel that is still learning has no change"


@settings(derandomize=True, deadline=None, max_examples=60)
@given(ticks=st.integers(1, 700), max_points=st.integers(2, 64))
def test_series_are_bounded_evenly_spaced_and_reach_both_ends(ticks: int, max_points: int) -> None:
    """However long the drive, there are at most max_points rows, first and last tick among them."""
    result = Drive(duration_s=ticks * 0.1, max_points=max_points).record().result(1.0)

    assert len(result.time_s) <= max_points
    assert ticks == 1 or len(result.time_s) >= min(ticks, max_points // 2)
    assert 0.1 == pytest.approx(result.time_s[0] - START_S, abs=1e-5)
    assert ticks * 0.1 == pytest.approx(result.time_s[-1] - START_S, abs=1e-5)
    steps = np.diff(result.time_s)[:-1]
    assert len(steps) == 0 or np.ptp(steps) < 1e-5


def test_totals_do_not_depend_on_thinning() -> None:
    """Distance, faults, outages, alarms and monitored time are those of all ticks."""
    full = puncture().record().result(1.0)
    thin = puncture(max_points=50).record().result(1.0)

    assert 50 >= len(thin.time_s)
    for name in ("distance_m", "duration_s", "moving_s", "informative_s", "fault_counts", "gnss", "alarms"):
        assert getattr(full, name) == getattr(thin, name), name
    assert full.wheels == thin.wheels
    assert full.can_faults[-1] == thin.can_faults[-1] == 21
    assert full.gnss_faults[-1] == thin.gnss_faults[-1] == 1


def test_distance_is_speed_times_time() -> None:
    """20 m/s for 30 s are 600 m, reversing counts as well, and a speed nobody knows counts nothing."""
    forth = Drive(duration_s=30.0).record().result(1.0)
    back = Drive(duration_s=30.0, speed_mps=lambda t: -20.0).record().result(1.0)
    unknown = (
        Drive(duration_s=30.0, speed_mps=lambda t: 20.0 if t <= 15.05 else math.nan).record().result(1.0)
    )

    assert 600.0 == pytest.approx(forth.distance_m)
    assert 600.0 == pytest.approx(back.distance_m)
    assert 300.0 == pytest.approx(unknown.distance_m)
    assert 15.0 == pytest.approx(unknown.moving_s)


def test_an_outage_counts_from_the_fix_before_it() -> None:
    """A tunnel of 30 s is one outage of 30 s; a loss of 4 s is none; 8 s without a first fix are one."""
    tunnel = Drive(duration_s=100.0, has_fix=lambda t: not 40 < t < 70).record().result(1.0)
    short = Drive(duration_s=100.0, has_fix=lambda t: not 40 < t < 44).record().result(1.0)
    late = Drive(duration_s=100.0, has_fix=lambda t: t >= 8).record().result(1.0)

    assert (1, 30.0, 30.0) == pytest.approx(_outages(tunnel), abs=0.21)
    assert (0, 0.0, 0.0) == _outages(short)
    assert (1, 8.0, 8.0) == pytest.approx(_outages(late), abs=0.21)


def test_outages_add_up() -> None:
    """Two tunnels of 10 s and 20 s are two outages, 30 s in all, the longest 20 s."""
    result = Drive(duration_s=100.0, has_fix=lambda t: not (20 < t < 30 or 60 < t < 80)).record().result(1.0)

    assert (2, 30.0, 20.0) == pytest.approx(_outages(result), abs=0.41)


def test_a_drive_without_any_fix_is_one_outage() -> None:
    """No fix at all: the outage is as long as the drive."""
    result = Drive(duration_s=20.0, has_fix=lambda t: False).record().result(1.0)

    assert 0 == result.gnss.fixes
    assert (1, 20.0, 20.0) == pytest.approx(_outages(result))
    assert np.isinf(result.gnss_age_s).all()


def test_a_wheel_that_is_lost_keeps_its_last_value() -> None:
    """The outcome of a wheel that drops off the bus is its last estimate, with the state unavailable."""
    drive = Drive(
        duration_s=120.0,
        change_m=lambda t: (0.0, 0.0, 0.0, -1e-6 * t),
        state=lambda t, wheel: (
            WheelState.UNAVAILABLE if wheel == "rr" and t > 100.05 else WheelState.MONITORING
        ),
    )
    outcome = drive.record().result(1.0).wheels[3]

    assert WheelState.UNAVAILABLE == outcome.state
    assert OFFSET_M[3] - 1e-4 == pytest.approx(outcome.deviation_m, abs=1e-9)
    assert 100.0 == pytest.approx(outcome.seen_s)
    assert 100.0 == pytest.approx(outcome.monitored_s)


def test_monitoring_starts_when_learning_ends() -> None:
    """Monitored time and the time it began come from the states."""
    outcome = Drive(duration_s=100.0).record().result(1.0).wheels[0]

    assert START_S + 60 == pytest.approx(outcome.monitored_from_s, abs=0.11)
    assert 40.0 == pytest.approx(outcome.monitored_s, abs=0.11)
    assert 100.0 == pytest.approx(outcome.seen_s)


def test_a_pause_belongs_to_the_duration_but_not_to_the_distance() -> None:
    """Ten seconds without ticks lengthen the drive; nothing is driven in them."""
    result = Drive(duration_s=30.0, pauses={100: 10.0}).record().result(1.0)

    assert 40.0 == pytest.approx(result.duration_s, abs=1e-5)
    assert 600.0 == pytest.approx(result.distance_m)
    assert (1, 10.0) == (result.tick_gaps, result.tick_gap_s)


def test_faults_are_counted_by_source_and_kind() -> None:
    """Each kind of fault of each source has its own count."""
    lost, garbage = SourceFault(START_S, "can", "lost"), SourceFault(START_S, "gnss", "garbage")
    result = Drive(duration_s=10.0, faults={5: (lost, garbage), 50: (lost,)}).record().result(1.0)

    assert {"can lost": 2, "gnss garbage": 1} == result.fault_counts
    assert [1, 2] == [int(result.can_faults[10]), int(result.can_faults[-1])]


def test_what_stands_at_the_end_is_distinguished_from_what_was_cleared() -> None:
    """All events are kept in order; only those not cleared are active."""
    events = {
        100: (alarm(10.1, wheel="fl"),),
        150: (alarm(15.1, wheel="rl"),),
        200: (alarm(20.1, wheel="fl", state="cleared"),),
    }
    result = Drive(duration_s=30.0, events=events).record().result(1.0)

    assert [("fl", "raised"), ("rl", "raised"), ("fl", "cleared")] == [
        (event.wheel, event.state) for event in result.alarms
    ]
    assert ["rl"] == [event.wheel for event in result.active]


def test_an_empty_drive_has_a_result() -> None:
    """Not one tick: nothing is known, and that is no error."""
    result = ReplayRecorder("empty", VEHICLE, MONITOR).result(math.nan)

    assert (0, 0.0, 0.0, None) == (len(result.time_s), result.duration_s, result.distance_m, result.pose)
    assert [WheelState.UNAVAILABLE] * 4 == list(result.states.values())


def test_the_probability_of_a_wheel_that_is_not_watched_is_unknown() -> None:
    """Zero would say `surely not deflated`; while learning, and after a loss, nobody knows."""
    drive = Drive(duration_s=120.0)
    recorder = ReplayRecorder("watched", VEHICLE, MONITOR)
    for index in range(1200):
        elapsed = (index + 1) * drive.dt_s
        report = drive._report(elapsed, (), (), elapsed)
        zeroed = tuple(wheel._replace(deflation_probability=0.0) for wheel in report.wheels)
        recorder.add(
            drive._tick(index, elapsed, 0.0),
            drive._estimate(elapsed, 0.0, elapsed),
            report._replace(wheels=zeroed),
        )
    result = recorder.result(1.0)

    assert np.isnan(result.deflation_probability[:590]).all()
    assert (result.deflation_probability[-590:] == 0.0).all()


def test_the_speed_of_the_replay_is_driving_time_over_time_taken() -> None:
    """600 s in 2.5 s are 240 times real time; not known without a measurement."""
    recorder = Drive(duration_s=600.0, dt_s=0.5).record()

    assert 240.0 == pytest.approx(recorder.result(2.5).realtime_factor)
    assert math.isnan(recorder.result(0.0).realtime_factor)
    assert math.isnan(recorder.result(math.nan).realtime_factor)


def test_thresholds_are_percentages_of_the_nominal_radius() -> None:
    """0.35 % of 316 mm are 1.106 mm."""
    thresholds = AlarmThresholds.from_config(VEHICLE, MONITOR)

    np.testing.assert_allclose(np.full(4, 1.106e-3), thresholds.deflation_m)
    np.testing.assert_allclose(np.full(4, NOMINAL_M * 0.008), thresholds.deviation_m)


def test_a_result_is_a_snapshot() -> None:
    """What was handed out does not change when the replay goes on."""
    recorder = Drive(duration_s=10.0).record()
    before = recorder.result(1.0)
    copy = before.time_s.copy()
    other = Drive(duration_s=20.0)
    recorder.add(
        other._tick(0, 11.0, 0.0), other._estimate(11.0, 0.0, 11.0), other._report(11.0, (), (), 11.0)
    )

    np.testing.assert_array_equal(copy, before.time_s)
    assert 101 == len(recorder.result(1.0).time_s)


def _outages(result: ReplayResult) -> tuple[int, float, float]:
    return result.gnss.outages, result.gnss.outage_s, result.gnss.longest_outage_s
