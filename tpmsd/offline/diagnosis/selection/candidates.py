"""Candidates that may be added to the terms chosen so far, the best first.

In: `Evidence` and `Hypotheses`. Out: single terms and pairs, each with its penalised gain. A spline
term must beat an effect by a share of its gain: no effect's formula is the last word.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from tpmsd.car.physics.catalogue import prior_rms
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.group_gain import group_gain
from tpmsd.offline.diagnosis.hypotheses.terms import Hypotheses, Term
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import Evidence, LeastSquaresFit


class Candidates:
    """Looks at all hypotheses beside those chosen."""

    def __init__(
        self,
        evidence: Evidence,
        hypotheses: Hypotheses,
        barred: frozenset[tuple[str, ...]] = frozenset(),
    ) -> None:
        """`barred` are keys of terms that are no candidates."""
        self.evidence = evidence
        self.hypotheses = hypotheses
        self._barred = barred
        self._gains: dict[tuple[Term, ...], float] = {}
        self._found: dict[tuple[Term, ...], list[tuple[float, list[Term]]]] = {}
        """Cached requests: the steps of a search ask for much of it again."""
        self._last_projected: tuple[tuple[Term, ...], tuple[FloatArray, FloatArray]] | None = None

    def design(self, terms: Sequence[Term]) -> FloatArray:
        """Return the design (1 + p, k) of calibration and these terms."""
        return np.concatenate([self.hypotheses.nuisance, *(term.design for term in terms)], axis=1)

    def fit_for_values(self, terms: Sequence[Term], of: Term, more: Sequence[str] = ()) -> LeastSquaresFit:
        """Return the fit from which a term's values are reported: jointly with the usual effects of every
        car, and with `more` effects, by name. The terms' values are at the indices of their own fit."""
        usual = {*of.kind_of.confounding.estimated_jointly_with, *more}
        joint = usual - {term.effect for term in terms}
        by_effect: dict[str, Term] = {}
        for t in self.hypotheses.catalogue:
            if t.effect in joint and t.drive is None:
                by_effect[t.effect] = max(by_effect.get(t.effect, t), t, key=lambda one: len(one.parameters))
        usual_terms = list(by_effect.values())
        fit = self.evidence.fit(self.design([*terms, *usual_terms]))
        first = fit.design.shape[1] - sum(t.design.shape[1] for t in usual_terms)
        stds = [prior_rms(t.kind_of, name) for t in usual_terms for name in t.parameters]
        for column, std in enumerate(stds, first):
            fit = fit.known(column, std)
        return fit

    def gain(self, terms: Sequence[Term]) -> float:
        """Return the log-likelihood (nats) of calibration and these terms at their best values."""
        key = tuple(terms)
        if key not in self._gains:
            self._gains[key] = self.evidence.fit(self.design(terms)).gain
        return self._gains[key]

    def gains_of_parts(self, terms: Sequence[Term], term: Term) -> FloatArray:
        """Return the (k,) log-likelihood gains of single values of a term, jointly with calibration and these
        terms."""
        columns = (term.design[:, k : k + 1] for k in range(term.design.shape[1]))
        designs = [np.concatenate([self.design(terms), column], axis=1) for column in columns]
        return np.array([self.evidence.fit(design).gain for design in designs]) - self.gain(terms)

    def _margin(self, terms: Sequence[Term]) -> float:
        """Return the log-likelihood (nats) of calibration and terms, less the terms' penalties."""
        return self.gain(terms) - sum(term.penalty for term in terms)

    def _first_value(self, terms: Sequence[Term], which: int) -> float:
        """Return the first value of one of the terms in the joint fit."""
        start = self.hypotheses.nuisance.shape[1] + sum(t.design.shape[1] for t in terms[:which])
        return float(self.evidence.fit(self.design(terms)).values[start])

    def heldout(self, terms: Sequence[Term]) -> float:
        """Return the log-likelihood (nats) of calibration and these terms on held-out blocks."""
        return float(self.evidence.heldout(self.design(terms)).sum())

    def variance_ratio(self, terms: Sequence[Term], which: int) -> float:
        """Return the block-wise over the assumed variance of one of the terms' values (the largest), from 1
        to the limit."""
        fit = self.evidence.fit(self.design(terms))
        start = self.hypotheses.nuisance.shape[1] + sum(t.design.shape[1] for t in terms[:which])
        ratios = self.evidence.sandwich(fit)[start : start + terms[which].design.shape[1]]
        return float(np.clip(np.max(ratios), 1.0, SETTINGS.selection.max_overdispersion))

    def studentised_gain(self, chosen: Sequence[Term], term: Term, penalised_gain: float) -> float:
        """Return a penalised gain jointly with the chosen terms, its gain divided by the term's block-wise
        variance ratio.
        """
        return (penalised_gain + term.penalty) / self.variance_ratio(
            [*chosen, term], len(chosen)
        ) - term.penalty

    def score(self, rest: Sequence[Term], term: Term) -> float:
        """Return the penalised gain (nats) of a term beside the rest, as `candidates` has it."""
        terms = [*rest, term]
        return self.penalised_gain(
            term, self.gain(terms) - self.gain(rest), self._first_value(terms, len(rest))
        )

    def candidates(self, chosen: Sequence[Term]) -> list[tuple[float, list[Term]]]:
        """Return (penalised gain, terms) of each addition to the chosen terms, the best first."""
        key = tuple(chosen)
        if key not in self._found:
            self._found[key] = self._find_candidates(chosen)
        return self._found[key]

    def _find_candidates(self, chosen: Sequence[Term]) -> list[tuple[float, list[Term]]]:
        """Return the additions to the chosen terms with their penalised gains, the best first, without
        cache."""
        gram, b = self._projected(chosen)
        taken = {term.key for term in chosen} | self._barred
        own, total = np.diag(gram), np.diag(self.evidence.total)[1:]
        free = [term for term in self.hypotheses.catalogue if term.key not in taken]
        out: list[tuple[float, list[Term]]] = []
        usable = []
        for term in free:
            rows, _ = term.nonzero_rows
            if np.any(own[rows] < SETTINGS.selection.min_own_share * total[rows]):
                continue
            usable.append(term)
            gain, first = term.gain(gram, b)
            out.append((self.penalised_gain(term, gain, first), [term]))
        shapes = self.hypotheses.pulse_gains(gram, b) + self.hypotheses.smooth_gains(gram, b)
        scanned = self.hypotheses.ramp_gains(gram, b)
        scanned += [
            ((1.0 - handicap(one)) * brings if one.nonparametric else brings, one) for brings, one in shapes
        ]
        out += [(brings - one.penalty, [one]) for brings, one in scanned if one.key not in taken]
        return sorted(out, key=lambda entry: -entry[0])

    def _projected(self, terms: Sequence[Term]) -> tuple[FloatArray, FloatArray]:
        """Return Gram matrix and correlation of all columns with calibration and terms projected out; the
        last ones are cached."""
        key = tuple(terms)
        if self._last_projected is None or self._last_projected[0] != key:
            self._last_projected = key, self.evidence.projected(self.design(terms))
        return self._last_projected[1]

    def best_pairs(self, chosen: Sequence[Term]) -> list[tuple[float, list[Term]]]:
        """Return (penalised gain, terms) of the best pairs of the catalogue's single-value terms, the best
        first."""
        gram, b = self._projected(chosen)
        taken = {term.key for term in chosen}
        total = np.diag(self.evidence.total)[1:]
        single = [t for t in self.hypotheses.catalogue if t.key not in taken and t.design.shape[1] == 1]
        at = np.array([int(np.argmax(np.abs(t.design[1:, 0]))) for t in single])
        if len(at) < 2:
            return []
        d = np.diag(gram)[at]
        good = d > SETTINGS.selection.min_own_share * total[at]
        at, single, d = at[good], [t for t, g in zip(single, good, strict=True) if g], d[good]
        G = gram[np.ix_(at, at)]
        det = np.outer(d, d) - G**2
        score = b[at]
        number = (
            (score**2)[:, None] * d[None, :]
            - 2 * np.outer(score, score) * G
            + (score**2)[None, :] * d[:, None]
        )
        gain = np.where(
            det > 1e-4 * np.outer(d, d), 0.5 * number / np.maximum(det, 1e-30 + 1e-4 * np.outer(d, d)), 0.0
        )
        numbers: dict[tuple[str, ...], int] = {}
        key = np.array([numbers.setdefault(t.key, len(numbers)) for t in single], dtype=int)
        penalties = np.array([t.penalty for t in single])
        first, second = np.nonzero(np.triu(key[:, None] != key, 1))
        gains = gain[first, second] - (penalties[first] + penalties[second])
        best = np.argsort(-gains, kind="stable")[: SETTINGS.selection.best_pairs]
        return [(float(gains[k]), [single[first[k]], single[second[k]]]) for k in best]

    def pairs_over(self, covariate: str, chosen: Sequence[Term]) -> list[tuple[float, list[Term]]]:
        """Return (penalised gain, terms) of pairs of effects that show over a covariate, the best first."""
        gram, b = self._projected(chosen)
        taken = {term.key for term in chosen}
        over = [
            term
            for term in self.hypotheses.catalogue
            if not term.nonparametric
            and term.kind_of.identification.shows_in[1] == covariate
            and term.key not in taken
        ]
        out = []
        for one, other in itertools.combinations(over, 2):
            if one.key != other.key:
                both = np.concatenate([one.design[1:], other.design[1:]], axis=1)
                gain, _ = group_gain(both, gram, b)
                out.append((gain - one.penalty - other.penalty, [one, other]))
        return sorted(out, key=lambda entry: -entry[0])

    def best_candidates(self, chosen: list[Term]) -> list[tuple[float, list[Term]]]:
        """Return the six best candidates, and the best of each other effect above the threshold."""
        every = self.candidates(chosen)
        out, met = every[:6], {terms[0].effect for _, terms in every[:6]}
        for penalised_gain, terms in every[6:]:
            if penalised_gain > SETTINGS.selection.admit_nats and terms[0].effect not in met:
                met.add(terms[0].effect)
                out.append((penalised_gain, terms))
        return out

    @staticmethod
    def penalised_gain(term: Term, gain: float, first: float) -> float:
        """Return a term's gain less its penalty (nats), and that of a spline term less its handicap."""
        if not term.nonparametric:
            return gain - likeliest_penalty(term, gain, first)
        return (1.0 - handicap(term)) * gain - term.total_penalty(first)


def likeliest_penalty(term: Term, gain: float, first: float) -> float:
    """Return the least sum of an effect's penalty and lost gain (nats), over values from the fitted one
    towards zero."""
    if len(term.parameters) > 1:
        return term.total_penalty(first)
    shares = SETTINGS.selection.nearer_shares
    return min(term.total_penalty(first * (1.0 - u)) + gain * u**2 for u in shares)


def handicap(shape: Term) -> float:
    """Return the fraction of its gain by which a spline term must exceed an effect."""
    drift = shape.pattern == "all" and shape.covariate in ("time", "distance")
    return SETTINGS.selection.drift_gain_margin if drift else SETTINGS.selection.spline_gain_margin


def dependent_fraction(gain: float, kept: float) -> float:
    """Return the share (0 to 1) of an effect's confidence that an alternative could take from it.

    That is the part which the alternative replaces; `kept` of the `gain` does not depend on it.
    """
    return min(1.0, (1.0 - kept / gain) / SETTINGS.selection.independent_share)
