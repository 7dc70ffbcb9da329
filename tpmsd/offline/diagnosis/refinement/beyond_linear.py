"""Removes terms that only explain the linearisation error of the others.

In: a `Regression` and its `Selection`. Out: what is significant jointly with the exact response of the
others, and how sure it is against alternatives that act exactly.

A lag of 0.3 s is a shift, its linear response the slope: the error is the curvature, and a faint low-pass has
the same. So each term is tested again with the linearisation error of the other terms subtracted from the
data: a score test at the exact null (Gauss-Newton steps with a constant Jacobian).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from tpmsd.car.physics.effect import Effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.selection.catalogue_effect import effect_of
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import Evidence, fitted, gain_of


def prune_by_exact_responses(
    regression: Regression, selection: Selection, evidence: Evidence, last: bool = False
) -> Selection:
    """Return the selection without terms that gain too little beside the others' exact responses.

    Too little is less than the penalty.
    """
    selector = Selector(evidence, regression.hypotheses, last)
    for one in sorted(selection.chosen, key=lambda chosen: chosen.gain)[:-1]:
        others = [other.term for other in selection.chosen if other is not one]
        ratio = selector.variance_ratio([*others, one.term], len(others))
        gain = exact_gain(regression, selector, others, one.term)
        if last and gain / ratio >= one.term.penalty:
            gain = min(gain, _likelihood_ratio(regression, selector, others, one.term))
        if gain / ratio < one.term.penalty:
            return prune_by_exact_responses(regression, selector.selection_of(others), evidence, last)
    selection = _exchange_by_exact_responses(regression, selector, selection)
    if not last or not selection.chosen:
        return selection

    @cache
    def beyond(terms: tuple[Term, ...]) -> float:
        return gain_beyond_linear(regression, selector, terms)

    exact = Selector(evidence, regression.hypotheses, last, lambda terms: beyond(tuple(terms)))
    return exact.selection_of([one.term for one in selection.chosen])


def _exchange_by_exact_responses(
    regression: Regression, selector: Selector, selection: Selection
) -> Selection:
    """Return the selection with effects exchanged for linear equals whose exact responses fit better."""
    chosen = [one.term for one in selection.chosen]
    for one in selection.chosen:
        rest = [term for term in chosen if term is not one.term]
        similar = {
            terms[0].effect: (score, terms[0])
            for score, terms in reversed(selector.candidates(rest))
            if terms[0].effect in one.confounded_with and not (terms[0].ramp or terms[0].pulse)
        }
        if not similar:
            continue
        own = selector.score(rest, one.term)
        beyond = gain_beyond_linear(regression, selector, chosen)
        gains = [
            (gain_beyond_linear(regression, selector, [*rest, term]) - beyond + min(score - own, 0.0), term)
            for score, term in similar.values()
        ]
        gain, term = max(gains, key=lambda entry: entry[0])
        if gain > SETTINGS.selection.exchange_nats:
            return _exchange_by_exact_responses(regression, selector, selector.selection_of([*rest, term]))
    return selection


def gain_beyond_linear(regression: Regression, selector: Selector, terms: Sequence[Term]) -> float:
    """Return the log-likelihood (nats) of terms at their best by the forward model, less that by their linear
    responses."""
    design = selector.design(terms)
    acting = [drive.whitened_design(design) for drive in regression.drives]
    linear = selector.evidence.fit(design)
    values, exact = linear.values, -math.inf
    for _ in range(SETTINGS.refinement.exact_rounds):
        gram = _exact_gram(
            regression, ActingTerms(terms, values[selector.hypotheses.nuisance.shape[1] :]), acting
        )
        values, gain = fitted(gram)
        exact = gain - 0.5 * float(gram[0, 0])
    return exact - linear.gain + 0.5 * float(selector.evidence.total[0, 0])


def _likelihood_ratio(
    regression: Regression, selector: Selector, others: Sequence[Term], term: Term
) -> float:
    """Return the log-likelihood (nats) of others and a term over that of the others alone, where all act by
    the forward model.

    Two terms whose linear responses all but cancel have whatever is left of them at values that are far from
    small, and their exact responses cancel no more.
    """
    gains = [
        selector.gain(terms) + gain_beyond_linear(regression, selector, terms)
        for terms in ([*others, term], list(others))
    ]
    return gains[0] - gains[1]


def exact_gain(regression: Regression, selector: Selector, others: Sequence[Term], term: Term) -> float:
    """Return the log-likelihood gain (nats) of a term beside others that act by the forward model."""
    before = selector.design(others)
    design = np.concatenate([before, term.design], axis=1)
    acting = [drive.whitened_design(design) for drive in regression.drives]
    values = selector.evidence.fit(before).values
    gram = np.zeros((0, 0))
    for _ in range(SETTINGS.refinement.exact_rounds):
        null = ActingTerms(others, values[len(values) - sum(one.design.shape[1] for one in others) :])
        gram = _exact_gram(regression, null, acting)
        values, without = fitted(gram[: 1 + before.shape[1], : 1 + before.shape[1]])
    return gain_of(gram) - without


def _exact_gram(regression: Regression, null: ActingTerms, acting: Sequence[FloatArray]) -> FloatArray:
    """Return the Gram matrix (1 + k, 1 + k) of the data less the linearisation error of terms, and of
    columns, (w, 9, k) of each drive."""
    size = 1 + acting[0].shape[2]
    gram = np.zeros((size, size))
    for number, drive in enumerate(regression.drives):
        data = drive.white[:, :, :1] - null.whitened_error(regression, number)
        rows = np.concatenate([data, acting[number]], axis=2).reshape(-1, size)
        gram += rows.T @ rows
    return gram


@dataclass(frozen=True)
class ActingTerms:
    """Terms that act by the forward model, and their values."""

    terms: Sequence[Term]
    values: FloatArray
    """(k,)"""

    def whitened_error(self, regression: Regression, number: int) -> FloatArray:
        """Return the (w, 9, 1) whitened linearisation error of the terms in one drive."""
        return regression.drives[number].whitened(self.unwhitened_error(regression, number)[:, :, None])

    def unwhitened_error(self, regression: Regression, number: int) -> FloatArray:
        """Return the (w, 9) linearisation error of the terms in one drive, in the channels' units."""
        drive, at = regression.drives[number], 0
        effects: list[Effect] = []
        linear = np.zeros(regression.width)
        for term in self.terms:
            values = self.values[at : at + term.design.shape[1]]
            at += len(values)
            made = effect_of(term, values) if number in regression.acting_drives(term) else None
            if made is not None:
                effects.append(made[0])
                linear += term.design @ made[1]
        return _linearisation_error(drive, ExtendedModel(tuple(effects)), linear)


def _linearisation_error(drive: DriveRegression, model: ExtendedModel, linear: FloatArray) -> FloatArray:
    """(w, 9) prediction of a model less the sum of its columns, whose values (1 + p,) are `linear`."""
    more = drive.own_design(linear[:, None])[1:, 0]
    more[: len(drive.values)] -= drive.values
    used = np.flatnonzero(more)
    change = drive.reader.predict(model) - drive.reader.predicted(drive.base)
    return np.nan_to_num(change - drive.columns.take(1 + used) @ more[used])
