"""Slow leaks over weeks of drives: what is noticed, what is not, and what is kept."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.campaigns.slow_leak import METRES_PER_PERCENT, first_notice
from bench.worlds.tyre_years import Leak, draw_year
from tests.monitor.drives import ALL, START_S, Player, monitor, said
from tpmsd.monitor.leak_filter import LEFT, LEVEL, NONE, RIGHT, LeakFilter
from tpmsd.monitor.leak_history import LeakHistory
from tpmsd.monitor.leak_settings import TrendSettings
from tpmsd.monitor.leak_trend import has_ended, trend_of
from tpmsd.monitor.monitor import Monitor
from tpmsd.monitor.records import AlarmEvent, WheelState
from tpmsd.monitor.settings import READINGS, TREND
from tpmsd.wheels import FloatArray

DAY_S = 86400.0


def played(
    day: FloatArray,
    value: FloatArray,
    variance: FloatArray,
    known: FloatArray,
    settings: TrendSettings = TREND,
) -> LeakFilter:
    """A filter that has taken these days."""
    out = LeakFilter(settings)
    for one in zip(day, value, variance, known, strict=True):
        out.add(float(one[0]), float(one[1]), float(one[2]), bool(one[3]))
    return out


def test_without_steps_leaks_and_outliers_it_is_the_gaussian_posterior() -> None:
    """Level and rate are those of generalised least squares with the level's walk and drift in the
    covariance."""
    never = 1e15
    plain = replace(
        TREND,
        scatters=(1.5,),
        stated_shares=(1.3,),
        level_walk=0.1,
        drift_stds=(1.2,),
        outlier_share=1e-12,
        refill_every_d=never,
        change_every_d=never,
        leak_every_d=never,
        rate_walk=0.0,
        step_after_gap=(0.0, 0.0),
    )
    rng = np.random.default_rng(2)
    day = np.cumsum(rng.uniform(0.5, 3.0, 25))
    value, variance = rng.normal(3.0, 2.0, 25), rng.uniform(0.1, 2.0, 25)
    found = played(day, value, variance, np.zeros(25), plain).hypotheses
    best = int(np.argmax(found.log_weight))
    # Unknown: the level on the last day, the rate; what the level walks is noise that the days share.
    ahead = (day - day[-1]) / 7.0
    design = np.stack([np.ones(25), ahead], axis=1)
    walk = 0.1**2 * np.minimum.outer(day[-1] - day, day[-1] - day)
    first = np.array([math.hypot(plain.first_level_std, plain.refill_std), plain.healthy_rate_std])
    start = (day[0] - day[-1]) / 7.0  # the prior is of the first day's level
    back = np.array([[1.0, -start], [0.0, 1.0]])
    walked = 0.1**2 * (day[-1] - day[0])
    prior = back @ np.diag(first**2) @ back.T + np.diag([walked, 0.0])
    shared = 0.1**2 * (day[-1] - day)  # of walk and last level, which the walk ends in
    cross = np.stack([-shared, np.zeros(25)], axis=1)
    spread = design @ prior @ design.T + walk + cross @ design.T + design @ cross.T
    spread += 1.2**2 * np.exp(-np.abs(np.subtract.outer(day, day)) / plain.drift_d)
    spread += np.diag(1.3 * variance + 1.5**2)
    gain = np.linalg.solve(spread, design @ prior + cross).T
    expected = gain @ value
    assert expected == pytest.approx(found.mean[best, :2], abs=1e-6)
    covariance = prior - gain @ (design @ prior + cross)
    assert covariance == pytest.approx(found.covariance[best, :2, :2], abs=1e-6)


@pytest.mark.parametrize("both", [True, False])
def test_wheels_that_are_changed_on_both_axles_are_no_leak(both: bool) -> None:
    """A difference that has fallen by 9 % in uncertain readings: a leak is less probable where the other axle
    took a step at that time, and more where it took none."""
    day = np.arange(40.0)
    rng = np.random.default_rng(5)
    value = np.where(day < 20, 0.0, -9.0) + rng.normal(0.0, 3.0, day.size)
    other = rng.normal(0.0, 1.0, day.size) + np.where((day < 20) | (not both), 0.0, 12.0)
    known, variance = np.zeros(day.size), np.full(day.size, 1.0)
    alone = played(day, value, variance, known)
    together = alone.beside(played(day, other, variance, known))

    assert both is (together.probability(LEFT) < alone.probability(LEFT))
    assert together.probability(NONE) + together.probability(LEFT) + together.probability(
        RIGHT
    ) == pytest.approx(1.0)


def test_refills_do_not_add_up() -> None:
    """What one filling leaves between left and right is gone with the next one: after three, the level to
    expect is that of independent draws about the tyres' own difference."""
    filled = replace(
        TREND,
        scatters=(1e-3,),
        stated_shares=(1.0,),
        level_walk=1e-6,
        drift_stds=(1e-6,),
        healthy_rate_std=1e-9,
        rate_walk=0.0,
        outlier_share=1e-12,
        leak_every_d=1e15,
        step_at_reset=(1.0, 0.0),
    )
    value = np.array([6.0, 1.0, 8.0, 0.0])
    found = played(np.arange(4.0), value, np.array([0.0, 0.0, 0.0, 1e12]), np.ones(4), filled).hypotheses
    best = int(np.argmax(found.log_weight))
    # Three draws about a mean that is normal, too; the fourth is not seen.
    ratio = (filled.first_level_std / filled.refill_std) ** 2

    assert found.mean[best, LEVEL] == pytest.approx(ratio * value[:3].sum() / (1.0 + 3.0 * ratio), abs=1e-3)


@settings(derandomize=True, max_examples=8, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.1, 900.0), st.floats(-9.0, 9.0), st.booleans()), min_size=2, max_size=6)
)
def test_left_and_right_are_alike(steps: list[tuple[float, float, bool]]) -> None:
    """Turned over, the readings say of one side what they said of the other, however far apart they are;
    probabilities sum to one."""
    ahead, value, known = (np.array(column, dtype=np.float64) for column in zip(*steps, strict=True))
    day, variance = np.cumsum(ahead), np.full(len(steps), 0.5)
    one, other = played(day, value, variance, known), played(day, -value, variance, known)
    assert one.probability(LEFT) == pytest.approx(other.probability(RIGHT), abs=1e-9)
    total = one.probability(LEFT) + one.probability(RIGHT) + one.probability(NONE)
    assert total == pytest.approx(1.0)


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
    trend = trend_of(played(day, sign * value, variance, known))
    assert trend is not None
    assert trend.noticeable()
    assert (sign > 0.0) is trend.left
    assert pytest.approx(4.0, abs=3.0 * trend.rate_std) == trend.rate
    expected = 10.0 + 20.0 / (4.0 + TREND.diffusion[0]) * 7.0 - day[-1]
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
    trend = trend_of(played(day, value, np.full(day.size, 0.5), np.zeros(day.size)))
    assert trend is None or not trend.noticeable()


def test_a_steep_fall_of_a_week_is_no_leak_yet() -> None:
    """10 % a week, from the tenth day on: not noticed within the week, and noticed after three."""
    day, value, variance, known = readings(10.0)
    early = trend_of(played(day[:18], value[:18], variance[:18], known[:18]))
    assert early is None or not early.noticeable()
    late = trend_of(played(day[:32], value[:32], variance[:32], known[:32]))
    assert late is not None
    assert late.noticeable()


def test_a_leak_that_goes_on_has_not_ended_and_one_that_stopped_has() -> None:
    """Of three weeks at 3 % a week, and of three weeks at nothing, after a notice of 3 +- 0.4 % a week."""
    day = np.arange(21.0)
    scatter = np.random.default_rng(7).normal(0.0, 1.0, day.size)
    ended = []
    for rate in (3.0, 0.0):
        since = LeakFilter(TREND, (LEFT, 3.0, 0.4))
        for at, value in zip(day, scatter - rate / 7.0 * day, strict=True):
            since.add(float(at), float(value), 0.5)
        ended.append(has_ended(since))
    assert [False, True] == ended


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
    low = datetime.fromtimestamp(START_S + (5 + 20.0 / (3.0 + TREND.diffusion[0]) * 7.0) * DAY_S, UTC).date()
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
    assert 3.0 * TREND.healthy_rate_std < TREND.least_rate < min(rate for rate, _, _ in TREND.leak_rates)
    assert 1.0 == pytest.approx(sum(share for _, _, share in TREND.leak_rates))
