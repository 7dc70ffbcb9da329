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

from bench.campaigns.onboard.slow_leak import METRES_PER_PERCENT, first_notice, leaking
from bench.worlds.tyre_years import Leak, draw_year
from tests.onboard.monitor.drives import ALL, REAR, START_S, VEHICLE, Player, monitor, said
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.baseline.reference import DRAG, GROWTH_OWN, RadiusReference
from tpmsd.onboard.monitor.monitor import Monitor
from tpmsd.onboard.monitor.records import AlarmEvent, WheelState
from tpmsd.onboard.monitor.sampling.conditions import Conditions
from tpmsd.onboard.monitor.settings import READINGS, REFERENCE, TREND
from tpmsd.onboard.monitor.slow_leaks.filter import NO_WHEEL, LeakFilter
from tpmsd.onboard.monitor.slow_leaks.history import LeakHistory
from tpmsd.onboard.monitor.slow_leaks.settings import TrendSettings
from tpmsd.onboard.monitor.slow_leaks.state import WHEEL_SETS
from tpmsd.onboard.monitor.slow_leaks.trend import Trend, has_ended, trend_of
from tpmsd.onboard.monitor.slow_leaks.watch import DriveReading

DAY_S = 86400.0


UNKNOWN = math.nan
NEVER = 1e15
ONLY_ALL = (1.0, *[1e-15] * 6)


def played(
    day: FloatArray,
    value: FloatArray,
    variance: FloatArray,
    known: FloatArray,
    settings: TrendSettings = TREND,
) -> LeakFilter:
    """A filter that has taken these days; `value` (n, 3), `variance` (n,) of each contrast."""
    out = LeakFilter(settings)
    for one in zip(day, value, variance, known, strict=True):
        out.add(float(one[0]), one[1], np.full(3, one[2]), bool(one[3]))
    return out


def test_a_reading_is_the_mean_of_samples_taken_at_their_interval() -> None:
    """Samples are due from a warm tyre on, once in `sample_s` of informative driving; a drive has one
    reading, at the latest when it is over, as precise as one sample."""
    reading, due = DriveReading(), []
    for second in range(round(READINGS.warm_s + READINGS.min_s) + 2):
        if reading.add_driving(1.0):
            due.append(float(second))
            reading.add(np.full(3, float(len(due))), np.full(3, 4.0))
    assert due[0] == math.ceil(READINGS.warm_s) - 1
    assert set(np.diff(due)) == {math.ceil(READINGS.sample_s)}
    assert reading.take_reading(over=False) is None
    result = reading.take_reading(over=True)
    assert result is not None
    assert result[0].tolist() == [(len(due) + 1) / 2.0] * 3
    assert result[1].tolist() == [4.0] * 3
    assert reading.take_reading(over=True) is None
    assert not reading.add_driving(READINGS.sample_s)


def test_the_watch_takes_samples_when_they_are_due() -> None:
    """Of informative driving every sample, and none between them."""
    player = Player(monitor())
    player.play(READINGS.warm_s - 5.0)
    watch = player.monitor._leaks
    assert watch._reading._samples == 0
    player.play(5.0 + 4.0 * READINGS.sample_s)
    assert watch._reading._samples in (4, 5)


def test_without_steps_leaks_and_outliers_it_is_the_gaussian_posterior() -> None:
    """Own radii, losses and rates are those of the joint normal distribution of all that is not known, with
    walks, drift and wear in the covariance of the readings."""
    plain = replace(
        TREND,
        noise_floor=(1.5, 1.0, 2.0),
        noise_shape=1e12,
        max_noise_shape=1e15,
        base_walk=0.1,
        drift_stds=((1.2, 0.9, 0.6),),
        outlier_share=1e-12,
        refill_every_d=NEVER,
        change_every_d=NEVER,
        leak_every_d=NEVER,
        rate_walk=0.0,
        step_after_gap=(0.0, 0.0),
    )
    n, rng = 25, np.random.default_rng(2)
    day = np.cumsum(rng.uniform(1.0, 3.0, n))
    value, variance = rng.normal(3.0, 2.0, (n, 3)), rng.uniform(0.1, 2.0, n)
    found = played(day, value, variance, np.zeros(n), plain).hypotheses
    best = int(np.argmax(found.log_weight))
    contrasts = np.array([[1, -1, 0, 0], [0, 0, 1, -1], [0.5, 0.5, -0.5, -0.5]])
    since = (day - day[0]) / 7.0
    radius = (
        plain.first_base_std**2
        + plain.refill_std**2
        + plain.base_walk**2 * np.minimum.outer(day - day[0], day - day[0])
        + plain.diffusion[1] ** 2 * np.outer(since, since)
    )
    spread = np.kron(radius, contrasts @ contrasts.T)
    wear = np.array([0.0, 0.0, -1.0])
    spread += np.kron(plain.wear_std**2 * np.outer(since, since), np.outer(wear, wear))
    decay = np.exp(-np.abs(np.subtract.outer(day, day)) / plain.drift_d)
    spread += np.kron(decay, np.diag(np.square(plain.drift_stds[0])))
    noise = variance[:, None] + np.square(plain.noise_floor)
    spread += np.diag(noise.ravel())
    # Of what is asked on the last day with each reading: own radii, losses, rates.
    walked = plain.first_base_std**2 + plain.base_walk**2 * (day - day[0])
    lost = -(plain.refill_std**2) - plain.diffusion[1] ** 2 * since * since[-1]
    wanted = np.stack([walked, lost, -(plain.diffusion[1] ** 2) * since])
    cross = np.concatenate([np.kron(row, contrasts.T) for row in wanted])
    # Wear shows in the own radii.
    half = np.array([-0.5, -0.5, 0.5, 0.5])
    cross[:4] += np.kron(plain.wear_std**2 * since * since[-1], np.outer(half, wear))
    gain = np.linalg.solve(spread, cross.T).T
    mean = np.repeat([0.0, plain.diffusion[0] * since[-1], plain.diffusion[0]], 4)
    assert mean + gain @ value.ravel() == pytest.approx(found.mean[best, :12], abs=1e-6)
    rates = plain.diffusion[1] ** 2 * np.eye(4) - gain[8:] @ cross[8:].T
    assert rates == pytest.approx(found.covariance[best, 8:12, 8:12], abs=1e-6)


def test_scatter_is_learned() -> None:
    """Where nothing else moves, the factor of the noise is the mean square of the readings, with the prior's
    square as so many readings more; both left-right differences share one."""
    still = replace(
        TREND,
        noise_floor=(1.0, 1.0, 2.0),
        first_base_std=1e-6,
        base_walk=0.0,
        refill_std=1e-6,
        diffusion=(0.0, 1e-9),
        wear_std=1e-9,
        rate_walk=0.0,
        drift_stds=((1e-6, 1e-6, 1e-6),),
        outlier_share=1e-12,
        refill_every_d=NEVER,
        change_every_d=NEVER,
        leak_every_d=NEVER,
    )
    value = np.random.default_rng(3).normal(0.0, (3.0, 3.0, 1.0), (30, 3))
    found = played(np.arange(30.0), value, np.zeros(30), np.zeros(30), still).hypotheses
    best, prior = int(np.argmax(found.log_weight)), still.noise_shape
    squares = [prior + 0.5 * np.sum(value[:, :2] ** 2), prior + 0.5 * np.sum((value[:, 2] / 2.0) ** 2)]
    assert squares == pytest.approx(found.noise[best], rel=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_steps_of_both_axles_at_one_time_are_refills(seed: int) -> None:
    """A difference that falls by 4 % twice: a leak is ten times less probable where the other axle takes
    steps on the same days than where it takes none."""
    day = np.arange(42.0)
    rng = np.random.default_rng(seed)
    first, second = day >= 14, day >= 28
    value = -4.0 * first - 4.0 * second + rng.normal(0.0, 2.0, day.size)
    other, unknown = rng.normal(0.0, 2.0, day.size), np.full(day.size, UNKNOWN)
    found = []
    for steps in (np.zeros(day.size), 5.0 * first - 6.0 * second):
        seen = np.stack([value, other + steps, unknown], axis=1)
        filter_ = played(day, seen, np.full(day.size, 0.5), np.zeros(day.size))
        found.append(filter_.probability(0))
        total = sum(filter_.probability(wheel) for wheel in range(NO_WHEEL, 4))
        assert total == pytest.approx(1.0)
    assert found[1] < 0.1 * found[0]


def test_refills_do_not_add_up() -> None:
    """What one filling leaves between left and right is gone with the next one: after three, the level to
    expect is that of independent draws about the tyres' own difference."""
    filled = replace(
        TREND,
        noise_floor=(1e-3, 1e-3, 1e-3),
        noise_shape=1e12,
        max_noise_shape=1e15,
        base_walk=1e-6,
        drift_stds=((1e-6, 1e-6, 1e-6),),
        diffusion=(0.0, 1e-9),
        rate_walk=0.0,
        outlier_share=1e-12,
        leak_every_d=1e15,
        step_at_reset=(1.0, 1e-12),
        refill_shares=ONLY_ALL,
    )
    value = np.full((4, 3), UNKNOWN)
    value[:, 0] = [6.0, 1.0, 8.0, 0.0]
    found = played(np.arange(4.0), value, np.array([0.0, 0.0, 0.0, 1e12]), np.ones(4), filled).hypotheses
    best = int(np.argmax(found.log_weight))
    # Three draws about a mean that is normal, too; the fourth is not seen.
    ratio = (filled.first_base_std / filled.refill_std) ** 2
    level = found.mean[best, 0] - found.mean[best, 1] - (found.mean[best, 4] - found.mean[best, 5])

    assert level == pytest.approx(ratio * value[:3, 0].sum() / (1.0 + 3.0 * ratio), abs=1e-3)


@settings(derandomize=True, max_examples=8, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.1, 900.0), st.floats(-9.0, 9.0), st.booleans()), min_size=2, max_size=6)
)
def test_left_and_right_are_equal(steps: list[tuple[float, float, bool]]) -> None:
    """Turned over, the readings say of one side what they said of the other, however far apart they are;
    probabilities sum to one."""
    ahead, value, known = (np.array(column, dtype=np.float64) for column in zip(*steps, strict=True))
    day, variance = np.cumsum(ahead), np.full(len(steps), 0.5)
    seen = np.outer(value, [1.0, 0.3, 0.5])
    one = played(day, seen, variance, known)
    other = played(day, seen * [-1.0, -1.0, 1.0], variance, known)
    assert one.probability(0) == pytest.approx(other.probability(1), abs=1e-9)
    assert one.probability(3) == pytest.approx(other.probability(2), abs=1e-9)
    assert sum(one.probability(wheel) for wheel in range(NO_WHEEL, 4)) == pytest.approx(1.0)


SHOWS = {0: (-1.0, 0.0, -0.5), 1: (1.0, 0.0, -0.5), 2: (0.0, -1.0, 0.5), 3: (0.0, 1.0, 0.5)}
"""What a loss of each tyre does to the contrasts."""


def readings(
    wheel: int, rate: float, days: int = 42, scatter: float = 1.5, seed: int = 1
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Contrasts of a car with a tyre that loses `rate` per cent per week from the tenth day on."""
    day = np.arange(float(days))
    rng = np.random.default_rng(seed)
    lost = rate / 7.0 * np.maximum(day - 10.0, 0.0)
    value = 4.0 + np.outer(lost, SHOWS[wheel]) + rng.normal(0.0, scatter, (days, 3))
    return day, value, np.full(days, 0.5), np.zeros(days, dtype=bool)


@pytest.mark.parametrize("wheel", range(4))
def test_a_trend_has_wheel_rate_and_date(wheel: int) -> None:
    """4 % a week for 31 days: the tyre, the rate, and the day on which 20 % are lost."""
    day, value, variance, known = readings(wheel, 4.0)
    trend = trend_of(played(day, value, variance, known))
    assert trend is not None
    assert trend.noticeable()
    assert wheel == trend.wheel
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
    lost = -shape(day)  # type: ignore[operator]
    value = np.outer(lost, SHOWS[0]) + rng.normal(0.0, 1.5, (day.size, 3))
    trend = trend_of(played(day, value, np.full(day.size, 0.5), np.zeros(day.size)))
    assert trend is None or not trend.noticeable()


def test_wear_of_the_driven_axle_is_no_leak() -> None:
    """Both front tyres lose 0.6 % a week of radius more than the rear ones, for half a year: no notice."""
    day = np.arange(0.0, 180.0, 2.0)
    value = np.outer(0.6 / 7.0 * day, [0.0, 0.0, -1.0])
    value += np.random.default_rng(8).normal(0.0, 1.5, (day.size, 3))
    trend = trend_of(played(day, value, np.full(day.size, 0.5), np.zeros(day.size)))
    assert trend is None or not trend.noticeable()


def test_a_steep_fall_of_a_week_is_no_leak_yet() -> None:
    """10 % a week, from the tenth day on: not noticed within the week, and noticed after three."""
    day, value, variance, known = readings(0, 10.0)
    early = trend_of(played(day[:18], value[:18], variance[:18], known[:18]))
    assert early is None or not early.noticeable()
    late = trend_of(played(day[:32], value[:32], variance[:32], known[:32]))
    assert late is not None
    assert late.noticeable()


def test_a_small_loss_is_no_leak_yet() -> None:
    """A trend as certain as may be is noticed once 6 % are lost since it began, not before."""
    sure = Trend(1.0, 0, 2.0, 0.1, 5.0, 20.0, 0.0, (0.0, 0.0, 0.0))
    assert [False, True] == [replace(sure, span_d=days).noticeable() for days in (20.9, 21.1)]


def test_a_leak_that_goes_on_has_not_ended_and_one_that_stopped_has() -> None:
    """Of three weeks at 3 % a week, and of three weeks at nothing, after a notice of 3 +- 0.4 % a week."""
    day = np.arange(21.0)
    scatter = np.random.default_rng(7).normal(0.0, 1.0, (day.size, 3))
    ended = []
    for rate in (3.0, 0.0):
        since = LeakFilter(TREND, (0, 3.0, 0.4))
        for at, value in zip(day, scatter + np.outer(rate / 7.0 * day, SHOWS[0]), strict=True):
            since.add(float(at), value, np.full(3, 0.5))
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


def test_leaks_between_refills_are_noticed() -> None:
    """Cars of that world whose tyres are filled during a leak of 2 % a week: it is in time for all three (the
    axles apart, each left-right difference has refills of its own, which explain the leak)."""
    seeds = (1030, 1038, 1043)
    assert not {seed for seed in seeds if leaking(seed, 1, 2.0)["in_time"]["share"] < 1.0}


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
    """Whatever the clock does: bounded, dates that never fall, and the same after a restart."""
    history, day = LeakHistory(), 20_000.0
    for ahead, difference, variance, reset in steps:
        day += ahead
        if reset:
            history.mark_step()
        history.add(day, np.array([difference, 0.001, difference]), np.full(3, variance))
    dates = [one.day for one in history.readings]
    assert len(dates) <= READINGS.max_readings
    assert sorted(dates) == dates
    again = LeakHistory.from_json(json.loads(json.dumps(history.to_json())))
    assert history.to_json() == again.to_json()


def test_drives_of_a_day_are_held_against_the_same_steps() -> None:
    """Three drives of a day, apart by days or on one: level and uncertainty are those of the three readings
    by their own variances, and it counts as one day."""
    still = replace(
        TREND,
        noise_floor=(1e-6, 1e-6, 1e-6),
        noise_shape=1e12,
        max_noise_shape=1e15,
        drift_stds=((1e-6, 1e-6, 1e-6),),
        outlier_share=1e-12,
    )
    value, variance = np.array([4.0, 7.0, 1.0]), np.array([1.0, 4.0, 0.25])
    filter_ = LeakFilter(still)
    for k in range(3):
        filter_.add(20_000.1 + 0.2 * k, np.array([value[k], UNKNOWN, UNKNOWN]), np.full(3, variance[k]))
    (mean,), (covariance,) = filter_.hypotheses.mean, filter_.hypotheses.covariance
    level = np.array([1.0, -1.0, 0, 0, -1.0, 1.0])
    before = 1.0 / (2.0 * (still.first_base_std**2 + still.refill_std**2))
    precision = before + (1.0 / variance).sum()
    assert mean[:6] @ level == pytest.approx((value / variance).sum() / precision, rel=1e-6)
    assert level @ covariance[:6, :6] @ level == pytest.approx(1.0 / precision, rel=1e-5)
    assert [1.0] == filter_.hypotheses.days.tolist()


def test_a_drive_that_is_off_costs_less_than_its_share_of_a_day() -> None:
    """Four drives a day, one of them 12 % off: a leak of 3 % a week is followed to within 0.8 %, and the mean
    over each day's drives would be off by 3 %."""
    rng = np.random.default_rng(4)
    filter_ = LeakFilter()
    for day in range(45):
        for k in range(4):
            lost = 3.0 / 7.0 * max(day - 10, 0)
            error = rng.normal(0.0, 1.0, 3) + (k == 2) * rng.choice([-12.0, 12.0])
            filter_.add(day + 0.2 * k, 2.0 + lost * np.array(SHOWS[1]) + error, np.full(3, 0.5))
    trend = trend_of(filter_)
    assert trend is not None
    assert (1, True) == (trend.wheel, trend.noticeable())
    assert pytest.approx(3.0, abs=0.8) == trend.rate


def test_a_clock_that_was_years_off_leaves_no_trend_over_the_step() -> None:
    """After a step of the clock by years, or two months without a drive, the days before are forgotten."""
    history = LeakHistory()
    for day in (20_000.0, 20_001.0, 10_000.0, 10_001.0, 10_080.0):
        history.add(day, np.zeros(3), np.full(3, 1e-8))
    assert [10_080.0] == [one.day for one in history.readings]


def test_a_history_of_before_is_taken_up_without_front_against_rear() -> None:
    """Saved days of left-right differences alone: kept, and the third contrast is not known."""
    history = LeakHistory.from_json(
        {"step_next": False, "days": [[20_000.5, 0.001, None, 1e-8, None, 2, True]]}
    )
    (one,) = history.readings
    assert (0.001, 1e-8, True) == (one.difference_m[0], one.variance_m2[0], one.known_step)
    assert [True, True] == [math.isnan(x) for x in one.difference_m[1:]]
    with pytest.raises(ValueError, match="tyres are none"):
        LeakHistory.from_json({"step_next": False, "days": [[20_000.5, 0.001, 1e-8, True]]})


def test_the_mean_over_a_days_drives_of_before_is_taken_up_as_a_reading() -> None:
    """Saved days of two drives each: their means and variances, without the number."""
    day = [20_000.5, 0.001, None, 0.002, 1e-8, None, 2e-8, 2, False]
    history = LeakHistory.from_json({"step_next": False, "days": [day]})
    assert {"step_next": False, "days": [[*day[:7], False]]} == history.to_json()


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
        events += [one for one in player.play(750.0, tuple(change)) if one.kind == "slow_leak"]
    return events


def notices(player: Player) -> list[AlarmEvent]:
    return [event for event in player.last.active if event.kind == "slow_leak"]


def player_of(one: Monitor) -> Player:
    return Player(one, dt_s=30.0)


@pytest.fixture(scope="module")
def noticed_leak() -> tuple[Player, list[AlarmEvent], str]:
    """42 days of a leak of 3 % a week with a restart and a reset after 18: player, events and saved state."""
    rng = np.random.default_rng(5)
    player = player_of(monitor(ALL, deflation_percent=2.0, deviation_percent=2.0))
    events = days_of_driving(player, 0, 18, 3.0, rng)
    saved = json.loads(json.dumps(player.monitor.snapshot()))
    player = player_of(monitor(ALL, deflation_percent=2.0, deviation_percent=2.0))
    player.monitor.restore(saved)
    player.monitor.reset()
    events += days_of_driving(player, 18, 24, 3.0, rng)
    return player, events, json.dumps(player.monitor.snapshot())


def restarted(state: str) -> Player:
    """A daemon that took over this state, half a minute after its start at the end of the 42 days."""
    player = player_of(monitor(ALL, deflation_percent=2.0, deviation_percent=2.0))
    player.time_s = START_S + 42 * DAY_S
    player.monitor.restore(json.loads(state))
    player.play(30.0)
    return player


def test_a_leak_is_noticed_over_restarts_and_resets(
    noticed_leak: tuple[Player, list[AlarmEvent], str],
) -> None:
    """3 % a week, with a restart and a reset in between: a notice of rear left, with rate and date; its
    wheel is still monitored; it stands after a restart, and goes when the tyre is mended."""
    player, events, state = noticed_leak
    assert [("slow_leak", "rl", "raised")] == said(events)
    (notice,) = notices(player)
    assert pytest.approx(3.0, abs=3.0 * notice.rate_std_percent_per_week) == notice.rate_percent_per_week
    low = datetime.fromtimestamp(START_S + (5 + 20.0 / (3.0 + TREND.diffusion[0]) * 7.0) * DAY_S, UTC).date()
    assert notice.low_between[0] <= low.isoformat() <= notice.low_between[1]
    assert {"rate_percent_per_week", "low_on"} <= notice.additional_keys().keys()
    assert WheelState.MONITORING is player.last.wheels[2].state

    player = restarted(state)
    assert [notice.additional_keys()] == [event.additional_keys() for event in notices(player)]
    mended = days_of_driving(player, 42, 40, 0.0, np.random.default_rng(7))
    assert [("slow_leak", "rl", "cleared")] == said(mended)


def test_a_car_with_two_read_wheels_gets_its_notice() -> None:
    """The front wheels are not read, so that nothing is known of them: their NaN reach no contrast."""
    player = player_of(monitor(REAR, deflation_percent=2.0, deviation_percent=2.0))
    events = days_of_driving(player, 0, 42, 3.0, np.random.default_rng(5))
    assert [("slow_leak", "rl", "raised")] == said(events)


def test_a_reading_of_front_against_rear_is_free_of_slip_by_speed() -> None:
    """What is taken off a reading: 1e-4 of the radius that each wheel grows alone and 2e-4 that driven wheels
    slip, at the speed to which these belong; at twice the speed four times as much."""
    reference = RadiusReference(VEHICLE)
    assert VEHICLE.driven_axle == "front"
    reference.mean[GROWTH_OWN] = [1e-4, 0.0, 0.0, 0.0]
    reference.mean[DRAG] = 2e-4
    radius = np.array(VEHICLE.wheel_radius_m)
    for factor in (1.0, 4.0):
        at = Conditions(factor * REFERENCE.per_speed2, 0.0, (0.0, 0.0), 0.0, 0.0)
        expected = factor * radius * np.array([1e-4 - 2e-4, -2e-4, 0.0, 0.0])
        assert expected == pytest.approx(reference.own_growth_m(at))


def test_other_tyres_take_the_notice_with_them(noticed_leak: tuple[Player, list[AlarmEvent], str]) -> None:
    """A notice is of a set of tyres: with another set on the car it is taken back, with the reason."""
    player = restarted(noticed_leak[2])
    assert ["rl"] == [event.wheel for event in notices(player)]
    player.monitor.reset("winter")
    events = [event for event in player.play(30.0) if event.kind == "slow_leak"]
    assert [("slow_leak", "rl", "cleared")] == said(events)
    assert "winter is driven now" in events[0].reason


def test_settings_are_in_order() -> None:
    """What healthy tyres do is less than what a leak does; shares are shares."""
    assert 3.0 * TREND.diffusion[1] < TREND.min_rate < min(rate for rate, _, _ in TREND.leak_rates)
    assert 1.0 == pytest.approx(sum(share for _, _, share in TREND.leak_rates))
    assert 1.0 == pytest.approx(sum(TREND.refill_shares)) == pytest.approx(sum(TREND.change_shares))
    assert len(WHEEL_SETS) == len(TREND.refill_shares) == len(TREND.change_shares)


def test_a_leak_goes_on_by_the_readings_of_the_last_days_that_had_any() -> None:
    """As many days as it takes to clear it, each with all of its drives; days without one do not count."""
    history, days = LeakHistory(), TREND.clear_days + 3
    for day in range(days):
        for hour in (8.0, 17.0):
            history.add(20_000.0 + 2 * day + hour / 24.0, np.zeros(3), np.full(3, 1e-8))
    last = [20_000.0 + 2 * day + hour / 24.0 for day in range(3, days) for hour in (8.0, 17.0)]

    assert last == [one.day for one in history.recent_readings(0.0)]
    assert last[3:] == [one.day for one in history.recent_readings(last[3])]
