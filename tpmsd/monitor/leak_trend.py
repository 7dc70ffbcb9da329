"""Whether one tyre of an axle loses air over weeks: what the hypotheses of `leak_filter` say together.

In: a `LeakFilter`. Out: a `Trend`: the probability of a leak, its side and rate, and when the tyre will be
20 % low.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from tpmsd.monitor.leak_filter import LEFT, LOW, NONE, RATE, RIGHT, WEEK_D, Hypotheses, LeakFilter
from tpmsd.monitor.leak_settings import TrendSettings
from tpmsd.monitor.probability import normal_cdf
from tpmsd.monitor.settings import TREND
from tpmsd.wheels import FloatArray

NORMAL = NormalDist()
"""The standard normal distribution."""


@dataclass(frozen=True, slots=True)
class Trend:
    """What the days of one axle say of the likelier side."""

    probability: float
    """Of a leak of `least_rate` and more on that side."""
    left: bool
    """Whether the left tyre leaks."""
    rate: float
    """Per cent of pressure per week, and its standard deviation."""
    rate_std: float
    lost: float
    """Per cent of pressure that the tyre lacks of its fellow's, by loss and filling."""
    days: float
    span_d: float
    """Days with readings since the leak began, and the time since; expected values."""
    low_in_d: tuple[float, float, float]
    """Days from the last reading until 20 % are lost: 2.5 %, 50 % and 97.5 % quantile; not below zero."""

    def noticeable(self, settings: TrendSettings = TREND) -> bool:
        """Whether it is a leak."""
        return (
            self.probability >= settings.raise_probability
            and self.days >= settings.least_days
            and self.span_d >= settings.least_span_d
        )


def trend_of(filter_: LeakFilter, settings: TrendSettings = TREND) -> Trend | None:
    """The likelier leak of either side; None where there being none is likelier."""
    every = filter_.hypotheses
    left, right = (every.take(np.flatnonzero(every.side == side)) for side in (LEFT, RIGHT))
    if filter_.day is None or not left.side.size or not right.side.size:
        return None
    chances = [_beyond(side, settings) for side in (left, right)]
    likelier = int(chances[1] > chances[0])
    if chances[likelier] < 0.5:
        return None
    leak = (left, right)[likelier]
    weight = np.exp(leak.log_weight - np.logaddexp.reduce(leak.log_weight))
    rates = -leak.side * leak.mean[:, RATE]
    rate = float(weight @ rates)
    return Trend(
        probability=chances[likelier],
        left=likelier == 0,
        rate=rate,
        rate_std=math.sqrt(float(weight @ (leak.covariance[:, RATE, RATE] + (rates - rate) ** 2))),
        lost=float(weight @ (leak.side * leak.mean[:, LOW])),
        days=float(weight @ leak.days),
        span_d=float(weight @ (filter_.day - leak.onset_d)),
        low_in_d=_low_in_d(leak, weight, filter_.day, settings),
    )


def has_ended(filter_: LeakFilter, settings: TrendSettings = TREND) -> bool:
    """Whether the days that a filter of one leak (`leak` given) has seen speak against its going on."""
    seen = filter_.hypotheses.days.max() >= settings.least_days
    gone = filter_.probability(NONE)
    return bool(seen and gone >= 1.0 / (1.0 + math.exp(-settings.clear_gain)))


def _beyond(leak: Hypotheses, settings: TrendSettings) -> float:
    """Probability of a leak on this side at `least_rate` and more."""
    rates = -leak.side * leak.mean[:, RATE]
    z = (rates - settings.least_rate) / np.sqrt(leak.covariance[:, RATE, RATE])
    return float(np.exp(leak.log_weight) @ [normal_cdf(float(one)) for one in z])


def _low_in_d(
    leak: Hypotheses, weight: FloatArray, day: float, settings: TrendSettings
) -> tuple[float, float, float]:
    """Quantiles over what is not known: hypothesis, rate and loss so far, what the difference does not show
    (stratified normal quantiles of each)."""
    steps = [NORMAL.inv_cdf((k + 0.5) / settings.strata) for k in range(settings.strata)]
    first, second, third, fourth = (axis.ravel() for axis in np.meshgrid(steps, steps, steps, steps))
    std = np.sqrt(leak.covariance[:, RATE, RATE])
    shared = -leak.covariance[:, RATE, LOW] / std
    rest = np.sqrt(np.maximum(leak.covariance[:, LOW, LOW] - shared**2, 0.0))
    # Tyres differ in how much radius a loss of pressure costs.
    scale = np.exp(settings.softness_std * fourth)
    rates = scale * (-leak.side[:, None] * leak.mean[:, RATE, None] + std[:, None] * first)
    lost = scale * (
        leak.side[:, None] * leak.mean[:, LOW, None] + shared[:, None] * first + rest[:, None] * second
    )
    # The fellow loses air, too, and unequal wear passes for pressure.
    beside = settings.diffusion[0] + math.hypot(settings.diffusion[1], settings.healthy_rate_std) * third
    lost = lost + beside * (day - leak.onset_d[:, None]) / WEEK_D
    left = np.maximum(settings.low_percent - lost, 0.0)
    days = WEEK_D * left / np.maximum(rates + beside, settings.least_rate)
    values, weights = days.ravel(), np.repeat(weight / first.size, first.size)
    order = np.argsort(values)
    places = np.searchsorted(np.cumsum(weights[order]), (0.025, 0.5, 0.975))
    low, middle, high = values[order[np.minimum(places, order.size - 1)]]
    return float(low), float(middle), float(high)
