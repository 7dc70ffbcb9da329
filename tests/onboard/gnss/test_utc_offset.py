from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.onboard.timeline.utc_offset import UtcOffsetTracker

T = 1720716104.0


def jitter(rng: np.random.Generator, n: int) -> np.ndarray:
    """One-sided: some milliseconds, now and then 0.2 s."""
    return rng.exponential(0.008, n) + 0.2 * (rng.random(n) < 0.01)


def track(
    offset: np.ndarray, utc: np.ndarray, seed: int = 1
) -> tuple[np.ndarray, np.ndarray, UtcOffsetTracker]:
    """Error of the validity times, lags, and the tracker."""
    tracker = UtcOffsetTracker()
    arrival = utc + offset + jitter(np.random.default_rng(seed), utc.size)
    valid = np.array([tracker.update(a, u) for a, u in zip(arrival, utc, strict=True)])
    return valid - (utc + offset), arrival - valid, tracker


@pytest.mark.parametrize("interval", [0.05, 0.1, 0.2, 1.0])
def test_constant_offset(interval: float):
    """With a constant offset and one-sided jitter the validity is known to some milliseconds at any rate."""
    utc = T + np.arange(0, 300, interval)
    error, lag, _ = track(np.full(utc.size, 17.3), utc)
    settled = utc > T + 20
    assert np.abs(error[settled]).max() < 0.009
    assert lag[settled].min() > -0.009


@pytest.mark.parametrize("drift", [1e-3, -1e-3, 3e-4])
def test_drift(drift: float):
    """A clock that drifts by a millisecond per second is followed to some milliseconds."""
    utc = T + np.arange(0, 600, 0.1)
    error, _, _ = track(drift * (utc - T), utc)
    settled = utc > T + 30
    assert np.abs(error[settled]).max() < 0.009
    assert error[settled].std() < 0.002


def test_wander():
    """An offset that wanders by 0.1 s in ten minutes, as in real drives, is followed to some milliseconds."""
    utc = T + np.arange(0, 600, 0.1)
    error, _, _ = track(0.05 * np.sin(2 * math.pi * (utc - T) / 400), utc)
    assert np.abs(error[utc > T + 30]).max() < 0.008


@pytest.mark.parametrize("size", [0.4, -0.4, 5.0, -3600.0, 1.6e9])
def test_step(size: float):
    """When the host clock is set, the new level is taken up with the fourth fix, and its size told."""
    tracker = UtcOffsetTracker()
    states = []
    for i in range(60):
        utc = T + 0.1 * i
        arrival = utc + 0.05 + (size if i >= 30 else 0.0)
        valid = tracker.update(arrival, utc)
        states.append((tracker.status, round(tracker.step_s, 5)))
        if i < 30 or i >= 33:
            assert pytest.approx(arrival, abs=1e-6) == valid
    assert [("ok", 0.0)] * 30 + [("outlier", 0.0)] * 3 + [("step", size)] + [("ok", 0.0)] * 26 == states


def test_single_late_fixes_are_no_step():
    """Up to three late fixes in a row keep their true validity."""
    tracker = UtcOffsetTracker()
    for i in range(300):
        late = 0.9 if i % 50 in (20, 21, 22) else 0.0
        assert pytest.approx(T + 0.1 * i + 0.05, abs=1e-6) == tracker.update(
            T + 0.1 * i + 0.05 + late, T + 0.1 * i
        )
        assert ("outlier" if late else "ok") == tracker.status
        assert pytest.approx(late, abs=1e-6) == tracker.lag_s


def test_stalled_line_is_no_step():
    """After a stall of two seconds, the fixes that come all at once keep their true validity."""
    tracker = UtcOffsetTracker()
    for i in range(100):
        utc = T + 0.1 * i
        arrival = max(utc, T + 7.0) if 50 <= i < 70 else utc
        assert pytest.approx(utc, abs=0.02) == tracker.update(arrival, utc)
        assert "step" != tracker.status


def test_known_latency():
    """The configured latency makes a fix valid that much before its fastest arrival."""
    tracker = UtcOffsetTracker(latency_s=0.12)
    assert pytest.approx(T + 5.0 - 0.12, abs=1e-6) == tracker.update(T + 5.0, T)
    assert pytest.approx(0.12, abs=1e-6) == tracker.lag_s


def test_the_first_ten_fixes_are_taken_at_their_low_quantile():
    """Until ten fixes are there, the offset is the 15 % quantile of theirs, interpolated between two."""
    tracker, late = UtcOffsetTracker(), np.random.default_rng(3).exponential(0.02, 10)
    for i in range(10):
        tracker.update(T + 0.1 * i + 17.3 + late[i], T + 0.1 * i)
        assert pytest.approx(17.3 + np.quantile(late[: i + 1], 0.15), abs=1e-6) == tracker.offset_s


def test_a_drift_is_followed_as_far_as_clocks_drift():
    """A drift of 2 ms/s is followed to 5 ms; one of 4 ms/s, which no clock has, stays behind by 10 ms."""
    lags = []
    for drift in (2e-3, 4e-3):
        utc = T + np.arange(0, 60, 0.1)
        tracker = UtcOffsetTracker()
        valid = [
            tracker.update(float(a), float(u)) for a, u in zip(utc + drift * (utc - T), utc, strict=True)
        ]
        lags.append(float(np.mean((np.array(valid) - utc - drift * (utc - T))[utc > T + 40])))
    assert abs(lags[0]) < 0.005
    assert lags[1] < -0.010


def test_a_lone_early_fix_is_enough_for_the_trend():
    """A first fix 17 s ago and a second of fixes 10 s ago tell the drift: 1 ms/s is followed to 7 ms within
    3 s, where the low quantile of the last ten seconds alone stays 8.5 ms behind, and its smoothing 2 ms."""
    tracker, valid = UtcOffsetTracker(), math.nan
    for utc in (T, *(T + np.arange(6.0, 20.0, 0.05)).tolist()):
        valid = tracker.update(utc + 1e-3 * (utc - T), utc)
    assert -0.007 < valid - (utc + 1e-3 * (utc - T)) <= 0.0


def test_no_utc():
    """A fix without UTC is placed by its arrival and the usual lag."""
    tracker = UtcOffsetTracker(latency_s=0.1)
    assert pytest.approx(T - 0.1, abs=1e-6) == tracker.update(T, math.nan)
    for i in range(50):
        tracker.update(T + i + (0.03 if i % 2 else 0.0), T + i)
    usual = tracker.update(T + 60.0, math.nan)
    assert "no_utc" == tracker.status
    assert 0.1 <= T + 60.0 - usual <= 0.131


def test_repeated_and_backward_utc():
    """UTC that stands still or goes back is told, and does not move the offset."""
    tracker = UtcOffsetTracker()
    for i in range(20):
        tracker.update(T + 0.1 * i + 0.05, T + 0.1 * i)
    before = tracker.offset_s
    tracker.update(T + 2.05, T + 1.9)
    assert "repeated" == tracker.status
    tracker.update(T + 2.05, T + 1.85)
    assert "backwards" == tracker.status
    assert before == tracker.offset_s


def test_receiver_time_leaps_back():
    """When the receiver's own time leaps back by an hour, the fixes go on as before on the host clock."""
    tracker = UtcOffsetTracker()
    states = []
    for i in range(40):
        valid = tracker.update(T + 0.1 * i, T + 0.1 * i - (3600 if i >= 20 else 0))
        states.append(tracker.status)
    assert ["backwards", "outlier", "outlier", "step"] == states[20:24]
    assert pytest.approx(T + 3.9, abs=1e-6) == valid


TIMES = st.one_of(st.floats(), st.floats(T - 5, T + 5), st.sampled_from([T, T + 0.1, math.nan, math.inf]))


@settings(derandomize=True, deadline=None, max_examples=200)
@given(st.lists(st.tuples(TIMES, TIMES), max_size=60))
def test_any_times(times: list[tuple[float, float]]):
    """Any times whatever never raise, and memory stays bounded."""
    tracker = UtcOffsetTracker()
    for arrival, utc in times:
        tracker.update(arrival, utc)
    assert tracker.status in ("ok", "step", "outlier", "repeated", "backwards", "no_utc")
    assert len(tracker._times_s) <= 4096


def test_a_host_on_utc_knows_the_age_of_every_fix():
    """Whatever the latency and its jitter, the validity is the fix's own time."""
    tracker = UtcOffsetTracker(latency_s=0.1, host_on_utc=True)
    rng = np.random.default_rng(2)
    for k in range(100):
        utc_s = T + 0.1 * k
        assert utc_s == tracker.update(utc_s + 0.3 + float(rng.exponential(0.05)), utc_s)
    assert tracker.update(T + 20.0, math.nan) == pytest.approx(T + 20.0 - 0.335, abs=0.03)
    assert not tracker.off_utc


@pytest.mark.parametrize("offset_s", [-0.2, 5.0, 1e9])
def test_a_clock_that_is_not_on_utc_is_noticed(offset_s: float):
    """Fixes are then placed as with a free clock, and counted."""
    free, wrong = UtcOffsetTracker(), UtcOffsetTracker(host_on_utc=True)
    for k in range(50):
        utc_s = T + 0.1 * k
        assert free.update(utc_s + offset_s, utc_s) == wrong.update(utc_s + offset_s, utc_s)
        assert wrong.off_utc


def test_a_level_takes_exactly_four_fixes_that_agree():
    """Three fixes a second off are outliers, the fourth is the step; four that differ by 0.2 s are none."""
    for spread_s, last in ((0.0, "step"), (0.2, "outlier")):
        tracker = UtcOffsetTracker()
        for k in range(30):
            tracker.update(T + k, T + k)
        said = []
        for k in range(30, 34):
            tracker.update(T + k + 1.0 + spread_s * (k % 2), T + k)
            said.append(tracker.status)
        assert ["outlier"] * 3 + [last] == said


def test_between_two_looks_at_the_envelope_its_value_is_approached_in_two_seconds():
    """The 15 % quantile of all fixes, formed when 0.4 s have passed since it was last; until ten fixes are
    there it counts at once, then 1 - exp(-t / 2 s) of what is missing."""
    tracker, rng = UtcOffsetTracker(), np.random.default_rng(5)
    offsets = 17.0 + rng.exponential(0.04, 75)
    offsets[30:] += 0.05
    expected_s = target_s = judged_s = 0.0
    for k, offset_s in enumerate(offsets):
        now_s = 0.125 * k
        tracker.update(T + now_s + offset_s, T + now_s)
        if k < 10 or now_s - judged_s >= 0.4:
            target_s, judged_s = float(np.quantile(offsets[: k + 1], 0.15)), now_s
        share = 1.0 if k < 10 else 1.0 - math.exp(-0.125 / 2.0)
        expected_s += share * (target_s - expected_s)
        assert pytest.approx(expected_s, abs=2e-6) == tracker.offset_s
        assert "ok" == tracker.status


def test_of_more_than_4096_fixes_the_oldest_is_forgotten():
    """A receiver that speaks a thousand times a second for a while takes no more memory: the quantile of what
    is left is that of the last 4096 offsets, which are 50 us apart."""
    tracker, step_s = UtcOffsetTracker(), 5e-5
    for k in range(4097):
        before_s = tracker.offset_s
        utc_s = T + 0.001 * k + (5.0 if k == 4096 else 0.0)
        tracker.update(utc_s + step_s * k, utc_s)
    quantile_s = step_s * (1 + 0.15 * 4095)
    share = 1.0 - math.exp(-5.001 / 2.0)
    assert pytest.approx(before_s + share * (quantile_s - before_s), abs=3e-6) == tracker.offset_s


@pytest.mark.parametrize(("late", "lag_s"), [(31, 0.0), (32, 0.0625), (33, 0.125)])
def test_the_usual_lag_is_the_median_of_the_last_64(late: int, lag_s: float):
    """A fix without UTC is placed by it: half of the last 64 fixes came an eighth of a second late."""
    tracker = UtcOffsetTracker()
    for k in range(200):
        tracker.update(T + 0.0625 * k + (0.125 if k >= 200 - late else 0.0), T + 0.0625 * k)
    assert pytest.approx(T + 20.0 - lag_s, abs=1e-4) == tracker.update(T + 20.0, math.nan)
    assert pytest.approx(lag_s, abs=1e-4) == tracker.lag_s


@pytest.mark.parametrize(("off_s", "status"), [(0.25, "ok"), (0.265625, "outlier"), (-0.265625, "outlier")])
def test_a_fix_a_quarter_of_a_second_off_is_doubted(off_s: float, status: str):
    """Less is jitter."""
    tracker = UtcOffsetTracker()
    for k in range(30):
        tracker.update(1024.0 + k, 1024.0 + k)
    tracker.update(1054.0 + off_s, 1054.0)
    assert status == tracker.status


@pytest.mark.parametrize(("spread_s", "last"), [(0.140625, "step"), (0.15625, "outlier")])
def test_fixes_agree_within_150_ms(spread_s: float, last: str):
    """Four that lie further apart are no level; the level is the least of theirs."""
    tracker = UtcOffsetTracker()
    for k in range(30):
        tracker.update(1024.0 + k, 1024.0 + k)
    for k in range(30, 34):
        tracker.update(1025.0 + k + (spread_s if k == 31 else 0.0), 1024.0 + k)
    assert (last, 1.0 if last == "step" else 0.0) == (tracker.status, tracker.step_s)
    assert pytest.approx(1.0 if last == "step" else 0.0, abs=1e-6) == tracker.offset_s


@pytest.mark.parametrize(
    ("lag_s", "off_utc"), [(-0.0625, True), (-0.046875, False), (2.5, False), (2.515625, True)]
)
def test_a_host_on_utc_hears_of_a_fix_at_its_time_or_soon_after(lag_s: float, off_utc: bool):
    """From 50 ms before, which is the clock's own error, to 2.5 s behind."""
    tracker = UtcOffsetTracker(host_on_utc=True)
    valid_s = tracker.update(1024.0 + lag_s, 1024.0)
    assert off_utc == tracker.off_utc
    assert (1024.0 + lag_s if off_utc else 1024.0) == valid_s
    assert (0.0 if off_utc else lag_s) == tracker.lag_s


@pytest.mark.parametrize(("early", "min_s", "max_s"), [(9, -0.019, -0.016), (10, -0.014, -0.011)])
def test_ten_early_fixes_tell_the_drift(early: int, min_s: float, max_s: float):
    """From 17 s after the first on a drift of 2 ms/s is taken into account, but fewer tell none:
    then the low quantile of the last ten seconds stays 17 ms behind."""
    tracker, valid = UtcOffsetTracker(), math.nan
    for utc in (*(T + 0.05 * np.arange(early)).tolist(), *(T + np.arange(8.6, 18.5, 0.05)).tolist()):
        valid = tracker.update(utc + 2e-3 * (utc - T), utc)
    assert min_s < valid - (utc + 2e-3 * (utc - T)) < max_s
