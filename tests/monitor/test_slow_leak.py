"""Slow leaks over weeks of drives: what is noticed, what is not, and what is kept."""

from __future__ import annotations

import itertools
import json
import math
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.campaigns.slow_leak import METRES_PER_PERCENT, first_notice
from bench.worlds.tyre_years import Leak, draw_year
from tests.monitor.drives import ALL, START_S, Player, monitor, said
from tpmsd.monitor.leak_history import LeakHistory
from tpmsd.monitor.leak_trend import find_trend, partition
from tpmsd.monitor.monitor import Monitor
from tpmsd.monitor.records import AlarmEvent, WheelState
from tpmsd.monitor.settings import READINGS, TREND
from tpmsd.wheels import FloatArray

DAY_S = 86400.0


def best_by_trying_all(value: FloatArray, weight: FloatArray, penalty: FloatArray) -> float:
    """The best steps of one short series among all 2^(n-1)."""
    best = -math.inf
    for steps in itertools.product((False, True), repeat=value.size - 1):
        edges = [0, *(k + 1 for k, step in enumerate(steps) if step), value.size]
        fit = 0.0
        for begin, end in itertools.pairwise(edges):
            w, v = weight[begin:end], value[begin:end]
            fit -= 0.5 * float(np.sum(w * (v - np.average(v, weights=w)) ** 2))
        best = max(best, fit - float(sum(penalty[k] for k in edges[1:-1])))
    return best


@pytest.mark.parametrize("seed", range(5))
def test_the_best_steps_are_the_best_of_all(seed: int) -> None:
    """Dynamic programming finds what trying all sets of steps finds."""
    rng = np.random.default_rng(seed)
    value, weight = rng.normal(0.0, 3.0, (3, 9)), rng.uniform(0.2, 2.0, 9)
    penalty = np.where(rng.random(9) < 0.2, 0.0, 4.0)
    found, _ = partition(value, weight, penalty)
    assert [best_by_trying_all(one, weight, penalty) for one in value] == pytest.approx(found.tolist())


def readings(
    rate: float, days: int = 42, scatter: float = 1.5, seed: int = 1
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """A difference that falls by `rate` per cent per week from the tenth day on."""
    day = np.arange(float(days))
    rng = np.random.default_rng(seed)
    value = 4.0 - rate / 7.0 * np.maximum(day - 10.0, 0.0) + rng.normal(0.0, scatter, days)
    return day, value, np.full(days, 0.5), np.zeros(days, dtype=bool)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_trend_has_side_rate_and_date(sign: float) -> None:
    """4 % a week for 31 days: the side that falls, the rate, and the day on which 20 % are lost."""
    day, value, variance, known = readings(4.0)
    trend = find_trend(day, sign * value, variance, known)
    assert trend is not None
    assert trend.noticeable()
    assert (sign > 0.0) is trend.left
    assert pytest.approx(4.0, abs=3.0 * trend.rate_std) == trend.rate
    expected = 10.0 + 20.0 / 4.0 * 7.0 - day[-1]
    assert trend.low_in_d[0] <= expected <= trend.low_in_d[2]


@pytest.mark.parametrize(
    "shape",
    [
        lambda day: np.where(day < 20, 0.0, -9.0),
        lambda day: np.where(day < 14, 0.0, -6.0) + np.where(day < 30, 0.0, 5.0),
        lambda day: -0.4 / 7.0 * day,
    ],
    ids=["one step", "two steps", "unequal diffusion"],
)
@pytest.mark.parametrize("seed", range(4))
def test_steps_and_diffusion_are_no_leak(shape: object, seed: int) -> None:
    """A wheel that was changed, a refill, and 0.4 % a week more on one side are not noticed."""
    day = np.arange(45.0)
    rng = np.random.default_rng(seed)
    value = shape(day) + rng.normal(0.0, 1.5, day.size)  # type: ignore[operator]
    trend = find_trend(day, value, np.full(day.size, 0.5), np.zeros(day.size, dtype=bool))
    assert trend is not None
    assert not trend.noticeable()


def test_too_few_days_are_no_trend() -> None:
    """Thirteen days, or fourteen within twenty, say nothing."""
    day, value, variance, known = readings(10.0)
    assert find_trend(day[:13], value[:13], variance[:13], known[:13]) is None
    assert find_trend(day[:20], value[:20], variance[:20], known[:20]) is None


def test_an_independent_world_finds_the_leaking_wheel() -> None:
    """Cars of `bench/worlds/tyre_years.py`: none of two healthy half-years has a notice; of four leaks of 4 %
    a week three are noticed before 25 % are lost, none on another wheel."""
    assert [None] * 2 == [first_notice(draw_year(np.random.default_rng([3, k]), 180.0)) for k in range(2)]
    years = [draw_year(np.random.default_rng([4, k]), 75.0, Leak(k, 30.0, 4.0)) for k in range(4)]
    found = [first_notice(year) for year in years]
    assert all(notice is None or notice.wheel == k for k, notice in enumerate(found))
    assert sum(notice is not None for notice in found) >= 3


# -- history -------------------------------------------------------------------------------------------------

ROUGH = st.tuples(
    st.floats(-3.0, 60.0),
    st.one_of(st.just(math.nan), st.floats(-0.02, 0.02)),
    st.floats(0.0, 1e-6),
    st.booleans(),
)


@settings(derandomize=True, max_examples=100)
@given(st.lists(ROUGH, max_size=60))
def test_a_history_is_bounded_and_survives_json(
    steps: list[tuple[float, float, float, bool]],
) -> None:
    """Whatever the clock does: at most `most_days`, dates that never fall, and the same after a restart."""
    history, day = LeakHistory(), 20_000.0
    for ahead, difference, variance, reset in steps:
        day += ahead
        if reset:
            history.mark_step()
        history.add(day, np.array([difference, 0.001]), np.full(2, variance))
    dates = [one.day for one in history.days]
    assert len(dates) <= READINGS.most_days
    assert sorted(dates) == dates
    again = LeakHistory.from_json(json.loads(json.dumps(history.to_json())))
    assert history.to_json() == again.to_json()


def test_drives_of_a_day_are_one_reading() -> None:
    """Three drives on one day: their mean, with a ninth of the sum of their variances."""
    history = LeakHistory()
    for k, difference in enumerate((0.001, 0.002, 0.006)):
        history.add(20_000.1 + 0.2 * k, np.array([difference, math.nan]), np.full(2, 9e-8))
    (day,) = history.days
    assert pytest.approx(0.003) == day.difference_m[0]
    assert pytest.approx(3e-8) == day.variance_m2[0]
    assert math.isnan(day.difference_m[1])


def test_a_clock_that_was_years_off_leaves_no_trend_over_the_step() -> None:
    """After a step of the clock by years, or two months without a drive, the days before are forgotten."""
    history = LeakHistory()
    for day in (20_000.0, 20_001.0, 10_000.0, 10_001.0, 10_080.0):
        history.add(day, np.zeros(2), np.full(2, 1e-8))
    assert [10_080.0] == [one.day for one in history.days]


# -- the watch within the monitor ----------------------------------------------------------------------------


def days_of_driving(
    player: Player, first: int, days: int, percent: float, rng: np.random.Generator, refill: int | None = None
) -> list[AlarmEvent]:
    """One drive of twelve minutes a day; the rear left tyre loses `percent` a week from day 5 on."""
    events = []
    for day in range(first, first + days):
        player.time_s = START_S + day * DAY_S
        since = day if refill is None or day < refill else day - refill + 5
        lost_m = METRES_PER_PERCENT * percent / 7.0 * max(since - 5, 0)
        change = rng.normal(0.0, 2e-4, 4)
        change[2] -= lost_m / 0.316
        events += [one for one in player.play(730.0, tuple(change)) if one.kind == "slow_leak"]
    return events


def notices(player: Player) -> list[AlarmEvent]:
    return [event for event in player.last.active if event.kind == "slow_leak"]


def player_of(one: Monitor) -> Player:
    return Player(one, dt_s=10.0)


def test_a_leak_is_noticed_over_restarts_and_resets() -> None:
    """3 % a week, with a restart and a reset in between: a notice of rear left, with rate and date; its
    wheel is still monitored; it stands after a restart, and goes when the tyre is mended."""
    rng = np.random.default_rng(5)
    player = player_of(monitor(ALL, deflation_percent=2.0, deviation_percent=2.0))
    events = days_of_driving(player, 0, 18, 3.0, rng)
    saved = json.loads(json.dumps(player.monitor.snapshot()))
    player = player_of(monitor(ALL, deflation_percent=2.0, deviation_percent=2.0))
    player.monitor.restore(saved)
    player.monitor.reset()
    events += days_of_driving(player, 18, 24, 3.0, rng)
    assert [("slow_leak", "rl", "raised")] == said(events)
    (notice,) = notices(player)
    assert pytest.approx(3.0, abs=3.0 * notice.rate_std_percent_per_week) == notice.rate_percent_per_week
    low = datetime.fromtimestamp(START_S + (5 + 20.0 / 3.0 * 7.0) * DAY_S, UTC).date()
    assert notice.low_between[0] <= low.isoformat() <= notice.low_between[1]
    assert {"rate_percent_per_week", "low_on"} <= notice.additions().keys()
    assert WheelState.MONITORING is player.last.wheels[2].state

    saved = json.loads(json.dumps(player.monitor.snapshot()))
    player = player_of(monitor(ALL, deflation_percent=2.0, deviation_percent=2.0))
    player.monitor.restore(saved)
    player.play(10.0)
    assert [notice.additions()] == [event.additions() for event in notices(player)]
    assert [("slow_leak", "rl", "cleared")] == said(days_of_driving(player, 42, 40, 0.0, rng))


def test_other_tyres_take_the_notice_with_them() -> None:
    """A notice is of a set of tyres: with another set on the car it is taken back, with the reason."""
    rng = np.random.default_rng(6)
    player = player_of(monitor(ALL, deflation_percent=2.0, deviation_percent=2.0))
    assert [("slow_leak", "rl", "raised")] == said(days_of_driving(player, 0, 36, 4.0, rng))
    player.monitor.reset("winter")
    events = [event for event in player.play(10.0) if event.kind == "slow_leak"]
    assert [("slow_leak", "rl", "cleared")] == said(events)
    assert "winter is driven now" in events[0].reason


def test_settings_are_in_order() -> None:
    """What healthy tyres do is less than what a leak does."""
    assert TREND.healthy_rate < TREND.least_rate < TREND.most_rate
