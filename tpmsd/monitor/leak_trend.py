"""Whether one tyre of an axle loses air over weeks, by the left-right difference of their radii.

In: one left-right difference per day, in per cent of pressure, with its variance. Out: a `Trend`: how much
better a leak explains the days than steps do, which side leaks, its rate, and when it will be 20 % low.

Left and right of an axle have the same temperature, age and (nearly) load, so their difference holds neither
seasons nor the diffusion of all four. What is left in a healthy car: scatter from day to day, steps
(a refill, wheels that changed places, another load) and a small difference of diffusion. So two models are
compared by their penalised log-likelihood:

    steady  steps anywhere, and a linear trend of at most `TrendSettings.healthy_rate`
    leak    steps anywhere, and from one day on a linear trend of `least_rate` and more

Each step costs `step_penalty`; one at a reset, or after days without a drive, is free. For each trend the
best steps are found exactly by dynamic programming (optimal partitioning: Jackson et al. 2005, IEEE Signal
Processing Letters 12).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tpmsd.monitor.settings import TREND, TrendSettings
from tpmsd.wheels import FloatArray

WEEK_D = 7.0
FINER = np.exp(np.linspace(-TREND.finer_logs, TREND.finer_logs, TREND.finer_rates))
"""Rates that are tried about the best of the coarse ones, relative to it."""


@dataclass(frozen=True, slots=True)
class Trend:
    """What the days of one axle say."""

    gain: float
    """Penalised log-likelihood of the best leak minus that of the best steady history, nats."""
    left: bool
    """Whether the left tyre leaks."""
    rate: float
    """Per cent of pressure per week, and its standard deviation."""
    rate_std: float
    lost: float
    """Per cent of pressure since the leak began, less what was refilled."""
    days: int
    span_d: float
    """Of the readings since the leak began."""
    low_in_d: tuple[float, float, float]
    """Days from the last reading until 20 % are lost: 2.5 %, 50 % and 97.5 % quantile; not below zero."""

    def noticeable(self, settings: TrendSettings = TREND) -> bool:
        """Whether it is a leak beyond doubt."""
        return (
            self.gain >= settings.raise_gain
            and self.days >= settings.least_days
            and self.span_d >= settings.least_span_d
            and self.rate * self.span_d / WEEK_D >= settings.least_fall
            and self.rate - 2.0 * self.rate_std >= settings.sure_rate
        )


def scatter(values: FloatArray, settings: TrendSettings = TREND) -> float:
    """Standard deviation of one day's reading (n,), from differences of successive days: trends and steps
    hardly show in them."""
    if values.size < 3:
        return math.inf
    off = np.abs(np.diff(values) - np.median(np.diff(values)))
    return max(1.4826 * float(np.median(off)) / math.sqrt(2.0), settings.scatter_floor)


def _weights(variance: FloatArray, std: float, settings: TrendSettings) -> FloatArray:
    """(n,) one over the variance of each reading: what the estimates state, and what they scatter beyond."""
    beyond = max(std**2 - float(np.median(variance)), settings.scatter_floor**2)
    return np.asarray(1.0 / (beyond + np.minimum(variance, (4.0 * std) ** 2)))


def without_outliers(values: FloatArray, std: float, settings: TrendSettings = TREND) -> FloatArray:
    """(n,) each reading held to the median of the five around it."""
    padded = np.pad(values, 2, mode="edge")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)
    limit = settings.outlier * std
    return np.asarray(middle + np.clip(values - middle, -limit, limit))


def partition(
    values: FloatArray, weight: FloatArray, penalty: FloatArray
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Log-likelihood (c,) of the best steps for c series (c, n) of readings with weight 1/variance (n,).

    penalty (n,): nats for a step before each reading. Also where the last level begins (c, n + 1), by number
    of readings taken.
    """
    series, n = values.shape
    first, second, total = np.zeros((n + 1, series)), np.zeros((n + 1, series)), np.zeros(n + 1)
    first[1:] = np.cumsum(weight[:, None] * values.T, axis=0)
    second[1:] = 0.5 * np.cumsum(weight[:, None] * values.T**2, axis=0)
    total[1:] = np.cumsum(weight)
    # Of a history that ends before reading i: its best fit, less what the first i readings add to the last.
    ahead = np.zeros((n + 1, series))
    begin = np.zeros((series, n + 1), dtype=np.int64)
    best = np.zeros(series)
    columns = np.arange(series)
    for end in range(1, n + 1):
        fit = first[end] - first[:end]
        fit *= fit
        fit *= (0.5 / (total[end] - total[:end]))[:, None]
        fit += ahead[:end]
        begin[:, end] = np.argmax(fit, axis=0)
        best = fit[begin[:, end], columns] - second[end]
        if end < n:
            ahead[end] = best + second[end] - penalty[end]
    return best, begin


def find_trend(
    day: FloatArray,
    value: FloatArray,
    variance: FloatArray,
    known_steps: NDArray[np.bool_],
    settings: TrendSettings = TREND,
) -> Trend | None:
    """The best leak of either side; None with too few days.

    day (n,) rising; value (n,) left minus right in per cent of pressure; variance (n,) of the estimates;
    known_steps (n,): whether a step before the reading is known and free.
    """
    if day.size < settings.least_days or day[-1] - day[0] < settings.least_span_d:
        return None
    std = scatter(value, settings)
    weight = _weights(variance, std, settings)
    held = without_outliers(value, std, settings)
    parked = np.diff(day, prepend=day[0]) > settings.gap_d
    penalty = np.where(known_steps | parked, 0.0, settings.step_penalty)
    slopes = np.linspace(-settings.healthy_rate, settings.healthy_rate, 5)
    healthy, _ = partition(held - slopes[:, None] * (day - day[0]) / WEEK_D, weight, penalty)
    onsets, last = _onsets(day, settings)
    rates = np.geomspace(settings.least_rate, settings.most_rate, settings.rates)
    coarse = {left: _leaks(day, held, weight, penalty, onsets, rates, left=left) for left in (True, False)}
    left = max(coarse, key=lambda side: float(coarse[side].fit.max()))
    best = int(np.argmax(coarse[left].fit))
    near = coarse[left].onset[best] + np.arange(-2, 3)
    rates = np.clip(coarse[left].rate[best] * FINER, settings.least_rate, settings.most_rate)
    near = np.unique(np.clip(near, 0, last))
    fine = _leaks(day, held, weight, penalty, near, np.unique(rates), left=left)
    best = int(np.argmax(fine.fit))
    chance = np.exp(fine.fit - fine.fit[best])
    chance /= chance.sum()
    rate = float(chance @ fine.rate)
    onset = int(fine.onset[best])
    ramp = fine.rate[best] * np.maximum(day - day[onset], 0.0) / WEEK_D
    flat = (held if left else -held) + ramp
    refilled = _risen(flat, weight, fine.begin[best], onset)
    lost = np.maximum(fine.rate * (day[-1] - day[fine.onset]) / WEEK_D - refilled, 0.0)
    left_d = np.maximum(settings.low_percent - lost, 0.0) / fine.rate * WEEK_D
    return Trend(
        gain=float(fine.fit[best] - healthy.max()) - math.log(last + 1),
        left=left,
        rate=rate,
        rate_std=math.sqrt(float(chance @ (fine.rate - rate) ** 2)),
        lost=float(chance @ lost),
        days=int(day.size - onset),
        span_d=float(day[-1] - day[onset]),
        low_in_d=_quantiles(left_d, chance),
    )


@dataclass(frozen=True, slots=True)
class _Leaks:
    """c leaks tried; (c,) each."""

    fit: FloatArray
    onset: NDArray[np.int64]
    rate: FloatArray
    begin: NDArray[np.int64]
    """(c, n + 1) as of `partition`."""


def _leaks(
    day: FloatArray,
    held: FloatArray,
    weight: FloatArray,
    penalty: FloatArray,
    onsets: NDArray[np.int64],
    rates: FloatArray,
    *,
    left: bool,
) -> _Leaks:
    """Every onset with every rate."""
    onset, rate = np.tile(onsets, rates.size), np.repeat(rates, onsets.size)
    ramps = rate[:, None] * np.maximum(day - day[onset, None], 0.0) / WEEK_D
    fit, begin = partition(held + ramps if left else held - ramps, weight, penalty)
    return _Leaks(fit, onset, rate, begin)


def has_ended(
    day: FloatArray,
    value: FloatArray,
    variance: FloatArray,
    left: bool,
    rate: float,
    settings: TrendSettings = TREND,
) -> bool:
    """Whether these days, as for `find_trend`, speak against a leak of this side and rate going on."""
    if day.size < settings.least_days // 2:
        return False
    std = scatter(value, settings)
    weight = _weights(variance, std, settings)
    held = without_outliers(value, std, settings)
    ramp = (-rate if left else rate) * (day - day[0]) / WEEK_D
    fits, _ = partition(held - np.stack([0.0 * ramp, ramp]), weight, np.full(day.size, settings.step_penalty))
    return bool(fits[0] - fits[1] >= settings.clear_gain)


def _risen(flat: FloatArray, weight: FloatArray, begin: NDArray[np.int64], onset: int) -> float:
    """By how much the levels (n,) rose in steps after the onset: what was refilled."""
    edges = [flat.size]
    while edges[-1] > 0:
        edges.append(int(begin[edges[-1]]))
    levels = [(a, float(np.average(flat[a:b], weights=weight[a:b]))) for b, a in pairwise(edges)]
    # From the last level to the first.
    return sum(max(later - level, 0.0) for (a, later), (_, level) in pairwise(levels) if a > onset)


def _onsets(day: FloatArray, settings: TrendSettings) -> tuple[NDArray[np.int64], int]:
    """Readings at which a leak may begin, thinned, and the last of all: enough days must follow."""
    last = max(int(np.searchsorted(day, day[-1] - settings.least_span_d, side="right")) - 1, 0)
    last = min(last, day.size - settings.least_days)
    thinned = np.linspace(0, last, min(settings.onsets, last + 1)).round().astype(np.int64)
    return np.unique(thinned), last


def _quantiles(values: FloatArray, chance: FloatArray) -> tuple[float, float, float]:
    """2.5 %, 50 % and 97.5 % of values (c,) with their chances."""
    order = np.argsort(values)
    places = np.searchsorted(np.cumsum(chance[order]), (0.025, 0.5, 0.975))
    low, middle, high = values[order[np.minimum(places, order.size - 1)]]
    return float(low), float(middle), float(high)
