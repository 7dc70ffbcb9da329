"""Gaussian-sum filter of the differences of four tyres over weeks, one Kalman filter per hypothesis.

In: three contrasts per drive (left minus right of each axle, front minus rear), in per cent of pressure, with
their variances. Out: hypotheses with their probabilities; each holds a Gaussian of what `state` names.

Contrasts hold neither seasons nor the diffusion of all four, and no error that is common to the wheels. In a
healthy car they scatter from day to day, drift for some days, and step: air is put in, wheels are changed.
One visit to the pump is mostly of all tyres, so that it shows in all three contrasts at once, as a leak shows
in two. Before the first reading of a day every hypothesis splits: no step; a refill of all, an axle or one
tyre; such changes of wheels; and those without a leak into onsets of one in each tyre. How far readings
scatter is learned by each hypothesis (`slow_leaks.noise`). The likeliest hypotheses of each tyre are kept
(Alspach, Sorenson 1972, IEEE Transactions on Automatic Control 17: Gaussian sums).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.settings import TREND
from tpmsd.onboard.monitor.slow_leaks.noise import FilterMoments, NoiseLevels, update_by_reading
from tpmsd.onboard.monitor.slow_leaks.settings import TrendSettings
from tpmsd.onboard.monitor.slow_leaks.state import (
    BASE,
    CONTRASTS,
    LOST,
    RATE,
    SEEN,
    SIZE,
    WEEK_D,
    WHEEL_SETS,
    initial_gaussian,
    predict,
    refill_covariance,
)

IntArray = NDArray[np.int64]
NO_WHEEL = -1
"""No tyre leaks."""
NO_EVENT = -1
MIN_PROBABILITY = 1e-6
"""That nothing has happened, after however long: its logarithm stays finite."""


@dataclass(frozen=True, slots=True)
class LeakHypotheses:
    """n change hypotheses of the days so far."""

    log_weight: FloatArray
    """(n,)"""
    mean: FloatArray
    """(n, SIZE)"""
    covariance: FloatArray
    """(n, SIZE, SIZE)"""
    wheel: IntArray
    """(n,) the tyre that leaks, or `NO_WHEEL`"""
    drift: FloatArray
    """(n, 3) standard deviation of fluctuations of each contrast over days, per cent"""
    noise: FloatArray
    """(n, 2) learned sums of squares (`slow_leaks.noise`)"""
    onset_d: FloatArray
    """(n,) day on which the leak began; NaN without one"""
    days: FloatArray
    """(n,) with readings since then, or all"""

    def take(self, index: IntArray) -> LeakHypotheses:
        """Return the hypotheses of these indices."""
        return LeakHypotheses(*(getattr(self, field.name)[index] for field in fields(self)))


@dataclass(frozen=True, slots=True)
class HypothesisBranches:
    """m ways in which hypotheses may go on, before the reading."""

    parent: IntArray
    """(m,) which hypothesis"""
    event: IntArray
    """(m,) `NO_EVENT`, a refill of `WHEEL_SETS[event]`, or a change of those after them"""
    begins: IntArray
    """(m,) the tyre in which a leak begins, or `NO_WHEEL`"""
    rate: IntArray
    """(m,) which of `leak_rates`"""
    log_weight: FloatArray
    """(m,)"""
    mean: FloatArray
    """(m, 3) contrasts to expect"""
    covariance: FloatArray
    """(m, 3, 3)"""


class LeakFilter:
    """Gaussian-sum filter of one set of tyres."""

    def __init__(self, settings: TrendSettings = TREND, leak: tuple[int, float, float] | None = None) -> None:
        """`leak`: (wheel, rate, its standard deviation): this leak goes on or there is none, one as probable
        as the other, and no other begins. None: there is none yet."""
        self._settings = settings
        self._may_begin = leak is None
        self.day: float | None = None
        self._levels = NoiseLevels.initial(settings)
        cases = [(NO_WHEEL, 0.0, 0.0)] if leak is None else [(NO_WHEEL, 0.0, 0.0), leak]
        drift = np.array([one for one in settings.drift_stds for _ in cases])
        wheel = np.array([case[0] for _ in settings.drift_stds for case in cases], dtype=np.int64)
        mean, covariance = initial_gaussian(settings, drift)
        for k, (one, rate, std) in enumerate(cases * len(settings.drift_stds)):
            if one != NO_WHEEL:
                mean[k, RATE.start + one] += rate
                covariance[k, RATE.start + one, RATE.start + one] += std**2
        n = len(wheel)
        self.hypotheses = LeakHypotheses(
            np.full(n, -math.log(n)),
            mean,
            covariance,
            wheel,
            drift,
            self._levels.initial_sums(n),
            np.where(wheel == NO_WHEEL, math.nan, 0.0),
            np.zeros(n),
        )

    def probability(self, wheel: int) -> float:
        """Return the probability of a leak of this tyre; of none with `NO_WHEEL`."""
        chosen = self.hypotheses.wheel == wheel
        return float(np.exp(self.hypotheses.log_weight[chosen]).sum())

    def add(self, day: float, value: FloatArray, variance: FloatArray, known_step: bool = False) -> None:
        """Update by the reading of a drive, not before the last: (3,) contrasts in per cent of pressure, NaN
        where one is not known; `variance` of the estimates; `known_step`: the driver asked for a reset
        before. Nothing happens between the drives of a day: a second one updates the same hypotheses."""
        if self.day is not None and math.floor(self.day) == math.floor(day) and not known_step:
            self._update_hypotheses(self.hypotheses, value, variance)
            return
        every = self.hypotheses
        days = 0.0 if self.day is None else day - self.day
        if self.day is not None:
            mean, covariance = predict(self._settings, every.mean, every.covariance, every.drift, days)
            every = replace(every, mean=mean, covariance=covariance)
        splits = self._split(every, days, known_step)
        # What a reading says of a split needs the contrasts alone: states are made for those that are kept.
        seen = FilterMoments(splits.mean, splits.covariance, every.noise[splits.parent])
        log_weight = (
            splits.log_weight
            + update_by_reading(seen, np.eye(len(CONTRASTS)), value, variance, self._levels)[1]
        )
        wheel = np.where(splits.begins == NO_WHEEL, every.wheel[splits.parent], splits.begins)
        best = [
            chosen[np.argsort(-log_weight[chosen], kind="stable")[: self._settings.kept]]
            for chosen in (np.flatnonzero(wheel == one) for one in range(NO_WHEEL, 4))
        ]
        index = np.concatenate(best)
        kept = self._make_hypotheses(every, splits, index, day, days)
        self._update_hypotheses(replace(kept, days=kept.days + 1.0), value, variance)
        self.day = day

    def _update_hypotheses(self, every: LeakHypotheses, value: FloatArray, variance: FloatArray) -> None:
        """Update these hypotheses, weights included, by the reading, and keep them."""
        before = FilterMoments(every.mean, every.covariance, every.noise)
        after, likelihood = update_by_reading(before, SEEN, value, variance, self._levels)
        self._levels, noise = self._levels.after_reading(value, after.noise)
        log_weight = every.log_weight + likelihood
        self.hypotheses = replace(
            every,
            log_weight=log_weight - np.logaddexp.reduce(log_weight),
            mean=after.mean,
            covariance=after.covariance,
            noise=noise,
        )

    def _split(self, every: LeakHypotheses, days: float, known_step: bool) -> HypothesisBranches:
        """Return the branches of each hypothesis: no step, a refill, changed wheels, the onset of a leak."""
        s = self._settings
        n = len(every.wheel)
        both = np.concatenate([SEEN, np.eye(SIZE)[LOST]])
        mean = every.mean @ both.T
        covariance = both @ every.covariance @ both.T
        refilled, changed = self._event_probabilities(days, known_step)
        same = math.log(max(1.0 - refilled - changed, MIN_PROBABILITY))
        three = slice(0, len(CONTRASTS))
        means, covariances = [mean[:, three]], [covariance[:, three, three]]
        logs, events = [every.log_weight + same], [NO_EVENT]
        if self.day is not None:
            for k, wheels in enumerate(WHEEL_SETS):
                # Without what these had lost, and with what the pump leaves.
                back = np.eye(len(CONTRASTS), len(both))
                for wheel in wheels:
                    back[:, len(CONTRASTS) + wheel] = CONTRASTS[:, wheel]
                means.append(mean @ back.T)
                covariances.append(
                    back @ covariance @ back.T + CONTRASTS @ refill_covariance(s, wheels) @ CONTRASTS.T
                )
                logs.append(every.log_weight + math.log(refilled * s.refill_shares[k]))
                events.append(k)
            for k, wheels in enumerate(WHEEL_SETS):
                acts = CONTRASTS[:, wheels]
                means.append(mean[:, three])
                covariances.append(covariance[:, three, three] + s.change_std**2 * acts @ acts.T)
                logs.append(every.log_weight + math.log(changed * s.change_shares[k]))
                events.append(len(WHEEL_SETS) + k)
        parents, begins = [np.tile(np.arange(n), len(events))], [np.full(n * len(events), NO_WHEEL)]
        rates, kinds = [np.zeros(n * len(events), dtype=np.int64)], [np.repeat(events, n)]
        if self._may_begin and days > 0.0:
            without = np.flatnonzero(every.wheel == NO_WHEEL)
            without = without[np.argsort(-every.log_weight[without], kind="stable")[: s.onsets_from]]
            begun = same + math.log(-math.expm1(-days / s.leak_every_d))
            for wheel in range(4):
                for k, (rate, _, share) in enumerate(s.leak_rates):
                    parents.append(without)
                    begins.append(np.full(len(without), wheel))
                    rates.append(np.full(len(without), k))
                    kinds.append(np.full(len(without), NO_EVENT))
                    # It has begun since the last reading, in the middle of that time.
                    means.append(mean[without, three] - CONTRASTS[:, wheel] * rate * days / WEEK_D / 2.0)
                    covariances.append(covariance[without, three, three])
                    logs.append(every.log_weight[without] + begun + math.log(share))
        return HypothesisBranches(
            *map(np.concatenate, (parents, kinds, begins, rates, logs, means, covariances))
        )

    def _event_probabilities(self, days: float, known_step: bool) -> tuple[float, float]:
        """Return the probabilities of a refill and of changed wheels since the last reading."""
        s = self._settings
        if self.day is None:
            return 0.0, 0.0
        if known_step:
            return s.step_at_reset
        often = 1.0 / s.refill_every_d + 1.0 / s.change_every_d
        stepped = 1.0 - max(math.exp(-days * often), MIN_PROBABILITY)
        refilled = max(stepped / s.refill_every_d / often, MIN_PROBABILITY)
        changed = max(stepped - refilled, MIN_PROBABILITY)
        if days > s.gap_d:
            return max(refilled, s.step_after_gap[0]), max(changed, s.step_after_gap[1])
        return refilled, changed

    def _make_hypotheses(
        self, every: LeakHypotheses, splits: HypothesisBranches, index: IntArray, day: float, days: float
    ) -> LeakHypotheses:
        """Return the hypotheses of the splits of these indices, before the reading."""
        s = self._settings
        out = every.take(splits.parent[index])  # a copy
        event, begins = splits.event[index], splits.begins[index]
        for k, wheels in enumerate(WHEEL_SETS):
            chosen = np.flatnonzero(event == k)
            indices = [LOST.start + wheel for wheel in wheels]
            out.mean[chosen[:, None], indices] = 0.0
            part = out.covariance[chosen]
            part[:, indices, :] = 0.0
            part[:, :, indices] = 0.0
            part[:, LOST, LOST] += refill_covariance(s, wheels)
            out.covariance[chosen] = part
            chosen = np.flatnonzero(event == len(WHEEL_SETS) + k)
            for base in (BASE.start + wheel for wheel in wheels):
                out.covariance[chosen, base, base] += s.change_std**2
        out.log_weight[:] = splits.log_weight[index]
        new = np.flatnonzero(begins != NO_WHEEL)
        rate, std, _ = np.array(s.leak_rates)[splits.rate[index[new]]].T
        out.mean[new, RATE.start + begins[new]] += rate
        out.mean[new, LOST.start + begins[new]] += rate * days / WEEK_D / 2.0
        out.covariance[new, RATE.start + begins[new], RATE.start + begins[new]] += std**2
        out.wheel[new] = begins[new]
        out.onset_d[new] = day - days / 2.0
        out.days[new] = 0.0
        return out
