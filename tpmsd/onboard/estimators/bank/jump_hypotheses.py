"""The hypothesis bank: one Kalman filter per jump hypothesis, and how hypotheses branch and are pruned.

In: log-likelihoods of measurements. Out: weights. *Whether and when a wheel's radius changed at once*, and
how fast the radii drift of themselves, is what is not linear; a hypothesis is one answer, its weight the
probability. Hypotheses are enumerated rather than drawn, and the least probable dropped: the Gaussian sum of
Alspach and Sorenson (1972, IEEE Trans. Automatic Control 17(4), 439-448), pruned as particle filters with
discrete states are by Fearnhead and Clifford (2003, J. R. Statist. Soc. B 65(4), 887-899).
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.bank.error_state import MU, PSI, initial_state
from tpmsd.onboard.estimators.base import RadiusStatement
from tpmsd.onboard.estimators.settings import SETTINGS

if TYPE_CHECKING:
    from tpmsd.onboard.estimators.bank.kernel import BankKernel

UNUSED = -1e9
"""Log-weight of a place in the bank that holds no hypothesis yet."""
SAME_LOG_WEIGHT_NATS = 1e-6
"""Log-weights closer than this are alike: which hypothesis is dropped must not hang on rounding."""


@dataclass(slots=True)
class Bank:
    """All that changes in a mixture belief; N hypotheses of n states."""

    mean: FloatArray
    """(N, n)"""
    covariance: FloatArray
    """(N, n, n)"""
    log_weights: FloatArray
    """(N,)"""
    level: FloatArray
    """(N, d) process-noise level of each wheel's radius that a hypothesis assumes."""
    kind: NDArray[np.intp]
    """(N,) which of the kinds of hypothesis that is (`JumpHypotheses.kinds`)."""
    since_s: FloatArray = field(init=False)
    """(N,) informative driving since a hypothesis last assumed a change; infinite: never."""
    raised: FloatArray = field(init=False)
    """(N,) by how much a log-weight is above what prior and evidence give (`JumpHypotheses.keep_levels`)."""
    noise_factor: FloatArray = field(init=False)
    """(N,) on the variances of way and heading that grow with the way."""
    state: FloatArray = field(init=False)
    """(n, N) the means as they lie in memory: all arrays are changed in place."""
    spread: FloatArray = field(init=False)
    """(n, n, N) the covariances in the same way."""

    def __post_init__(self) -> None:
        self.noise_factor = np.ones(self.log_weights.size)
        self.since_s = np.full(self.log_weights.size, np.inf)
        self.raised = np.zeros(self.log_weights.size)
        self.state, self.spread = self.mean.T, self.covariance.transpose(1, 2, 0)

    def copy(self, child: int, parent: int) -> None:
        """Overwrite hypothesis `child` by a copy of `parent`, except its weight, which the caller sets."""
        self.mean[child] = self.mean[parent]
        self.covariance[child] = self.covariance[parent]
        self.level[child] = self.level[parent]
        self.kind[child] = self.kind[parent]
        self.since_s[child], self.raised[child] = self.since_s[parent], self.raised[parent]

    def weights(self) -> FloatArray:
        """Return the (N,) normalised weights."""
        return normalised(self.log_weights)

    def ascending(self) -> NDArray[np.intp]:
        """Return the (N,) indices of the hypotheses by ascending weight; those of equal weight in their order
        in the bank."""
        return self._rounded_log_weights().argsort(kind="stable")

    def least_probable(self) -> int:
        """Return the index of the hypothesis with the least weight: the first of `ascending`."""
        return int(self._rounded_log_weights().argmin())

    def most_probable(self) -> int:
        """Return the index of the hypothesis with the greatest weight: the last of `ascending`."""
        return self.log_weights.size - 1 - int(self._rounded_log_weights()[::-1].argmax())

    def _rounded_log_weights(self) -> FloatArray:
        """Return the (N,) log-weights in whole steps of `SAME_LOG_WEIGHT_NATS`, so that rounding errors do
        not order equal ones."""
        return np.rint(self.log_weights / SAME_LOG_WEIGHT_NATS)

    def rescale(self) -> None:
        """Shift the log-weights so that the greatest is 0 and none overflows."""
        self.log_weights -= self.log_weights.max()
        np.maximum(self.log_weights, UNUSED, out=self.log_weights)


@dataclass(frozen=True, slots=True)
class JumpHypotheses:
    """The change model of the bank: enumerate and prune."""

    rate_per_s: float = SETTINGS.jump_rate_per_s
    std: float = SETTINGS.jump_std
    heading_std_rad: float = SETTINGS.jump_heading_rad
    levels: tuple[tuple[float, float], ...] = SETTINGS.drift_levels
    """Process-noise levels of all wheels alike and their prior probabilities."""
    alone: tuple[float, float, float] | None = SETTINGS.drift_alone
    """Level of one wheel of four whose radius drifts alone, that of the others, and the prior probability of
    each such kind; None: there are none."""
    level_floor: float = SETTINGS.level_floor

    def kinds(self, wheels: int) -> list[tuple[FloatArray, float]]:
        """Return per kind of hypothesis the process-noise level (d,) of each wheel, and its prior
        probability."""
        out = [(np.full(wheels, level), probability) for level, probability in self.levels]
        if self.alone is not None and wheels == 4:
            own, rest, probability = self.alone
            out += [(np.where(np.arange(wheels) == wheel, own, rest), probability) for wheel in range(wheels)]
        return out

    def begin(self, count: int, nominal_m: FloatArray) -> Bank:
        """Return the bank before the first tick: one hypothesis per kind, and the other places unused."""
        mean, covariance = initial_state(count, nominal_m)
        level, kind = np.ones((count, nominal_m.size)), np.zeros(count, dtype=np.intp)
        bank = Bank(mean, covariance, np.full(count, UNUSED), level, kind)
        kinds = self.kinds(nominal_m.size)
        for index in range(min(len(kinds), max(count // 4, 1)) if count >= 8 else 1):
            bank.kind[index], (bank.level[index], probability) = index, kinds[index]
            bank.log_weights[index] = math.log(probability)
        return bank

    def keep_levels(self, bank: Bank, duration_s: float) -> None:
        """Keep at least one hypothesis of each kind in the bank, with no less than a share of the best one's
        weight.

        What a kind has lost beyond that it has lost with radii of its own; it begins again at the best ones.
        The share makes the bank quick; what is stated takes of a kind what the evidence has left of it, or
        the probability that the level has changed to it within `duration_s`: `raised` is the difference.
        """
        kinds = _cached_kinds(self, bank.level.shape[1])
        if bank.log_weights.size < 4 * len(kinds):
            return
        least = float(np.maximum.reduce(bank.log_weights)) + math.log(self.level_floor)
        in_play = set(bank.kind[bank.log_weights >= least - SAME_LOG_WEIGHT_NATS].tolist())
        if len(in_play) == len(kinds):
            return
        best = bank.most_probable()
        best_log = float(bank.log_weights[best] - bank.raised[best])
        for kind, (level, probability) in enumerate(kinds):
            if kind in in_play:
                continue
            evidence = (bank.log_weights - bank.raised)[bank.kind == kind].tolist()
            log_weight = max(
                *evidence, best_log + math.log(probability * duration_s / SETTINGS.level_tau_s), -math.inf
            )
            child = bank.least_probable()
            bank.copy(child, best)
            bank.kind[child], bank.level[child], bank.log_weights[child] = kind, level, least
            bank.raised[child] = least - log_weight

    def branch(self, bank: Bank, duration_s: float, nominal_m: FloatArray, next_wheel: int) -> int:
        """Replace improbable hypotheses by branches of the best one, each of which assumes that one wheel has
        just changed; return the wheel whose turn is next.

        The branches take the places of the least probable hypotheses, with the prior probability of a change
        within `duration_s` as their weight; how much has changed is left to the Kalman filter. A branch
        allows for some heading error too, for a rear wheel that changed has turned the heading before anyone
        assumed it. The wheels take turns when places are few: the wheel that is next after `next_wheel`.
        """
        order = bank.ascending()
        best = int(order[-1])
        log_probability = math.log(self.rate_per_s * duration_s)
        wheels = nominal_m.size
        for child in order[: min(wheels, order.size // 4)].tolist():
            bank.copy(child, best)
            index = MU + next_wheel
            bank.covariance[child, index, index] += (self.std * nominal_m[next_wheel]) ** 2
            bank.covariance[child, PSI, PSI] += self.heading_std_rad**2
            bank.since_s[child] = 0.0
            bank.log_weights[child] = bank.log_weights[best] + log_probability
            next_wheel = (next_wheel + 1) % wheels
        return next_wheel


def normalised(log_weights: FloatArray) -> FloatArray:
    """Return the (N,) weights that add up to 1, from their logarithms."""
    weights = np.exp(log_weights - np.maximum.reduce(log_weights))
    return np.asarray(weights / np.add.reduce(weights))


def radius_statement(bank: Bank, kernel: BankKernel) -> RadiusStatement:
    """Return the statement of the radii: moments of the hypotheses that assume no change within
    `recent_change_s`, or of the others where these are more probable, by weights of prior and evidence
    (`Bank.raised`).
    """
    log_weights = bank.log_weights - bank.raised
    recent = bank.since_s <= SETTINGS.recent_change_s
    probability = float(normalised(log_weights) @ recent)
    counted = recent if probability > 0.5 else ~recent
    said = kernel.summary(bank, np.where(counted, log_weights, -np.inf))
    return RadiusStatement(said.mean[MU:], said.radii_m2, probability)


@functools.cache
def _cached_kinds(changes: JumpHypotheses, wheels: int) -> list[tuple[FloatArray, float]]:
    """Return `JumpHypotheses.kinds`, computed once per number of wheels."""
    return changes.kinds(wheels)


JUMPS = JumpHypotheses()
