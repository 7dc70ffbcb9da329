"""Statistics about a model of a drive: its terms, their removal, competing terms, and terms that may be
added.

In: sufficient statistics of columns. Out: `ModelStatistics`, evidence of every alternative; `Slot`, all of
one term.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtrc

from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.arrays import IntArray
from tpmsd.offline.dynamics.columns import BlockGram
from tpmsd.offline.dynamics.evidence import Addition, PriorColumns, Statistics, join_columns
from tpmsd.offline.dynamics.settings import SETTINGS
from tpmsd.offline.dynamics.terms import CandidateTerm


@dataclass(frozen=True)
class Slot:
    """A term of the model against its absence and against the terms that could replace it."""

    term: CandidateTerm
    evidence: float
    """Log Bayes factor against its absence."""
    distance: float
    """Squared distance, in standard deviations, from the values that do nothing."""
    overdispersion: float
    std: FloatArray
    """(a,) standard deviations, overdispersion included."""
    p_value: float
    competitors: tuple[tuple[CandidateTerm, float], ...]
    """Terms in its place with their log Bayes factors against its absence, best first."""
    heldout_gain: float
    """Nats on held-out blocks against the model without it."""


def fold_blocks(blocks: int) -> list[IntArray]:
    """Return the block indices of each fold; neighbouring blocks share a fold."""
    return [part for part in np.array_split(np.arange(blocks), SETTINGS.folds) if len(part)]


@dataclass(frozen=True)
class ModelStatistics:
    """Statistics about a model: its terms, their removal, and terms that may be added."""

    statistics: Statistics
    terms: Sequence[CandidateTerm]
    columns: list[PriorColumns]
    removal: list[tuple[tuple[int, ...], tuple[float, ...]]]
    offered: list[CandidateTerm]
    added: list[PriorColumns]

    def restricted_to_offers(self, offered: Sequence[CandidateTerm]) -> ModelStatistics | None:
        """Return the statistics with some of the offered terms; None where one of them was not offered."""
        indices = {column_identity(term): k for k, term in enumerate(self.offered)}
        rows = [indices.get(column_identity(term)) for term in offered]
        known = [k for k in rows if k is not None]
        if len(known) < len(rows):
            return None
        return replace(self, offered=list(offered), added=[self.added[k] for k in known])

    def restricted_to_blocks(self, blocks: slice) -> ModelStatistics:
        """Return the same statistics from some of the blocks."""
        gram = self.statistics.blocks
        return replace(
            self, statistics=Statistics(BlockGram(gram.information[blocks], gram.gradient[blocks]))
        )

    def addition(self, k: int) -> Addition:
        """Return the gain statistics of an offered term."""
        return self.statistics.addition(join_columns(self.columns), self.added[k])

    def score(self, k: int) -> float:
        """Return the log evidence of an offered term, less the choice among its alternatives."""
        addition = self.addition(k)
        if not addition.visible or not is_admissible(self.offered[k], addition.estimate):
            return -math.inf
        return self._offered_evidence(k, addition, join_columns(self.columns))

    def _offered_evidence(
        self,
        k: int,
        addition: Addition,
        given: PriorColumns,
        removal: tuple[tuple[int, ...], tuple[float, ...]] = ((), ()),
        ratio: float | None = None,
    ) -> float:
        """Return the log evidence of an offered term beside others, that of its likeliest part if it has
        any, less the choice among its alternatives and parts."""
        term, columns = self.offered[k], self.added[k]
        values = [addition.log_evidence(ratio)]
        for j in range(len(columns.index) if term.separable else 0):
            one = PriorColumns((columns.index[j],), columns.offset[[j]], columns.precision[[j]])
            values.append(self.statistics.addition(given, one, *removal).log_evidence(ratio))
        return max(values) - math.log(term.alternatives * len(values))

    def loss(self, k: int) -> tuple[float, Addition]:
        """Return the log-likelihood lost without a term, over its overdispersion, and its gain statistics."""
        rest = [columns for j, columns in enumerate(self.columns) if j != k]
        own = self.statistics.addition(join_columns(rest), self.columns[k])
        full = self._penalised(join_columns(self.columns), (), ())
        less = self._penalised(join_columns(rest), *self.removal[k])
        return (full - less) / own.overdispersion, own

    def evidence(self, k: int) -> float:
        """Return the log Bayes factor of a term of the model, or of its likeliest part, against its
        absence."""
        values = self._evidences(k)
        return float(max(values) - math.log(self.terms[k].alternatives * len(values)))

    def best_part_nats(self, k: int) -> float:
        """Return the nats that the choice of the likeliest part adds to the log evidence of a term."""
        values = self._evidences(k)
        return float(max(values) - values[0] - math.log(len(values)))

    def _evidences(self, k: int) -> list[float]:
        """Return the log Bayes factors of a term of the model and of each of its parts."""
        loss, own = self.loss(k)
        ratio = own.overdispersion
        prior = self.columns[k].precision
        matrix = own.information / ratio + np.diag(prior)
        occam = 0.5 * (np.linalg.slogdet(matrix)[1] - float(np.sum(np.log(prior))))
        values = [float(loss - occam)]
        if self.terms[k].separable:
            less = loss - self._penalised(join_columns(self.columns), (), ()) / ratio
            for j in range(len(prior)):
                occam = 0.5 * math.log(1.0 + own.information[j, j] / ratio / prior[j])
                values.append(float(less + self._penalised_with_one_value(k, j) / ratio - occam))
        return values

    def _penalised_with_one_value(self, k: int, j: int) -> float:
        """Return the penalised log-likelihood with only value j of term k free, its others neutral."""
        term, own = self.terms[k], self.columns[k]
        one = PriorColumns((own.index[j],), own.offset[[j]], own.precision[[j]])
        others = [i for i in range(len(own.index)) if i != j]
        held = [term.neutral.get(term.free[i], 0.0) - term.value(term.free[i]) for i in others]
        rest = [columns for i, columns in enumerate(self.columns) if i != k]
        return self._penalised(join_columns([*rest, one]), [own.index[i] for i in others], held)

    def _penalised(self, free: PriorColumns, held: Sequence[int], values: Sequence[float]) -> float:
        """Return the maximum of log-likelihood plus log prior over the free columns."""
        held_values = np.array(values, dtype=float)
        if not free.index:
            return self.statistics.log_likelihood(held, held_values)
        estimate, _ = self.statistics.fit(free, held, values)
        total = self.statistics.log_likelihood((*free.index, *held), np.concatenate([estimate, held_values]))
        return float(total - 0.5 * np.sum(free.precision * (estimate - free.offset) ** 2))

    def competitors(self, k: int) -> list[tuple[CandidateTerm, float]]:
        """Return the offered terms in the place of one of the model's, with their evidence, best first."""
        rest = join_columns([columns for j, columns in enumerate(self.columns) if j != k])
        ratio = self.statistics.addition(rest, self.columns[k]).overdispersion
        best: dict[str, tuple[CandidateTerm, float]] = {}
        for i, (term, columns) in enumerate(zip(self.offered, self.added, strict=True)):
            if set(columns.index) & set(self.removal[k][0]):
                continue
            addition = self.statistics.addition(rest, columns, *self.removal[k])
            if not addition.visible or not is_admissible(term, addition.estimate):
                continue
            value = self._offered_evidence(i, addition, rest, self.removal[k], max(ratio, 1.0))
            if term.key not in best or value > best[term.key][1]:
                best[term.key] = (term, value)
        return sorted(best.values(), key=lambda pair: -pair[1])

    def refitted_others(self, k: int) -> list[CandidateTerm]:
        """Return the other terms of the model, refitted without term k."""
        others = [j for j in range(len(self.terms)) if j != k]
        rest = join_columns([self.columns[j] for j in others])
        step = self.statistics.fit(rest, *self.removal[k])[0] if others else np.zeros(0)
        out = []
        for j in others:
            count = len(self.columns[j].index)
            out.append(self.terms[j].moved(step[:count]))
            step = step[count:]
        return out

    def heldout(self, k: int) -> float:
        """Return the nats that a term of the model gains on held-out blocks."""
        rest = join_columns([columns for j, columns in enumerate(self.columns) if j != k])
        held, values = self.removal[k]
        everything = join_columns(self.columns)
        gain = 0.0
        for blocks in fold_blocks(len(self.statistics.blocks.gradient)):
            estimate, _ = self.statistics.fit(everything, left_out=blocks)
            gain += self.statistics.log_likelihood(everything.index, estimate, blocks)
            less = np.array(values, dtype=float)
            if rest.index:
                other, _ = self.statistics.fit(rest, held, values, blocks)
                less = np.concatenate([other, less])
            gain -= self.statistics.log_likelihood((*rest.index, *held), less, blocks)
        return gain

    def slot(self, k: int) -> Slot:
        """Return term k with its evidence, uncertainty, p-value, competitors and held-out gain."""
        loss, own = self.loss(k)
        _, covariance = self.statistics.fit(join_columns(self.columns))
        first = sum(len(columns.index) for columns in self.columns[:k])
        rows = slice(first, first + len(self.columns[k].index))
        covariance = covariance[rows, rows] * own.overdispersion
        term = self.terms[k]
        away = np.array([term.value(name) - term.neutral.get(name, 0.0) for name in term.free])
        spread = np.array([term.spread.get(name, 0.0) for name in term.free])
        spread[0] = math.hypot(spread[0], term.effect.relative_std * away[0])
        covariance = covariance + np.diag((SETTINGS.relative_std * away) ** 2)
        size = 2.0 * max(loss, 0.0)
        if term.has_neutral:
            acts = [term.free.index(name) for name in term.strengths]
            away = away[acts]
            size = float(away @ np.linalg.solve(covariance[np.ix_(acts, acts)], away))
        return Slot(
            term,
            self.evidence(k),
            size,
            own.overdispersion,
            np.sqrt(np.diag(covariance) + spread**2),
            p_value_of_distance(size, len(away), len(self.statistics.blocks.gradient)),
            tuple(self.competitors(k)),
            self.heldout(k),
        )


def column_identity(term: CandidateTerm) -> tuple[DynamicsEffect, tuple[str, ...], bool]:
    """Return the key that identifies the columns of a term."""
    return term.effect, term.free, term.jump


def p_value_of_distance(size: float, count: int, blocks: int) -> float:
    """Return the p-value of a squared distance of `count` values, by Fisher's F: blocks tell the variance."""
    return float(fdtrc(count, max(blocks - 1, 1), max(size, 0.0) / count))


def is_admissible(term: CandidateTerm, estimate: FloatArray) -> bool:
    """Return True if the estimate has the effect's allowed sign, or for a grid value is over 0.2 of it."""
    if term.jump:
        return bool(estimate[0] > 0.2)
    return not term.effect.positive or bool(estimate[0] > 0.0)


def threshold_of(alternatives: int) -> float:
    """Return the log evidence above which a null drive has a finding with the probability of the settings.

    A Bayes factor exceeds K under the null with a probability of at most 1 / K (Markov's inequality).
    """
    return math.log(alternatives / SETTINGS.null_finding_probability)
