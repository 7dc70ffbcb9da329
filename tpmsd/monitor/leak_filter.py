"""How the left-right difference of an axle moves over weeks: a Gaussian-sum filter over what may happen.

In: one left-right difference per day, in per cent of pressure, with its variance. Out: hypotheses with their
probabilities; each holds a Gaussian of (level, rate, low, drift).

Left and right of an axle have the same temperature, age and (nearly) load, so their difference holds neither
seasons nor the diffusion of all four. In a healthy car it scatters from day to day, drifts for some days,
steps (air is put in; wheels are changed) and has a small rate, since two tyres diffuse and wear unequally. A
leak adds a rate of one sign from some day on. Per day:

    level += rate * days / 7      in per cent of pressure; rate in per cent per week
    low   -= rate * days / 7      by how much the left tyre is lower than the right one by loss and filling

and a refill puts back what is low, to within `refill_std`: level += low + e, low = -e. So refills do not add
up, and a leak comes back with each. A reading shows level + drift. Before each reading every hypothesis
splits: no step, a refill, changed wheels; and those without a leak into onsets of one on either side. How far
readings scatter, what the estimates state is to be believed, and the level drifts is one of a few steps each,
told apart by the readings themselves; an outlier scatters more. The likeliest hypotheses of each side are
kept (Alspach, Sorenson 1972, IEEE Transactions on Automatic Control 17: Gaussian sums).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from tpmsd.monitor.leak_settings import TrendSettings
from tpmsd.monitor.settings import TREND
from tpmsd.wheels import FloatArray

WEEK_D = 7.0
LEVEL, RATE, LOW, DRIFT = range(4)
SEEN = np.array([1.0, 0.0, 0.0, 1.0])
"""What a reading shows of each."""
NONE, LEFT, RIGHT = 0.0, 1.0, -1.0
FILLED = np.outer([1.0, 0.0, -1.0, 0.0], [1.0, 0.0, -1.0, 0.0])
"""(4, 4) what one of the two was filled more is in the level and lacks the other."""
LEAST_CHANCE = 1e-6
"""That nothing has happened, after however long: its logarithm stays finite."""


@dataclass(frozen=True, slots=True)
class Hypotheses:
    """n accounts of the days so far."""

    log_weight: FloatArray
    """(n,)"""
    mean: FloatArray
    """(n, 4) level, low and drift in per cent of pressure, rate in per cent per week"""
    covariance: FloatArray
    """(n, 4, 4)"""
    side: FloatArray
    """(n,) 1 where the left tyre leaks, -1 the right one, 0 none"""
    scatter: FloatArray
    """(n,) standard deviation of a reading beyond what its estimates state, per cent"""
    stated: FloatArray
    """(n,) variance of the estimates relative to the stated one"""
    drift: FloatArray
    """(n,) standard deviation of what comes and goes within days, per cent"""
    changed_d: FloatArray
    """(n,) day by which wheels were last changed without a word; NaN if they never were"""
    onset_d: FloatArray
    """(n,) day on which the leak began; NaN without one"""
    days: FloatArray
    """(n,) readings since then, or of all"""

    def take(self, index: NDArray[np.int64]) -> Hypotheses:
        """Some of them."""
        return Hypotheses(*(getattr(self, field.name)[index] for field in fields(self)))

    def moved(self, transition: FloatArray, log_weight: float | FloatArray) -> Hypotheses:
        """All of them after a linear transition (n, 4, 4), `log_weight` (or (n,)) added to their weights."""
        return Hypotheses(
            self.log_weight + log_weight,
            np.einsum("nij,nj->ni", transition, self.mean),
            transition @ self.covariance @ transition.transpose(0, 2, 1),
            *(self.side, self.scatter, self.stated, self.drift, self.changed_d, self.onset_d, self.days),
        )


def joined(parts: list[Hypotheses]) -> Hypotheses:
    """All of several."""
    return Hypotheses(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Hypotheses)))


class LeakFilter:
    """One axle of one set of tyres."""

    def __init__(
        self, settings: TrendSettings = TREND, leak: tuple[float, float, float] | None = None
    ) -> None:
        """`leak`: (side, rate, its standard deviation): this leak goes on or there is none, one as probable
        as the other, and no other begins. None: there is none yet."""
        self._settings = settings
        self._may_begin = leak is None
        self.day: float | None = None
        sides = [(NONE, 0.0, 0.0)] if leak is None else [(NONE, 0.0, 0.0), leak]
        levels = list(itertools.product(settings.scatters, settings.stated_shares, settings.drift_stds))
        cases = [(*one, *level) for one in sides for level in levels]
        side, rate, std, scatter, stated, drift = np.array(cases).T
        n = len(cases)
        covariance = np.zeros((n, len(SEEN), len(SEEN)))
        covariance[:, LEVEL, LEVEL] = settings.first_level_std**2
        covariance += settings.refill_std**2 * FILLED
        covariance[:, DRIFT, DRIFT] = drift**2
        covariance[:, RATE, RATE] = settings.healthy_rate_std**2 + std**2
        mean = np.zeros((n, len(SEEN)))
        mean[:, RATE] = -side * rate
        onset, never = np.where(side == NONE, math.nan, 0.0), np.full(n, math.nan)
        self.hypotheses = Hypotheses(
            np.full(n, -math.log(n)),
            mean,
            covariance,
            side,
            scatter,
            stated,
            drift,
            never,
            onset,
            np.zeros(n),
        )

    def copy(self) -> LeakFilter:
        """One that goes on apart from this one."""
        out = LeakFilter.__new__(LeakFilter)
        out._settings, out._may_begin = self._settings, self._may_begin
        out.day, out.hypotheses = self.day, self.hypotheses  # never changed in place
        return out

    def probability(self, side: float) -> float:
        """Of a leak on this side."""
        chosen = self.hypotheses.side == side
        return float(np.exp(self.hypotheses.log_weight[chosen]).sum())

    def beside(self, other: LeakFilter) -> LeakFilter:
        """The same with what the other axle says: who changes wheels mostly does so on both.

        The likelihood of the other axle's readings, relative to no change there at all, is the posterior over
        the prior of its own filter. Under a change of this axle the other one was changed within
        `same_change_d` of it with the probability `both_share`, or not; under none it was not, or alone.
        """
        s = self._settings
        mine, others = self.hypotheses, other.hypotheses
        out = self.copy()
        if other.day is None:
            return out
        weight = np.exp(others.log_weight)
        alike = np.abs(mine.changed_d[:, None] - others.changed_d) <= s.same_change_d  # false for NaN
        prior = 1.0 - math.exp(-2.0 * s.same_change_d / s.change_every_d)
        ever = float(weight[np.isfinite(others.changed_d)].sum())
        likelihood = np.where(
            np.isfinite(mine.changed_d),
            s.both_share * (alike @ weight) / prior + (1.0 - s.both_share) * (1.0 - ever),
            1.0 - s.both_share * ever,
        )
        log_weight = mine.log_weight + np.log(np.maximum(likelihood, LEAST_CHANCE))
        out.hypotheses = replace(mine, log_weight=log_weight - np.logaddexp.reduce(log_weight))
        return out

    def add(self, day: float, value: float, variance: float, known_step: bool = False) -> None:
        """Take the reading of a day, not before the last: `value` left minus right, per cent of pressure;
        `variance` of the estimates; `known_step`: the driver asked for a reset before it."""
        every = self.hypotheses
        if self.day is not None:
            every = self._split(self._predicted(every, day - self.day), day, day - self.day, known_step)
        self.day = day
        every = self._updated(every, value, variance)
        best = [
            chosen[np.argsort(-every.log_weight[chosen])[: self._settings.kept]]
            for chosen in (np.flatnonzero(every.side == side) for side in (NONE, LEFT, RIGHT))
        ]
        kept = every.take(np.concatenate(best))
        self.hypotheses = replace(kept, log_weight=kept.log_weight - np.logaddexp.reduce(kept.log_weight))

    def _predicted(self, every: Hypotheses, days: float) -> Hypotheses:
        s = self._settings
        transition = np.tile(np.eye(len(SEEN)), (len(every.side), 1, 1))
        transition[:, LEVEL, RATE] = days / WEEK_D
        transition[:, LOW, RATE] = -days / WEEK_D
        transition[:, DRIFT, DRIFT] = left = math.exp(-days / s.drift_d)
        out = every.moved(transition, 0.0)
        out.covariance[:, LEVEL, LEVEL] += s.level_walk**2 * days
        out.covariance[:, DRIFT, DRIFT] += every.drift**2 * (1.0 - left**2)
        out.covariance[:, RATE, RATE] += s.rate_walk**2 * days
        return out

    def _split(self, every: Hypotheses, day: float, days: float, known_step: bool) -> Hypotheses:
        """No step, a refill, changed wheels, an onset."""
        s = self._settings
        often = 1.0 / s.refill_every_d + 1.0 / s.change_every_d
        stepped = 1.0 - max(math.exp(-days * often), LEAST_CHANCE)
        refilled = stepped / s.refill_every_d / often
        changed = stepped - refilled
        if known_step:
            refilled, changed = s.step_at_reset
        elif days > s.gap_d:
            refilled, changed = max(refilled, s.step_after_gap[0]), max(changed, s.step_after_gap[1])
        still = np.tile(np.eye(len(SEEN)), (len(every.side), 1, 1))
        back = still.copy()
        back[:, LEVEL, LOW], back[:, LOW, LOW] = 1.0, 0.0
        after_refill = every.moved(back, math.log(refilled) if refilled > 0.0 else -math.inf)
        after_refill.covariance[:] += s.refill_std**2 * FILLED
        after_change = every.moved(still, math.log(changed) if changed > 0.0 else -math.inf)
        after_change.covariance[:, LEVEL, LEVEL] += s.change_std**2
        if not known_step:
            after_change = replace(after_change, changed_d=np.full_like(every.side, day))
        same = every.moved(still, math.log(max(1.0 - refilled - changed, LEAST_CHANCE)))
        parts = [same, after_refill, after_change]
        if self._may_begin and days > 0.0:
            parts += self._onsets(same, day, days)
        return joined(parts)

    def _onsets(self, same: Hypotheses, day: float, days: float) -> list[Hypotheses]:
        """A leak has begun since the last reading, in the middle of that time."""
        s = self._settings
        without = np.flatnonzero(same.side == NONE)
        without = without[np.argsort(-same.log_weight[without])[: s.onsets_from]]
        begun = math.log(1.0 - math.exp(-days / s.leak_every_d)) - math.log(2.0)
        out = []
        for side in (LEFT, RIGHT):
            for rate, std, share in s.leak_rates:
                part = same.take(without)
                fallen = rate * days / WEEK_D / 2.0
                part.mean[:, RATE] -= side * rate
                part.mean[:, LEVEL] -= side * fallen
                part.mean[:, LOW] += side * fallen
                part.covariance[:, RATE, RATE] += std**2
                n = len(without)
                weight = part.log_weight + begun + math.log(share)
                onset = np.full(n, day - days / 2.0)
                out.append(
                    Hypotheses(
                        *(weight, part.mean, part.covariance),
                        *(
                            np.full(n, side),
                            part.scatter,
                            part.stated,
                            part.drift,
                            part.changed_d,
                            onset,
                            np.zeros(n),
                        ),
                    )
                )
        return out

    def _updated(self, every: Hypotheses, value: float, variance: float) -> Hypotheses:
        """After the reading, which may be an outlier: two Gaussians, joined again by their moments."""
        s = self._settings
        noise = every.stated * variance + every.scatter**2
        off = value - every.mean @ SEEN
        column = every.covariance @ SEEN
        own = column @ SEEN
        logs, means, covariances = [], [], []
        for factor, share in ((1.0, 1.0 - s.outlier_share), (s.outlier_variance, s.outlier_share)):
            spread = own + factor * noise
            gain = column / spread[:, None]
            logs.append(math.log(share) - 0.5 * (np.log(spread) + off**2 / spread))
            means.append(every.mean + gain * off[:, None])
            covariances.append(every.covariance - gain[:, :, None] * column[:, None, :])
        log = np.logaddexp(*logs)
        a = np.exp(logs[0] - log)[:, None]
        apart = means[0] - means[1]
        between = (a * (1.0 - a))[:, :, None] * apart[:, :, None] * apart[:, None, :]
        return Hypotheses(
            every.log_weight + log,
            a * means[0] + (1.0 - a) * means[1],
            a[:, :, None] * covariances[0] + (1.0 - a)[:, :, None] * covariances[1] + between,
            *(
                every.side,
                every.scatter,
                every.stated,
                every.drift,
                every.changed_d,
                every.onset_d,
                every.days + 1.0,
            ),
        )
