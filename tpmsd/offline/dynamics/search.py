"""Stepwise selection of terms for a baseline on a drive.

In: a setup. Out: `Search`: the terms that the drive holds, path and noise with them, and what every step did.
A forward step adds the term with the largest log evidence; an exchange step replaces a term by a better
one; a backward step takes out what is no longer needed. After each step parameters, path and noise are
fitted again, so that every standard deviation is that of the model as it stands.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from operator import is_
from typing import TYPE_CHECKING

import numpy as np

from tpmsd.car.physics.dynamics_catalogue import DYNAMICS_EFFECTS
from tpmsd.car.physics.dynamics_effect import EVENT, DynamicsEffect
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.arrays import BoolArray
from tpmsd.offline.dynamics.columns import Probe, gram
from tpmsd.offline.dynamics.evidence import PriorColumns, Statistics, join_columns
from tpmsd.offline.dynamics.model_statistics import ModelStatistics, fold_blocks
from tpmsd.offline.dynamics.noise import PathNoise, initial_noise, least_noise
from tpmsd.offline.dynamics.path import (
    Linear,
    Setup,
    covariates_of,
    fitted_noise,
    part_of_blocks,
    smoothed,
    subset_of_blocks,
)
from tpmsd.offline.dynamics.predict import predicted
from tpmsd.offline.dynamics.settings import SETTINGS
from tpmsd.offline.dynamics.terms import CandidateTerm, acts_jointly, are_confounded, candidates

if TYPE_CHECKING:
    from tpmsd.offline.dynamics.located import LocatedTerm

Say = Callable[[float], None]


@dataclass(frozen=True)
class SelectionState:
    """The model after a step: for each fold the terms fitted without it, and the path."""

    terms: tuple[CandidateTerm, ...]
    by_fold: tuple[tuple[DynamicsEffect, ...], ...]
    path: FloatArray
    states: int


@dataclass(frozen=True)
class CompetingSelection:
    """Another selection that explains the drive."""

    nats: float
    """Its log posterior odds against this one."""
    keys: frozenset[str]
    """Its terms."""


@dataclass(frozen=True)
class FittedModel:
    """Terms, path, noise and error after a fit: all that the next one changes, to go back to."""

    terms: tuple[CandidateTerm, ...]
    at: Linear
    noise: PathNoise
    floor: PathNoise
    error: float
    looked: CachedStatistics | None
    """Answers about it."""


@dataclass
class CachedStatistics:
    """Answers about a model: they hold while path, noise and terms are these."""

    at: Linear
    noise: PathNoise
    terms: tuple[CandidateTerm, ...]
    whole: ModelStatistics | None = None
    """Statistics with every effect of the catalogue offered."""
    part: Search | None = None
    """The model on a part of the blocks, with answers of its own."""
    slopes: list[LocatedTerm] | None = None
    nameless: list[LocatedTerm] | None = None

    def matches(self, search: Search) -> bool:
        """Return True if path, noise and terms are those of the search."""
        same = self.at is search.at and self.noise is search.noise and len(self.terms) == len(search.terms)
        return same and all(map(is_, self.terms, search.terms))


@dataclass
class Search:
    """The state of the selection."""

    setup: Setup
    fixed: tuple[DynamicsEffect, ...] = ()
    """Effects that belong to the baseline: of a model file."""
    simulated: tuple[DynamicsEffect, ...] = ()
    """Effects with which the baseline moves like the user's simulation that the drive is compared with."""
    terms: list[CandidateTerm] = field(default_factory=list)
    stages: list[SelectionState] = field(default_factory=list)
    noise: PathNoise = field(init=False)
    at: Linear = field(init=False)
    floor: PathNoise = field(init=False)
    scale: FloatArray = field(init=False)
    """(m,) white noise of a reading, by which errors of predictions are measured."""
    error: float = field(init=False)
    may_be_proxy: bool = False
    """True if the effects of the catalogue may be proxies of one that is not in it."""
    kept: str = ""
    """Key of a term that is the hypothesis of this selection: no step takes it out."""
    competitor: CompetingSelection | None = None
    """The selection that begins with a term without a name, or the one that does not."""
    looked: CachedStatistics | None = None
    """Answers about the model as it stands."""
    rejected: dict[str, float] = field(default_factory=dict)
    """Effects that explain more but predict worse, at the last forward step, with their log evidence."""
    overstated: dict[str, float] = field(default_factory=dict)
    """Log evidence per row that effects promised beyond what their fits then had, of those that were not
    added for it: they must promise that much more to be fitted again."""

    def __post_init__(self) -> None:
        setup = self.setup
        sizes, readings = setup.sizes(self.theta), setup.readings()
        self.noise = initial_noise(sizes, setup.disturbances, list(readings.T))
        white = np.maximum(SETTINGS.white_share * self.noise.outputs, 1e-7)
        self.floor = least_noise(sizes, setup.disturbances, white)
        self.at = smoothed(setup, self.theta, setup.start(self.theta), self.noise)
        self.scale = self.noise.outputs
        self._refit_noise(SETTINGS.noise_rounds)
        self.error = self.prediction_error()

    @property
    def theta(self) -> tuple[DynamicsEffect, ...]:
        """Return the effects of the model."""
        return (*self.base, *(term.effect for term in self.terms))

    @property
    def base(self) -> tuple[DynamicsEffect, ...]:
        """Return the effects that no step removes: simulated and fixed ones."""
        return (*self.simulated, *self.fixed)

    @property
    def covariates(self) -> dict[str, FloatArray]:
        """Return the covariates along the path, (n,) each."""
        return covariates_of(self.setup, self.theta, self.at.path)

    def offered(self) -> list[CandidateTerm]:
        """Return the terms of the catalogue that the model does not have, nuisances aside."""
        return [term for term in self._candidates() if not term.nuisance]

    def _candidates(self) -> list[CandidateTerm]:
        """Return the terms of the catalogue that the model does not have, nuisances included."""
        taken = (*self.fixed, *(term.effect for term in self.terms))
        return candidates(self.setup.baseline, self.setup.channels, taken, self.simulated)

    @property
    def named(self) -> list[CandidateTerm]:
        """Return the terms of the model that are no nuisances."""
        return [term for term in self.terms if not term.nuisance]

    @property
    def has_unnamed_term(self) -> bool:
        """Return True if one of its terms has no name."""
        return any(term.name == "unknown" for term in self.terms)

    def without(self, k: int) -> tuple[DynamicsEffect, ...]:
        """Return the effects of the model without one of its terms."""
        return (*self.base, *(term.effect for j, term in enumerate(self.terms) if j != k))

    # -- fitting ---------------------------------------------------------------------------------------------

    def _refit_noise(self, rounds: int) -> None:
        """Fit the noise in so many rounds, then smooth the path again."""
        self.noise = fitted_noise(self.setup, self.at, self.noise, rounds, self.floor)
        self.at = smoothed(self.setup, self.theta, self.at, self.noise)

    def fit(self, rounds: int = 3) -> None:
        """Fit parameters, path and noise in turn, until no value moves or the promised gain is negligible."""
        swings = any(term.swings for term in self.terms)
        for k in range(SETTINGS.swing_rounds if swings else rounds):
            if not self.terms:
                break
            columns, probes = self.own(0)
            statistics = Statistics(gram(self.setup, self.theta, self.at, self.noise, probes))
            everything = join_columns(columns)
            ratio = statistics.addition(PriorColumns((), np.zeros(0), np.zeros(0)), everything).overdispersion
            step, covariance = statistics.fit(replace(everything, precision=everything.precision * ratio))
            fall = float(step @ np.linalg.solve(covariance, step))
            self._move_terms(step * self._trusted_share(step))
            self.at = smoothed(self.setup, self.theta, self._adapt_to_states(self.at.path), self.noise)
            size = np.concatenate([1.0 / np.sqrt(part.precision) for part in columns])
            if fall < SETTINGS.path_tolerance or np.all(np.abs(step) < SETTINGS.settled * size):
                break
            if k == 0 or swings:
                self._refit_noise(4)
        self._refit_noise(3)

    def _trusted_share(self, step: FloatArray) -> float:
        """Return the share of a step that moves a swinging body's values by one prior deviation at most.

        How much room the path has bends within that.
        """
        at, largest = 0, 1.0
        for term in self.terms:
            if term.swings:
                size = np.abs(step[at : at + term.columns]) / np.array(term.prior_std)
                largest = max(largest, float(size.max()))
            at += term.columns
        return 1.0 / largest

    def fit_until_converged(self) -> None:
        """Fit until no value moves; stop and restore where a fit predicts worse than the model at the start.

        A likelihood may go on to grow along values that explain how readings follow each other, such as a
        delay and a position of one instrument, while the prediction from the inputs falls apart.
        """
        most = self.error + SETTINGS.max_error_increase
        for _ in range(SETTINGS.last_fits):
            before = [term.values() for term in self.terms]
            fitted = self._snapshot()
            self.fit()
            self.error = self.prediction_error()
            if self.error > most:
                self._restore(fitted)
                break
            moves = [
                np.abs(term.values() - values) / np.array(term.prior_std)
                for term, values in zip(self.terms, before, strict=True)
            ]
            if max(float(np.max(move)) for move in moves) < SETTINGS.settled:
                break

    def _snapshot(self) -> FittedModel:
        """Return a snapshot of all that a fit changes."""
        return FittedModel(tuple(self.terms), self.at, self.noise, self.floor, self.error, self.looked)

    def _restore(self, fitted: FittedModel) -> None:
        """Restore a snapshot."""
        self.terms = list(fitted.terms)
        self.at, self.noise, self.floor, self.error = fitted.at, fitted.noise, fitted.floor, fitted.error
        self.looked = fitted.looked

    def _move_terms(self, step: FloatArray) -> None:
        """Move the values of all terms by a step over their columns."""
        at = 0
        for k, term in enumerate(self.terms):
            self.terms[k] = term.moved(step[at : at + term.columns])
            at += term.columns

    def _adapt_to_states(self, path: FloatArray) -> FloatArray:
        """Return a path with the columns of the present states; set noise and its bounds for them."""
        setup, old = self.setup, self.noise
        names = setup.states(self.theta)
        if names == old.states:
            return path
        self.floor = least_noise(setup.sizes(self.theta), setup.disturbances, self.floor.outputs)
        self.noise = old.for_states(names, self.floor)
        states = np.zeros((len(path), len(names)))
        for k, name in enumerate(names):
            if name in old.states:
                states[:, k] = path[:, old.states.index(name)]
        return np.concatenate([states, path[:, len(old.states) :]], axis=1)

    def own(self, first: int) -> tuple[list[PriorColumns], list[Probe]]:
        """Return the columns of the model's own terms, counted from `first`, and their probes."""
        columns, probes = [], []
        covariates = self.covariates if self.terms else {}
        for k, term in enumerate(self.terms):
            own = term.probes(self.without(k), covariates)
            if term.swings:
                own = [replace(probe, loosens=True) for probe in own]
            offset, precision = term.prior()
            columns.append(PriorColumns(tuple(range(first, first + len(own))), offset, precision))
            probes += own
            first += len(own)
        return columns, probes

    def duplicate(self) -> Search:
        """Return an independent copy of the selection."""
        out = copy(self)
        out.terms, out.stages = list(self.terms), list(self.stages)
        return out

    def part(self, with_events: bool = False) -> Search:
        """Return the model on a part of the blocks, with `with_events` on all blocks with events too."""
        few, at = subset_of_blocks(self.setup, self.at, self._blocks_with_events() if with_events else None)
        out = copy(self)
        out.setup, out.at = few, at
        return out

    def _blocks_with_events(self) -> BoolArray:
        """Return for each block whether an event of the model falls in it, (B,)."""
        drive = self.setup.drive
        begins, ends = drive.time_s[drive.starts], drive.time_s[drive.ends - 1]
        out = np.zeros(len(begins), dtype=bool)
        for effect in self.theta:
            if effect.kind == EVENT:
                onset, duration = (float(getattr(effect, name)) for name in ("onset_s", "duration_s"))
                out |= (ends >= onset) & (begins < onset + duration)
        return out

    # -- steps -----------------------------------------------------------------------------------------------

    @property
    def cached_statistics(self) -> CachedStatistics:
        """Return the cached statistics of the present model, empty after a change."""
        if self.looked is None or not self.looked.matches(self):
            self.looked = CachedStatistics(self.at, self.noise, tuple(self.terms))
        return self.looked

    def look(self, offered: Sequence[CandidateTerm]) -> ModelStatistics:
        """Return the statistics of the model's terms, of their removal and of the terms offered.

        All effects of the catalogue are looked at together as soon as most of them are offered.
        """
        seen = self.cached_statistics
        if seen.whole is None and len(offered) > len(DYNAMICS_EFFECTS) // 2:
            seen.whole = self._compute_statistics(self._candidates())
        if seen.whole is not None and (look := seen.whole.restricted_to_offers(offered)) is not None:
            return look
        return self._compute_statistics(offered)

    def _compute_statistics(self, offered: Sequence[CandidateTerm]) -> ModelStatistics:
        """Return the statistics of the model and the offered terms, without the cache."""
        columns, probes = self.own(0)
        removal: list[tuple[tuple[int, ...], tuple[float, ...]]] = []
        for k, term in enumerate(self.terms):
            if term.effect.shaped_by:
                removal.append(((len(probes),), (1.0,)))
                probes.append(Probe((*self.without(k), term.at_rest()), 1.0, loosens=True))
            elif term.effect.states or term.free[0].startswith("heights["):
                away = [term.neutral.get(name, 0.0) - term.value(name) for name in term.free]
                removal.append((columns[k].index, tuple(away)))
            else:
                removal.append(((len(probes),), (1.0,)))
                probes.append(Probe(self.without(k), 1.0))
        added = []
        theta, covariates = self.theta, self.covariates if offered else {}
        for term in offered:
            own = term.probes(theta, covariates)
            offset, precision = term.prior()
            added.append(PriorColumns(tuple(range(len(probes), len(probes) + len(own))), offset, precision))
            probes += own
        return ModelStatistics(
            Statistics(gram(self.setup, self.theta, self.at, self.noise, probes)),
            list(self.terms),
            columns,
            removal,
            list(offered),
            added,
        )

    def admit_nuisances(self) -> bool:
        """Add every nuisance whose evidence is positive (every car has them); True if any was added."""
        offered = [term for term in self._candidates() if term.nuisance]
        taken = [self.try_terms([*self.terms, term]) for term, _ in self.ranked_terms(offered, 0.0)]
        return any(taken)

    def forward_step(self, threshold: float) -> bool:
        """Add the term with the largest evidence above the threshold that predicts no worse; False if none.

        A part of the blocks is asked first: what is plain there needs no more.
        """
        self.rejected = {}
        offered = self.offered()
        coarse = self._on_part_of_blocks()
        if coarse is not self:
            ranked = coarse.ranked_terms(offered, SETTINGS.plain * threshold)
            if ranked and self._add_first(ranked, threshold, coarse.rows):
                return True
        ranked = self.ranked_terms([t for t in offered if t.name not in self.rejected], threshold)
        return self._add_first(ranked, threshold, self.rows)

    def _on_part_of_blocks(self) -> Search:
        """Return the model on a part of the blocks, cached; the search itself where that is all blocks."""
        seen = self.cached_statistics
        if seen.part is None:
            few = self.part()
            if few.setup is self.setup:
                return self
            seen.part = few
        if seen.whole is not None:
            seen.part.cached_statistics.whole = seen.whole.restricted_to_blocks(part_of_blocks(self.setup))
        return seen.part

    def ranked_terms(
        self, offered: list[CandidateTerm], threshold: float
    ) -> list[tuple[CandidateTerm, float]]:
        """Return the terms above the threshold at their fitted values, best first, each effect once."""
        if not offered:
            return []
        look = self.look(offered)
        scores = np.array([look.score(k) for k in range(len(offered))])
        out: dict[str, tuple[CandidateTerm, float]] = {}
        for k in np.argsort(-scores):
            term = offered[int(k)]
            if scores[k] > threshold and term.key not in out:
                plain = replace(term, jump=False)
                if not term.jump:
                    plain = term.moved(look.addition(int(k)).estimate)
                out[term.key] = (plain, float(scores[k]))
        return list(out.values())

    def _add_first(self, terms: Sequence[tuple[CandidateTerm, float]], threshold: float, rows: int) -> bool:
        """Add the first term that predicts no worse and that the next backward step would not take out; False
        if none of those that are tried does. Terms that are confounded with one already tried count as one
        with it: they would crowd out the others. Evidence is that in so many rows."""
        distinct: list[CandidateTerm] = []
        for term, evidence in terms:
            if not any(are_confounded(term, one) for one in distinct):
                if len(distinct) == SETTINGS.tried:
                    break
                distinct.append(term)
            before = self._snapshot()
            promises = evidence - self.overstated.get(term.name, 0.0) * rows >= 0.5 * threshold
            if promises and self.try_terms([*self.terms, term]):
                found = self.look([]).evidence(len(self.terms) - 1)
                if found >= 0.5 * threshold:
                    return True
                self._restore(before)
                self.overstated[term.name] = evidence / rows - found / self.rows
            self.rejected[term.name] = evidence
        return False

    @property
    def rows(self) -> int:
        """Return the number of the drive's rows."""
        return len(self.setup.drive.time_s)

    def try_terms(self, terms: list[CandidateTerm]) -> bool:
        """Fit these terms and keep them if the model predicts no worse; True if kept, else all is restored.

        A model without a path, such as one whose fit ran away, is no model. Beside names that are
        there most terms fail, so a part of the blocks is asked first: what predicts plainly worse there is
        not fitted to the whole drive.
        """
        part = self.part() if self.named else self
        if part.setup is not self.setup and not part._try_terms(terms, SETTINGS.plain_error_increase):
            return False
        return self._try_terms(terms, SETTINGS.max_error_increase)

    def _try_terms(self, terms: list[CandidateTerm], most: float) -> bool:
        """Fit these terms and keep them if the error grows by `most` at most; True if kept, else restored."""
        before = self._snapshot()
        there = (*self.base, *(term.effect for term in terms))
        self.terms = [_within_limits(term) for term in terms if acts_jointly(term.effect, there)]
        try:
            self.at = smoothed(self.setup, self.theta, self._adapt_to_states(self.at.path), self.noise)
            self.fit()
        except np.linalg.LinAlgError:
            self.error = np.inf
        else:
            self.error = self.prediction_error()
        if self.error <= before.error + most:
            return True
        self._restore(before)
        return False

    def prediction_error(self) -> float:
        """Return the mean over blocks and outputs of the log error of the prediction from the inputs, in
        standard deviations of a reading."""
        few, at = subset_of_blocks(self.setup, self.at)
        square = (few.readings() - predicted(few, self.theta, at.path)) ** 2
        logs = []
        for first, last in zip(few.drive.starts, few.drive.ends, strict=True):
            known = np.isfinite(square[first:last])
            mean = np.where(known, square[first:last], 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
            logs.append(np.where(known.any(axis=0), 0.5 * np.log(mean + 1e-12) - np.log(self.scale), 0.0))
        return float(np.mean(np.clip(np.nan_to_num(np.array(logs), nan=6.0), -5.0, 6.0)))

    def backward_or_exchange_step(self, threshold: float) -> bool:
        """Remove or exchange one term where that helps; True if the model changed.

        What predicts worse in the place of one term is not tried in that of another. Where a part of the
        blocks has no competitor for any term, the whole drive is not asked.
        """
        if self._remove_needless_term(threshold):
            return True
        coarse = self._on_part_of_blocks()
        if coarse is not self and not coarse._has_likelier_competitor(-SETTINGS.confounded_nats):
            return False
        look = self.look(self.offered())
        worse: set[str] = set()
        for k, term in enumerate(self.terms):
            if term.nuisance or term.key == self.kept:
                continue
            competitors = look.competitors(k)
            if not competitors:
                continue
            promised = competitors[0][1] - self.overstated.get(competitors[0][0].name, 0.0) * self.rows
            better = promised > look.evidence(k) + SETTINGS.confounded_nats
            if better and competitors[0][0].key not in worse and self._exchange(k, competitors[0][0], worse):
                return True
        return False

    def _has_likelier_competitor(self, nats: float) -> bool:
        """Return True if a term has a competitor whose evidence is larger by so many nats."""
        look = self.look(self.offered())
        for k, term in enumerate(self.terms):
            if term.nuisance or term.key == self.kept:
                continue
            competitors = look.competitors(k)
            if competitors and competitors[0][1] > look.evidence(k) + nats:
                return True
        return False

    def _remove_needless_term(self, threshold: float) -> bool:
        """Remove the first term with too little evidence if the model predicts no worse; False if none.

        The model's own columns suffice: nothing that is offered is evaluated.
        """
        look = self.look([])
        for k, term in enumerate(self.terms):
            if term.key == self.kept:
                continue
            least = 0.0 if term.nuisance else 0.5 * threshold
            if look.evidence(k) < least:
                rest = [one for j, one in enumerate(self.terms) if j != k]
                if self._try_terms(rest, SETTINGS.max_error_increase):
                    return True
        return False

    def _exchange(self, k: int, competitor: CandidateTerm, worse: set[str]) -> bool:
        """Replace term k by a competitor; False, and nothing changed, if that is no better. One that predicts
        worse is added to `worse`."""
        before, term = self._snapshot(), self.terms[k]
        start = replace(competitor, jump=False) if competitor.jump else competitor
        rest = [one for j, one in enumerate(self.terms) if j != k]
        if not self.try_terms([*rest, start]):
            self.rejected[competitor.name] = 0.0
            worse.add(competitor.key)
        elif self._is_better_with(term, competitor):
            return True
        self._restore(before)
        return False

    def _is_better_with(self, old: CandidateTerm, new: CandidateTerm) -> bool:
        """Return True if the new term, the last, has at least the evidence of the old one in its place."""
        fresh = replace(old, effect=old.effect)
        look = self.look([fresh] if fresh.name not in {t.name for t in self.terms} else [])
        k = len(self.terms) - 1
        competitors = [value for term, value in look.competitors(k) if term.key == old.key]
        return not competitors or look.evidence(k) >= competitors[0]

    def record_stage(self) -> None:
        """Append the present model to `stages`, with its terms fitted without each fold in turn."""
        look = self.look([])
        folds = fold_blocks(len(self.setup.drive.starts))
        free = join_columns(look.columns)
        by_fold = []
        for blocks in folds:
            step = np.zeros(0) if not self.terms else look.statistics.fit(free, left_out=blocks)[0]
            at, effects = 0, list(self.base)
            for term in self.terms:
                effects.append(term.moved(step[at : at + term.columns]).effect)
                at += term.columns
            by_fold.append(tuple(effects))
        states = len(self.setup.states(self.theta))
        self.stages.append(SelectionState(tuple(self.terms), tuple(by_fold), self.at.path, states))


def _within_limits(term: CandidateTerm) -> CandidateTerm:
    """Return the term with its values clipped to the limits of its effect."""
    return term.moved(np.zeros(len(term.free)))
