"""Marginals of the hypotheses of `filter`: whether one of four tyres loses air over weeks.

In: a `LeakFilter`. Out: a `Trend`: the probability of a leak, its wheel and rate, and when the tyre will be
20 % low.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from tpmsd.foundation.wheels import AXLES, FloatArray
from tpmsd.onboard.monitor.evidence.probability import normal_cdf
from tpmsd.onboard.monitor.settings import TREND
from tpmsd.onboard.monitor.slow_leaks.filter import NO_WHEEL, LeakFilter, LeakHypotheses
from tpmsd.onboard.monitor.slow_leaks.settings import TrendSettings
from tpmsd.onboard.monitor.slow_leaks.state import LOST, RATE, SIZE, WEEK_D

NORMAL = NormalDist()
"""The standard normal distribution."""


@dataclass(frozen=True, slots=True)
class Trend:
    """Trend of the tyre that leaks most probably."""

    probability: float
    """Probability of a leak of `min_rate` and more in it."""
    wheel: int
    rate: float
    """Per cent of pressure per week beyond the other tyre of its axle, and its standard deviation."""
    rate_std: float
    lost: float
    """Per cent of pressure that the tyre lacks of the other wheel of its axle's, by loss and filling."""
    days: float
    span_d: float
    """Days with readings since the leak began, and the time since; expected values."""
    low_in_d: tuple[float, float, float]
    """Days from the last reading until 20 % are lost: 2.5 %, 50 % and 97.5 % quantile; not below zero."""

    def noticeable(self, settings: TrendSettings = TREND) -> bool:
        """Return whether the leak is probable, long and large enough for a notice."""
        return (
            self.probability >= settings.raise_probability
            and self.days >= settings.min_days
            and self.span_d >= settings.min_span_d
            and self.rate * self.span_d / WEEK_D >= settings.min_lost_percent
        )


@dataclass(frozen=True, slots=True)
class Leaks:
    """The hypotheses of one leaking tyre: what it loses beyond the other wheel of its axle."""

    weight: FloatArray
    """(n,) sums to the probability of the leak"""
    rate: FloatArray
    rate_var: FloatArray
    lost: FloatArray
    lost_var: FloatArray
    both_cov: FloatArray
    """Covariance of rate and loss."""
    onset_d: FloatArray
    days: FloatArray

    @classmethod
    def from_hypotheses(cls, every: LeakHypotheses, wheel: int) -> Leaks:
        """Return the hypotheses in which this tyre leaks."""
        chosen = every.take(np.flatnonzero(every.wheel == wheel))
        pair = next(axle for axle in AXLES if wheel in axle)
        other = pair[1 - pair.index(wheel)]
        beyond = np.zeros((2, SIZE))
        for row, part in enumerate((RATE, LOST)):
            beyond[row, part.start + wheel], beyond[row, part.start + other] = 1.0, -1.0
        mean = chosen.mean @ beyond.T
        covariance = beyond @ chosen.covariance @ beyond.T
        return cls(
            np.exp(chosen.log_weight),
            *(mean[:, 0], covariance[:, 0, 0], mean[:, 1], covariance[:, 1, 1], covariance[:, 0, 1]),
            *(chosen.onset_d, chosen.days),
        )


def trend_of(filter_: LeakFilter, settings: TrendSettings = TREND) -> Trend | None:
    """Return the likeliest leak; None before any reading, or if its probability is below one half."""
    if filter_.day is None:
        return None
    leaks = [Leaks.from_hypotheses(filter_.hypotheses, wheel) for wheel in range(4)]
    chances = [_leak_probability(leak, settings) for leak in leaks]
    wheel = int(np.argmax(chances))
    if chances[wheel] < 0.5:
        return None
    leak = leaks[wheel]
    weight = leak.weight / leak.weight.sum()
    rate = float(weight @ leak.rate)
    return Trend(
        probability=chances[wheel],
        wheel=wheel,
        rate=rate,
        rate_std=math.sqrt(float(weight @ (leak.rate_var + (leak.rate - rate) ** 2))),
        lost=float(weight @ leak.lost),
        days=float(weight @ leak.days),
        span_d=float(weight @ (filter_.day - leak.onset_d)),
        low_in_d=_days_until_low(leak, weight, filter_.day, settings),
    )


def has_ended(filter_: LeakFilter, settings: TrendSettings = TREND) -> bool:
    """Return whether the days seen by a filter of one leak (`leak` given) show that it has ended."""
    seen = filter_.hypotheses.days.max() >= settings.min_days
    gone = filter_.probability(NO_WHEEL)
    return bool(seen and gone >= 1.0 / (1.0 + math.exp(-settings.clear_gain)))


def _leak_probability(leak: Leaks, settings: TrendSettings) -> float:
    """Return the probability of this leak at `min_rate` and more."""
    z = (leak.rate - settings.min_rate) / np.sqrt(leak.rate_var)
    return float(leak.weight @ np.array([normal_cdf(float(one)) for one in z]))


def _days_until_low(
    leak: Leaks, weight: FloatArray, day: float, settings: TrendSettings
) -> tuple[float, float, float]:
    """Return the 2.5, 50 and 97.5 % quantiles of the days until 20 % are lost, over hypothesis, rate, loss so
    far and what the difference does not show (stratified normal quantiles of each)."""
    steps = [NORMAL.inv_cdf((k + 0.5) / settings.strata) for k in range(settings.strata)]
    first, second, third, fourth = (axis.ravel() for axis in np.meshgrid(steps, steps, steps, steps))
    std = np.sqrt(leak.rate_var)
    shared = leak.both_cov / std
    rest = np.sqrt(np.maximum(leak.lost_var - shared**2, 0.0))
    # Tyres differ in how much radius a loss of pressure costs.
    scale = np.exp(settings.softness_std * fourth)
    rates = scale * (leak.rate[:, None] + std[:, None] * first)
    lost = scale * (leak.lost[:, None] + shared[:, None] * first + rest[:, None] * second)
    # The other tyre of the axle loses air, too.
    diffused = settings.diffusion[0] + settings.diffusion[1] * third
    lost = lost + diffused * (day - leak.onset_d[:, None]) / WEEK_D
    left = np.maximum(settings.low_percent - lost, 0.0)
    days = WEEK_D * left / np.maximum(rates + diffused, settings.min_rate)
    values, weights = days.ravel(), np.repeat(weight / first.size, first.size)
    order = np.argsort(values)
    indices = np.searchsorted(np.cumsum(weights[order]), (0.025, 0.5, 0.975))
    low, middle, high = values[order[np.minimum(indices, order.size - 1)]]
    return float(low), float(middle), float(high)
