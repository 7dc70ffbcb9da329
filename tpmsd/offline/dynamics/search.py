"""Stepwise selection of terms for a baseline on a drive.

In: a setup. Out: `Search`: the terms that the drive holds, path and noise with them, and what every step did.
A forward step adds the term with the largest log evidence; an exchange step replaces a term by a better one; a
backward step takes out what is no longer needed. After each step parameters, path and noise are fitted again,
so that every standard deviation is that of the model as it stands.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.columns import Probe, gram
from tpmsd.offline.dynamics.evidence import Addition, Columns, Statistics, joined
from tpmsd.offline.dynamics.noise import Noise, first_guess, least
from tpmsd.offline.dynamics.path import Linear, Setup, covariates_of, fitted_noise, smoothed, subset
from tpmsd.offline.dynamics.settings import SETTINGS
from tpmsd.offline.dynamics.terms import Term, candidates

Say = Callable[[float], None]


@dataclass(frozen=True)
class Slot:
    """A term of the model against its absence and against rivals in its place."""

    term: Term
    evidence: float
    """Log Bayes factor against its absence."""
    overdispersion: float
    std: FloatArray
    """(a,) standard deviations, overdispersion included."""
    p_value: float
    rivals: tuple[tuple[Term, float], ...]
    """Terms in its place with their log Bayes factors against its absence, best first."""
    heldout_gain: float
    """Nats on held-out blocks against the model without it."""


@dataclass(frozen=True)
class Stage:
    """The model after a step: for each fold the terms fitted without it, and the path."""

    terms: tuple[Term, ...]
    by_fold: tuple[tuple[DynamicsEffect, ...], ...]
    path: FloatArray
    states: int


@dataclass
class Search:
    """The state of the selection."""

    setup: Setup
    fixed: tuple[DynamicsEffect, ...] = ()
    """Effects that belong to the baseline: of a model file."""
    terms: list[Term] = field(default_factory=list)
    stages: list[Stage] = field(default_factory=list)
    noise: Noise = field(init=False)
    at: Linear = field(init=False)
    floor: Noise = field(init=False)

    def __post_init__(self) -> None:
        setup = self.setup
        states = setup.states(self.fixed)
        readings = setup.readings()
        self.noise = first_guess(states, setup.disturbances, list(readings.T))
        white, free = least(states, setup.disturbances)
        self.floor = Noise(white, free, np.full(readings.shape[1], 1e-7))
        self.at = smoothed(setup, self.theta, setup.start(self.theta), self.noise)
        self._refit_noise(SETTINGS.noise_rounds)

    @property
    def theta(self) -> tuple[DynamicsEffect, ...]:
        """Return the effects of the model."""
        return (*self.fixed, *(term.effect for term in self.terms))

    @property
    def covariates(self) -> dict[str, FloatArray]:
        """Return the covariates along the path, (n,) each."""
        return covariates_of(self.setup, self.theta, self.at.path)

    def offered(self) -> list[Term]:
        """Return the terms of the catalogue that the model does not have."""
        return candidates(self.setup.baseline, self.setup.channels, self.theta)

    def without(self, k: int) -> tuple[DynamicsEffect, ...]:
        """Return the effects of the model without one of its terms."""
        return (*self.fixed, *(term.effect for j, term in enumerate(self.terms) if j != k))

    # -- fitting ---------------------------------------------------------------------------------------------

    def _refit_noise(self, rounds: int) -> None:
        self.noise = fitted_noise(self.setup, self.at, self.noise, rounds, self.floor)
        self.at = smoothed(self.setup, self.theta, self.at.path, self.noise)

    def fit(self, rounds: int = 3) -> None:
        """Fit parameters, path and noise again."""
        for k in range(rounds):
            if not self.terms:
                break
            columns, probes = self.own(0)
            statistics = Statistics(gram(self.setup, self.theta, self.at, self.noise, probes))
            everything = joined(columns)
            ratio = statistics.addition(Columns((), np.zeros(0), np.zeros(0)), everything).overdispersion
            step, _ = statistics.fit(replace(everything, precision=everything.precision * ratio))
            self._move(step)
            self.at = smoothed(self.setup, self.theta, self._resized(self.at.path), self.noise)
            size = np.concatenate([1.0 / np.sqrt(part.precision) for part in columns])
            if np.all(np.abs(step) < 1e-3 * size):
                break
            if k == 0:
                self._refit_noise(4)
        self._refit_noise(3)

    def _move(self, step: FloatArray) -> None:
        at = 0
        for k, term in enumerate(self.terms):
            self.terms[k] = term.moved(step[at : at + term.columns])
            at += term.columns

    def _resized(self, path: FloatArray) -> FloatArray:
        """Return a path and set noise for the states that the model has now."""
        names, free = self.setup.states(self.theta), len(self.setup.disturbances)
        have = path.shape[1] - free
        if have == len(names):
            return path
        old = self.noise
        white, _ = least(names, self.setup.disturbances)
        self.floor = replace(self.floor, white=white)
        basic = 3 if self.setup.baseline.forces else 2
        extra = np.zeros((len(path), len(names) - basic))
        self.noise = replace(old, white=np.concatenate([old.white[:basic], white[basic:]]))
        return np.concatenate([path[:, :basic], extra, path[:, have:]], axis=1)

    def own(self, first: int) -> tuple[list[Columns], list[Probe]]:
        """Return the columns of the model's own terms, counted from `first`, and their probes."""
        columns, probes = [], []
        for k, term in enumerate(self.terms):
            own = term.probes(self.without(k), self.covariates)
            offset, precision = term.prior()
            columns.append(Columns(tuple(range(first, first + len(own))), offset, precision))
            probes += own
            first += len(own)
        return columns, probes

    def part(self) -> Search:
        """Return the same model on a part of the blocks, as it stands."""
        few, at = subset(self.setup, self.at)
        out = copy(self)
        out.setup, out.at = few, at
        return out

    # -- steps -----------------------------------------------------------------------------------------------

    def look(self, offered: Sequence[Term]) -> Look:
        """Return the statistics of the model's terms, of their removal and of the terms offered."""
        columns, probes = self.own(0)
        removal: list[tuple[tuple[int, ...], tuple[float, ...]]] = []
        for k, term in enumerate(self.terms):
            if term.effect.states or term.free[0].startswith("heights["):
                away = [term.neutral.get(name, 0.0) - term.value(name) for name in term.free]
                removal.append((columns[k].index, tuple(away)))
            else:
                removal.append(((len(probes),), (1.0,)))
                probes.append(Probe(self.without(k), 1.0))
        added = []
        for term in offered:
            own = term.probes(self.theta, self.covariates)
            offset, precision = term.prior()
            added.append(Columns(tuple(range(len(probes), len(probes) + len(own))), offset, precision))
            probes += own
        return Look(
            Statistics(gram(self.setup, self.theta, self.at, self.noise, probes)),
            self.terms,
            columns,
            removal,
            list(offered),
            added,
        )

    def forward(self, threshold: float, offered: Sequence[Term] | None = None) -> bool:
        """Add the term with the largest evidence above the threshold; False if there is none."""
        offered = self.offered() if offered is None else offered
        if not offered:
            return False
        look = self.look(offered)
        scores = [look.score(k) for k in range(len(offered))]
        best = int(np.argmax(scores))
        if not scores[best] > threshold:
            return False
        self._add(offered[best], look.addition(best))
        return True

    def put(self, term: Term) -> None:
        """Add a term with its values."""
        self.terms.append(_inside(term))
        self.at = smoothed(self.setup, self.theta, self._resized(self.at.path), self.noise)
        self.fit()

    def _add(self, term: Term, addition: Addition) -> None:
        start = replace(term, jump=False) if term.jump else term.moved(addition.estimate)
        self.put(start)

    def tidy(self, threshold: float) -> bool:
        """Take one exchange or backward step where it helps; True if it took one."""
        look = self.look(self.offered())
        for k in range(len(self.terms)):
            evidence = look.evidence(k)
            if evidence < 0.5 * threshold:
                del self.terms[k]
                self.at = smoothed(self.setup, self.theta, self._resized(self.at.path), self.noise)
                self.fit()
                return True
        for k, term in enumerate(self.terms):
            rivals = look.rivals(k)
            if rivals and rivals[0][1] > look.evidence(k) + SETTINGS.twin_nats:
                rival, _ = rivals[0]
                before = (list(self.terms), self.at, self.noise, self.floor)
                del self.terms[k]
                self.at = smoothed(self.setup, self.theta, self._resized(self.at.path), self.noise)
                again = self.look([rival])
                self._add(rival, again.addition(0))
                if any(one.key == rival.key for one in self.terms) and self._better(term, rival):
                    return True
                self.terms, self.at, self.noise, self.floor = before
        return False

    def _better(self, old: Term, new: Term) -> bool:
        """Return True if the model with the new term, which stands last, beats the one with the old one."""
        fresh = replace(old, effect=old.effect)
        look = self.look([fresh] if fresh.name not in {t.name for t in self.terms} else [])
        k = len(self.terms) - 1
        rivals = [value for term, value in look.rivals(k) if term.key == old.key]
        return not rivals or look.evidence(k) >= rivals[0]

    def keep_stage(self) -> None:
        """Note the model as it stands, fitted without each fold in turn."""
        look = self.look([])
        folds = fold_blocks(len(self.setup.drive.starts))
        free = joined(look.columns)
        by_fold = []
        for blocks in folds:
            step = np.zeros(0) if not self.terms else look.statistics.fit(free, left_out=blocks)[0]
            at, effects = 0, list(self.fixed)
            for term in self.terms:
                effects.append(term.moved(step[at : at + term.columns]).effect)
                at += term.columns
            by_fold.append(tuple(effects))
        states = len(self.setup.states(self.theta))
        self.stages.append(Stage(tuple(self.terms), tuple(by_fold), self.at.path, states))


def _inside(term: Term) -> Term:
    """Return the term with values that its effect can take."""
    return term.moved(np.zeros(len(term.free)))


def fold_blocks(blocks: int) -> list[FloatArray]:
    """Return the blocks of each fold, neighbours together."""
    return [part for part in np.array_split(np.arange(blocks), SETTINGS.folds) if len(part)]


@dataclass(frozen=True)
class Look:
    """Statistics about a model: its terms, their removal, and terms that may be added."""

    statistics: Statistics
    terms: Sequence[Term]
    columns: list[Columns]
    removal: list[tuple[tuple[int, ...], tuple[float, ...]]]
    offered: list[Term]
    added: list[Columns]

    def addition(self, k: int) -> Addition:
        """Return what an offered term adds."""
        return self.statistics.addition(joined(self.columns), self.added[k])

    def score(self, k: int) -> float:
        """Return the log evidence of an offered term, less the choice among its alternatives."""
        term, addition = self.offered[k], self.addition(k)
        if not addition.visible or not possible(term, addition.estimate):
            return -math.inf
        return addition.log_evidence() - math.log(term.alternatives)

    def evidence(self, k: int) -> float:
        """Return the log Bayes factor of a term of the model against its absence."""
        rest = [columns for j, columns in enumerate(self.columns) if j != k]
        own = self.statistics.addition(joined(rest), self.columns[k])
        ratio = own.overdispersion
        full = self._penalised(joined(self.columns), (), ())
        less = self._penalised(joined(rest), *self.removal[k])
        prior = self.columns[k].precision
        matrix = own.information / ratio + np.diag(prior)
        occam = 0.5 * (np.linalg.slogdet(matrix)[1] - float(np.sum(np.log(prior))))
        return (full - less) / ratio - occam - math.log(self.terms[k].alternatives)

    def _penalised(self, free: Columns, held: Sequence[int], values: Sequence[float]) -> float:
        """Return the log-likelihood with priors at the best values of the free columns."""
        held_values = np.array(values, dtype=float)
        if not free.index:
            return self.statistics.log_likelihood(held, held_values)
        estimate, _ = self.statistics.fit(free, held, values)
        total = self.statistics.log_likelihood((*free.index, *held), np.concatenate([estimate, held_values]))
        return total - 0.5 * float(np.sum(free.precision * (estimate - free.offset) ** 2))

    def rivals(self, k: int) -> list[tuple[Term, float]]:
        """Return the offered terms in the place of one of the model's, with their evidence, best first."""
        rest = joined([columns for j, columns in enumerate(self.columns) if j != k])
        ratio = self.statistics.addition(rest, self.columns[k]).overdispersion
        best: dict[str, tuple[Term, float]] = {}
        for term, columns in zip(self.offered, self.added, strict=True):
            if set(columns.index) & set(self.removal[k][0]):
                continue
            addition = self.statistics.addition(rest, columns, *self.removal[k])
            if not addition.visible or not possible(term, addition.estimate):
                continue
            value = addition.log_evidence(max(ratio, 1.0)) - math.log(term.alternatives)
            if term.key not in best or value > best[term.key][1]:
                best[term.key] = (term, value)
        return sorted(best.values(), key=lambda pair: -pair[1])

    def heldout(self, k: int) -> float:
        """Return the nats that a term of the model gains on held-out blocks."""
        rest = joined([columns for j, columns in enumerate(self.columns) if j != k])
        held, values = self.removal[k]
        everything = joined(self.columns)
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
        """Return a term of the model with everything that is said of it."""
        rest = joined([columns for j, columns in enumerate(self.columns) if j != k])
        own = self.statistics.addition(rest, self.columns[k])
        _, covariance = self.statistics.fit(joined(self.columns))
        first = sum(len(columns.index) for columns in self.columns[:k])
        variance = np.diag(covariance)[first : first + len(self.columns[k].index)]
        std = np.sqrt(variance * own.overdispersion)
        term = self.terms[k]
        away = np.array([term.value(name) - term.neutral.get(name, 0.0) for name in term.free])
        return Slot(
            term,
            self.evidence(k),
            own.overdispersion,
            std,
            p_value_of(away / std, len(self.statistics.blocks.gradient)),
            tuple(self.rivals(k)),
            self.heldout(k),
        )


def p_value_of(sizes: FloatArray, blocks: int) -> float:
    """Return the two-sided p-value of the largest of some standardised values, by Student's t over blocks."""
    from scipy.stats import t as student

    tail = 2.0 * student.sf(float(np.abs(sizes).max()), max(blocks - 1, 1))
    return float(min(tail * len(sizes), 1.0))


def possible(term: Term, estimate: FloatArray) -> bool:
    """Return True if a fit gives an effect of one sign that sign, and a grid's value a part of itself."""
    if term.jump:
        return bool(estimate[0] > 0.2)
    return not term.effect.positive or bool(estimate[0] > 0.0)


def threshold_of(alternatives: int) -> float:
    """Return the log evidence above which a null drive has a finding with the probability of the settings.

    A Bayes factor exceeds K under the null with a probability of at most 1 / K (Markov's inequality).
    """
    return math.log(alternatives / SETTINGS.false_discovery)
