"""Chooses the terms that a drive demands.

In: `Evidence` and `Hypotheses`. Out: `Selection`: the chosen terms, each with the log-likelihood that it
brings in the presence of the others, in sample and held out, its alternatives, and its confidence.

Forward, with pairs (two effects may hide one another), each step followed by exchanges and removals. A
term pays a penalty for its free values, for the number of wheel patterns looked at, and for errors whose slow
drift the noise model does not hold (its gain is divided by the block-wise variance ratio); and it must
predict blocks that were held out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from tpmsd.car.physics.catalogue import FAULT, NONPARAMETRIC
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.group_gain import group_gain
from tpmsd.offline.diagnosis.hypotheses.plausible import (
    completion_matrix,
    is_plausible,
    nats_against_ratio,
    ratio_limits,
)
from tpmsd.offline.diagnosis.hypotheses.terms import Hypotheses, Term
from tpmsd.offline.diagnosis.selection.alternatives import (
    Alternative,
    confidence,
    confounded_effects,
    is_same_statement,
)
from tpmsd.offline.diagnosis.selection.candidates import Candidates, dependent_fraction, handicap
from tpmsd.offline.diagnosis.selection.chosen import Chosen, Selection
from tpmsd.offline.diagnosis.selection.effect_sets import best_set
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import Evidence

SPLITS = (("front", "rear"), ("left", "right"))
"""Pairs of wheel patterns that may act each in its own way."""


class Selector(Candidates):
    """Searches."""

    def __init__(
        self,
        evidence: Evidence,
        hypotheses: Hypotheses,
        last: bool = False,
        beyond: Callable[[Sequence[Term]], float] = lambda terms: 0.0,
        barred: frozenset[tuple[str, ...]] = frozenset(),
    ) -> None:
        """With `last` it is the verdict that is asked for, and not what the noise is estimated beside.

        `beyond` tells what terms bring beyond their linear responses, nats: alternatives are compared with
        it. `barred` are keys of terms that are no candidates.
        """
        super().__init__(evidence, hypotheses, barred)
        self.last = last
        self.beyond = beyond
        self._bounds = hypotheses.car.bounds
        self._shares: dict[tuple[int, str, str], float] = {}

    def select(self, most: int = SETTINGS.selection.max_terms) -> Selection:
        """Select terms by forward, exchange and backward steps, at most `most` of them."""
        chosen: list[Term] = []
        seen: set[frozenset[int]] = set()
        for _ in range(most):
            best = self._best_addition(chosen)
            if best is None:
                break
            exchanged = self._prune(
                self._with_effects_for_splines(self._exchanged_patterns(self._exchange(chosen + best)))
            )
            # What was exchanged may then fall for its scatter, and leave less than there was.
            added = (
                exchanged if self._margin(exchanged) >= self._margin(chosen) else self._prune(chosen + best)
            )
            if self._margin(added) < self._margin(chosen):
                break
            chosen = added
            state = frozenset(id(term.design) for term in chosen)
            if state in seen:
                break
            seen.add(state)
        return self.selection_of(chosen)

    def selection_of(self, chosen: list[Term]) -> Selection:
        """Return the selection of given terms, less those whose held-out gain is too small."""
        while chosen:
            heldout = [self._heldout_gain(chosen, k) for k in range(len(chosen))]
            worst = int(np.argmin(heldout))
            if heldout[worst] >= SETTINGS.selection.heldout_nats:
                break
            chosen = chosen[:worst] + self._next_coarser_form(chosen, worst) + chosen[worst + 1 :]
        judged = [self._chosen_in_presence(chosen, k) for k in range(len(chosen))]
        order = sorted(judged, key=lambda one: -one.heldout_gain)
        design = self.design(chosen)
        return Selection(
            chosen=tuple(order),
            fit=self.evidence.fit(self.design([one.term for one in order])),
            baseline_heldout=self.evidence.heldout(self.hypotheses.nuisance),
            heldout=self.evidence.heldout(design),
        )

    def _next_coarser_form(self, chosen: list[Term], which: int) -> list[Term]:
        """Return the finest of a spline's coarser forms as a list; empty if there is none."""
        term = chosen[which]
        if not term.nonparametric or term.pulse:
            return []
        size = term.design.shape[1]
        coarser = [
            other
            for other in self.hypotheses.shapes_over(term)
            if other.key == term.key and other.design.shape[1] < size
        ]
        return sorted(coarser, key=lambda one: -one.design.shape[1])[:1]

    def _admission_threshold(self, chosen: Sequence[Term]) -> float:
        """Return the least penalised gain (nats) with which a term is added to the chosen ones."""
        base = self.gain([])
        return SETTINGS.selection.admit_nats + SETTINGS.selection.share_of_rest * max(
            self.gain(chosen) - base, 0.0
        )

    def _best_addition(self, chosen: list[Term]) -> list[Term] | None:
        """Return the best term or pair to add; None where none exceeds the threshold."""
        threshold = self._admission_threshold(chosen)
        best: tuple[float, list[Term]] | None = None
        for gain, terms in [*self.best_candidates(chosen), *self.best_pairs(chosen)]:
            studentised_gain, needed = (
                self._admission_gain(chosen, terms, gain, threshold),
                self._least_gain_needed(chosen, terms[0]),
            )
            if studentised_gain > needed and (best is None or studentised_gain > best[0]):
                best = (studentised_gain, terms)
        return None if best is None else best[1]

    def _least_gain_needed(self, chosen: list[Term], term: Term) -> float:
        """Return the least penalised gain (nats) of a term: the threshold, and for splines a fraction of the
        effects' gain."""
        threshold = self._admission_threshold(chosen)
        if self._is_effect_or_completion(chosen, term):
            return threshold
        free = [one for one in chosen if one.nonparametric or one.ramp]
        effects = self.gain(chosen) - self.gain(free)
        return max(threshold, SETTINGS.selection.spline_over_effects * effects)

    def _admission_gain(
        self, chosen: list[Term], terms: list[Term], penalised_gain: float, threshold: float
    ) -> float:
        """Return the penalised gain (nats) of one or two terms jointly with the chosen ones, by block-wise
        variance.
        `penalised_gain` is the one without it. Minus infinity where the terms cannot stand there.
        """
        now = [*chosen, *terms]
        at = range(len(chosen), len(now))
        if not self._is_identifiable_and_plausible(now):
            return -math.inf
        # Both members of a pair must be needed, or the better one alone would have been found.
        if len(terms) == 2 and min(self._gain_beyond_penalty(now, k) for k in at) < threshold:
            return -math.inf
        if min(self._surplus_over_splines(now, k) for k in at) < 0.0:
            return -math.inf
        penalty = sum(term.penalty for term in terms)
        ratio = max(self.variance_ratio(now, k) for k in at)
        more = SETTINGS.selection.admit_nats if len(terms) == 2 else 0.0
        against = sum(self._nats_against_ratios(now)[len(chosen) :])
        return (penalised_gain + penalty) / ratio - penalty - more - against

    def _is_identifiable_and_plausible(self, terms: list[Term]) -> bool:
        """Return whether the terms are not collinear and their values are physically plausible."""
        if {term.kind_of.confounding.limit for term in terms} & {term.effect for term in terms}:
            return False
        design = self.design(terms)
        rows = np.flatnonzero(np.any(design != 0.0, axis=1))
        gram = design[rows].T @ self.evidence.total[np.ix_(rows, rows)] @ design[rows]
        scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        if float(np.linalg.eigvalsh(gram / np.outer(scale, scale))[0]) < SETTINGS.selection.min_eigenvalue:
            return False
        if max(self._nats_against_ratios(terms)) > SETTINGS.hypotheses.impossible_nats:
            return False
        return all(
            is_plausible(term, values, self._bounds) for term, values, _ in self._limited_values(terms)
        )

    def _limited_values(self, terms: list[Term]) -> Iterator[tuple[Term, FloatArray, FloatArray]]:
        """Yield each term, the values in the joint fit that its limits apply to, and their covariance with
        its block-wise variance."""
        fit = self.evidence.fit(self.design(terms))
        first = self.hypotheses.nuisance.shape[1]
        ratios = np.clip(self.evidence.sandwich(fit)[first:], 1.0, SETTINGS.selection.max_overdispersion)
        into = completion_matrix(terms, self.hypotheses.car.completions)
        wider = into * np.sqrt(ratios)
        values, covariance = into @ fit.values[first:], wider @ fit.covariance[first:, first:] @ wider.T
        at = 0
        for term in terms:
            here = slice(at, at + term.design.shape[1])
            yield term, values[here], covariance[here, here]
            at = here.stop

    def _nats_against_ratios(self, terms: list[Term]) -> list[float]:
        """Return what each term loses if the ratio of its two values is physically possible, nats."""
        if all(ratio_limits(term) is None for term in terms):
            return [0.0] * len(terms)
        return [nats_against_ratio(*each) for each in self._limited_values(terms)]

    def _has_possible_ratios(self, terms: list[Term]) -> bool:
        """Return whether the ratios of the effects' two values are physically possible."""
        return max(self._nats_against_ratios(terms)) <= SETTINGS.hypotheses.impossible_nats

    def _has_plausible_values(self, terms: list[Term], which: Term) -> bool:
        """Return whether one of the terms has values that are plausible on this car."""
        return all(
            is_plausible(term, values, self._bounds)
            for term, values, _ in self._limited_values(terms)
            if term is which
        )

    def _gain_beyond_penalty(self, terms: list[Term], which: int) -> float:
        """Return a term's studentised gain jointly with the others, less its penalty and what it loses if its
        values are possible (nats)."""
        rest = terms[:which] + terms[which + 1 :]
        gain = self.gain(terms) - self.gain(rest)
        against = self._nats_against_ratios(terms)[which]
        return gain / self.variance_ratio(terms, which) - terms[which].penalty - against

    def _surplus_over_splines(self, terms: list[Term], which: int) -> float:
        """Return an effect's penalised gain less what it needs where spline terms may replace it, nats.

        A shape is one of many that would do. What its form leaves looks like an effect as far as shapes on
        those wheels can take its place; and on which wheels it acts is one of several answers, so the effect
        must be needed, too, where both axles have a shape of their own. Infinite where there is no shape.
        """
        over, apart = (
            self._splines_over_its_covariate(terms, which),
            self._splines_over_other_covariates(terms, which),
        )
        if not over and not apart:
            return math.inf
        free = [*terms, *self._terms_to_distinguish(terms, which)]
        least = SETTINGS.selection.admit_nats if over else -math.inf
        for shape in [*over, *apart]:
            alone = [term for term in terms if term is not shape and term is not terms[which]]
            brings = self.gain([*alone, shape]) - self.gain(alone)
            share = (
                SETTINGS.selection.over_other_covariate
                if shape in apart
                else SETTINGS.selection.over_same_covariate * self._replaceable_fraction(terms[which], shape)
            )
            least = max(least, share * brings)
        return self._gain_beyond_penalty(free, which) - least

    def _splines_over_its_covariate(self, terms: list[Term], which: int) -> list[Term]:
        """Return the chosen spline terms over the covariate that an effect depends on."""
        effect = terms[which].kind_of
        if (
            not self.last
            or effect is NONPARAMETRIC
            or effect.identification.shows_in[1] in ("time", "distance")
        ):
            return []
        return [t for t in terms if t.nonparametric and t.covariate == effect.identification.shows_in[1]]

    def _splines_over_other_covariates(self, terms: list[Term], which: int) -> list[Term]:
        """Return the spline terms of wheels among the terms over another covariate than an effect's.

        Those that, like the effect, show in differences between wheels, and are not of one wheel alone.
        """
        term = terms[which]
        effect = term.kind_of
        if not self.last or effect is NONPARAMETRIC or term.wheel or term.pattern:
            return []
        if effect.identification.shows_in[0] != "wheel_ratio":
            return []
        shapes = [t for t in terms if t.nonparametric and t.on_radii and not t.pulse]
        return [t for t in shapes if t.covariate != effect.identification.shows_in[1]]

    @staticmethod
    def _is_effect_or_completion(chosen: list[Term], term: Term) -> bool:
        """Return whether a term is an effect, or a spline over the covariate of a chosen one, on other
        wheels."""
        return not term.nonparametric or any(
            other.nonparametric and other.covariate == term.covariate != "time" for other in chosen
        )

    def _terms_to_distinguish(self, terms: list[Term], which: int) -> list[Term]:
        """Return the terms that an effect must be distinguished from where splines share its covariate.

        A shape of its own for each axle, unless that is the effect in other words, and the effects that it
        names itself.
        """
        over = self._splines_over_its_covariate(terms, which)
        if not over:
            return []
        by_pattern = {t.pattern: t for t in self.hypotheses.shapes_over(over[0]) if not t.knots}
        patterns = {term.pattern for term in over}
        wanted = ("all" if "all" not in patterns else "front",) if "all" in by_pattern else ("front", "rear")
        out = [by_pattern[pattern] for pattern in wanted if pattern in by_pattern and pattern not in patterns]
        out = [
            shape
            for shape in out
            if self._replaceable_fraction(terms[which], shape) < SETTINGS.selection.same_effect
        ]
        similar = set(terms[which].kind_of.confounding.tested_jointly_with) - {term.effect for term in terms}
        return out + [term for term in self.hypotheses.catalogue if term.effect in similar]

    def _replaceable_fraction(self, term: Term, shape: Term) -> float:
        """Return the fraction (0 to 1) of an effect's response that splines on those wheels can explain."""
        both = (id(term.design), shape.pattern, shape.covariate)
        if both not in self._shares:
            gram, _ = self.evidence.projected(self.hypotheses.nuisance)
            similar = [
                other for other in self.hypotheses.shapes_over(shape) if other.pattern == shape.pattern
            ]
            part = np.concatenate([other.design[1:] for other in similar], axis=1)
            own = float(np.einsum("ik,ij,jk->", term.design[1:], gram, term.design[1:]))
            taken = sum(2.0 * group_gain(part, gram, gram @ column)[0] for column in term.design[1:].T)
            self._shares[both] = float(np.clip(taken / max(own, 1e-300), 0.0, 1.0))
        return self._shares[both]

    def _exchange(self, chosen: list[Term]) -> list[Term]:
        """Replace terms by better alternatives until none is left."""
        for _ in range(3 * SETTINGS.selection.max_terms):
            improved = False
            for k in range(len(chosen)):
                rest = chosen[:k] + chosen[k + 1 :]
                now = self.penalised_gain(
                    chosen[k], self.gain(chosen) - self.gain(rest), self._first_value(chosen, k)
                )
                better = [
                    terms
                    for penalised_gain, terms in self.candidates(rest)[:4]
                    if self._is_better(rest, (penalised_gain, terms[0]), (now, chosen[k]))
                ]
                better = [terms for terms in better if self._may_stay([*rest, *terms])]
                if better:
                    chosen = [*rest, *better[0]]
                    improved = True
                    break
            if not improved:
                break
        return chosen

    def _is_better(self, rest: list[Term], other: tuple[float, Term], one: tuple[float, Term]) -> bool:
        """Return whether another term is better than one in its place beside the rest; penalised gains (nats)
        and terms.

        Of a description and an effect of the catalogue, gains are compared as well where they are divided by
        their block-wise variance, as either is added: a description must be better by both, an effect by one.
        """
        by_gain = other[0] > one[0] + SETTINGS.selection.exchange_nats
        if one[1].nonparametric == other[1].nonparametric:
            return by_gain
        now, then = (
            self.studentised_gain(rest, term, penalised_gain) for penalised_gain, term in (one, other)
        )
        by_scatter = then > now + SETTINGS.selection.exchange_nats
        return by_gain or by_scatter if one[1].nonparametric else by_gain and by_scatter

    def _may_stay(self, terms: list[Term]) -> bool:
        """Return whether the last of some terms is admitted beside the others and not removed again.

        A backward step must keep it. What could not be added, or falls for its scatter from block to block,
        takes no other term's place.
        """
        last = len(terms) - 1
        least = SETTINGS.selection.needed_share * self._least_gain_needed(terms[:last], terms[last])
        return (
            self._is_identifiable_and_plausible(terms)
            and self._surplus_over_splines(terms, last) >= 0.0
            and self._gain_beyond_penalty(terms, last) >= least
        )

    def _exchanged_patterns(self, chosen: list[Term]) -> list[Term]:
        """Return the terms with a spline moved to other wheels, where the gain less penalties is then larger.
        A shape of both axles' difference puts half of what one axle does on the other, and the speed of the
        free wheels is then wrong by what looks like GNSS latency.
        """
        for shape in [term for term in chosen if term.nonparametric and not term.pulse]:
            options = self._forms_on_other_wheels(shape)
            for other in [term for term in chosen if term is not shape]:
                rest = [term for term in chosen if term is not shape and term is not other]
                trials = [[*rest, *terms] for terms in options]
                best = max(
                    [chosen, *(terms for terms in trials if self._is_identifiable_and_plausible(terms))],
                    key=self._margin,
                )
                if (
                    best is not chosen
                    and self._margin(best) > self._margin(chosen) + SETTINGS.selection.exchange_nats
                ):
                    return self._exchanged_patterns(best)
        return chosen

    def _forms_on_other_wheels(self, shape: Term) -> list[list[Term]]:
        """Return splines of the same covariate and knots on other wheels, and pairs of them on separate
        wheels."""
        same = [term for term in self.hypotheses.shapes_over(shape) if term.knots == shape.knots]
        by_pattern = {term.pattern: term for term in same}
        options = [[term] for term in same if term is not shape]
        return options + [
            [by_pattern[a], by_pattern[b]] for a, b in SPLITS if a in by_pattern and b in by_pattern
        ]

    def _with_effects_for_splines(self, chosen: list[Term]) -> list[Term]:
        """Return the terms with a spline, and effects over its covariate, replaced by two effects that gain
        more less its handicap, or by a set of effects that every car has."""
        for shape in [term for term in chosen if term.nonparametric and not term.pulse]:
            others = [term for term in chosen if term is not shape]
            ahead = handicap(shape) * (self.gain(chosen) - self.gain(others))
            must = self._margin(chosen) - ahead + SETTINGS.selection.exchange_nats
            for rest in (
                others,
                [t for t in others if t.kind_of.identification.shows_in[1] != shape.covariate],
            ):
                for _, terms in self.pairs_over(shape.covariate, rest)[: SETTINGS.selection.pairs_tried]:
                    named = self._prune([*rest, *terms])
                    if self._margin(named) > must and self._is_identifiable_and_plausible(named):
                        return self._with_effects_for_splines(named)
            common = self._common_effect_set(others, shape, self._margin(chosen) - ahead)
            if common:
                return self._with_effects_for_splines(common)
        return chosen

    def _common_effect_set(self, others: list[Term], shape: Term, margin: float) -> list[Term]:
        """Return the other terms with a set of effects that every car has in place of a spline; empty where
        the model with the spline, `margin` (nats), is better."""
        if shape.covariate in ("time", "distance") or shape.drive is not None:
            return []
        rest = [term for term in others if not term.kind_of.confounding.common]
        gram, b = self.evidence.projected(self.design(rest))
        found = max(
            (best_set(common, gram, b) for common in self._possible_common_effects(rest)),
            key=lambda one: one.log_bayes,
        )
        named = [*rest, *found.terms]
        better = self._margin(rest) + found.log_bayes > margin + SETTINGS.selection.exchange_nats
        return named if found.terms and better and self._is_identifiable_and_plausible(named) else []

    def _possible_common_effects(self, joint: list[Term]) -> list[list[Term]]:
        """Return the catalogue's terms of effects that every car has, in one list for each choice between an
        effect and its limit."""
        limits = {term.kind_of.confounding.limit for term in joint}
        every = [
            term
            for term in self.hypotheses.catalogue
            if term.kind_of.confounding.common and term.drive is None and term.effect not in limits
        ]
        limited = {
            term.effect: term.kind_of.confounding.limit for term in every if term.kind_of.confounding.limit
        }
        return [
            [term for term in every if term.effect not in limited],
            *(
                [term for term in every if term.effect == name or term.effect not in {*limited, limit}]
                for name, limit in limited.items()
            ),
        ]

    def _is_independent(self, terms: list[Term], term: Term, gain: float) -> bool:
        """Return whether a term brings most of its gain jointly with its alternative too: then they explain
        different things.
        """
        return self.gain([*terms, term]) - self.gain(terms) > SETTINGS.selection.independent_share * gain

    def _prune(self, chosen: list[Term]) -> list[Term]:
        """Remove terms with less gain than they need, the least first, until all stay."""
        while len(chosen) > 1:
            threshold = SETTINGS.selection.needed_share * self._admission_threshold(chosen)
            surplus = [
                min(self._gain_beyond_penalty(chosen, k) - threshold, self._surplus_over_splines(chosen, k))
                for k in range(len(chosen))
            ]
            worst = int(np.argmin(surplus))
            if surplus[worst] >= 0.0:
                break
            chosen = chosen[:worst] + chosen[worst + 1 :]
        return chosen

    def _heldout_gain(self, terms: list[Term], which: int) -> float:
        """Return the held-out gain (nats) of one of the terms, jointly with the others."""
        return self.heldout(terms) - self.heldout(terms[:which] + terms[which + 1 :])

    def _chosen_in_presence(self, chosen: list[Term], which: int) -> Chosen:
        """Return one of the chosen terms with its gains, confidence, alternatives, values and standard
        deviations."""
        term = chosen[which]
        rest = chosen[:which] + chosen[which + 1 :]
        fit = self.evidence.fit(self.design(chosen))
        start = self.hypotheses.nuisance.shape[1] + sum(t.design.shape[1] for t in chosen[:which])
        at = slice(start, start + term.design.shape[1])
        jointly = [*chosen, *self._terms_to_distinguish(chosen, which)]
        joint = self.fit_for_values(jointly, term)
        wider = self.fit_for_values(jointly, term, term.kind_of.confounding.widened_by)
        ratios = np.clip(self.evidence.sandwich(joint)[at], 1.0, SETTINGS.selection.max_overdispersion)
        gain = fit.gain - self.gain(rest)
        studentised_gain = gain / float(ratios.max()) - term.penalty
        alternatives = self._alternatives(rest, term, gain, float(fit.values[start]), float(ratios.max()))
        return Chosen(
            term=term,
            gain=gain,
            admitted_by=studentised_gain,
            heldout_gain=self._heldout_gain(chosen, which),
            confidence=confidence(term.effect, studentised_gain, alternatives),
            confounded_with=confounded_effects(alternatives),
            values=joint.values[at],
            stds=np.sqrt(
                np.diag(wider.covariance)[at] * ratios
                + (wider.values[at] - joint.values[at]) ** 2
                + (SETTINGS.selection.model_error * joint.values[at]) ** 2
            ),
        )

    def _alternatives(
        self, rest: list[Term], term: Term, gain: float, first: float, ratio: float
    ) -> list[Alternative]:
        """Return the alternatives of a term that gains so much jointly with the rest, with its first value
        and its variance ratio, the best first.
        """
        similar = max(SETTINGS.selection.confounded_nats, SETTINGS.selection.confounded_share * gain)
        # Both of two values are needed: where one does alone, no alternative replaces the other one.
        alone = self.gains_of_parts(rest, term) if term.design.shape[1] == 2 else np.zeros(0)
        divided = len(alone) == 2 and float(alone.max()) <= gain - similar
        doubt = ratio + SETTINGS.selection.confounded_share * gain
        own = self.penalised_gain(term, gain, first)
        out = []
        for penalised_gain, (other, *_) in self.candidates(rest):
            raw, better = penalised_gain + other.penalty, penalised_gain - own
            weight = math.exp(min(better / doubt, 0.0))
            if is_same_statement(other, term, first) or not self._replaces_term(rest, other, term, gain, raw):
                continue
            if weight > SETTINGS.selection.alternative_weight or raw > gain - similar:
                if not self._has_plausible_values([*rest, other], other):
                    continue
                more = self._nonlinear_gain_difference(rest, other, term)
                raw, better = raw + more, better + more
                weight = math.exp(min(better / doubt, 0.0))
            one = Alternative(
                f"{FAULT.name}:{other.wheel}" if other.ramp else other.effect, other.effect, weight
            )
            if not (other.nonparametric or other.effect == term.effect or other.calibrates):
                if divided and raw < gain - similar:
                    one = self._alternative_to_part(rest, other, term, gain, alone, better - raw, doubt, one)
                elif raw > gain - similar:
                    one = replace(one, replaces_by=raw)
            out.append(one)
        return out

    def _nonlinear_gain_difference(self, rest: list[Term], alternative: Term, term: Term) -> float:
        """Return an alternative's gain by nonlinearity less that of the term, nats; 0 for a spline term.

        Gain by nonlinearity is that of the exact response less that of the linear one.
        """
        if alternative.nonparametric or term.nonparametric:
            return 0.0
        return self.beyond([*rest, alternative]) - self.beyond([*rest, term])

    def _replaces_term(
        self, rest: list[Term], alternative: Term, term: Term, gain: float, raw: float
    ) -> bool:
        """Return whether an alternative explains what a term does, with possible values."""
        elsewhere = raw > SETTINGS.selection.independent_share * gain and self._is_independent(
            [*rest, alternative], term, gain
        )
        return not elsewhere and self._has_possible_ratios([*rest, alternative])

    def _alternative_to_part(
        self,
        rest: list[Term],
        alternative: Term,
        term: Term,
        gain: float,
        alone: FloatArray,
        penalties: float,
        doubt: float,
        one: Alternative,
    ) -> Alternative:
        """Return the alternative to one of a term's two values, where the other may stay beside it and the
        name hold for that alone. `penalties` (nats) are the difference of both penalties and handicaps."""
        similar = max(SETTINGS.selection.confounded_nats, SETTINGS.selection.confounded_share * gain)
        parts = self.gains_of_parts([*rest, alternative], term)
        both = float(parts.max()) + self.gain([*rest, alternative]) - self.gain(rest)
        if both <= gain - similar:
            return one
        rests = dependent_fraction(gain, float(alone[np.argmax(parts)]))
        better = penalties + both - term.penalty / term.design.shape[1]
        whole = both if rests >= SETTINGS.selection.independent_share else 0.0
        return replace(
            one,
            part_weight=rests * math.exp(min(better / doubt, 0.0)),
            replaces_by=whole if whole > gain - similar else None,
        )
