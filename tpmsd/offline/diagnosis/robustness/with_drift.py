"""Refines changes of radii and the radius drift jointly.

In: a regression of one drive and terms. Out: the regression with exact ramps and the drift that is likeliest
jointly with them, and the terms.

A ramp that is some seconds off leaves a residual that passes for drift, and beside much drift its likeliest
course is another one: single steps between the two end at a local maximum. So both are fitted in turn until
the likelihood rises no more, from the drift that was estimated and from the usual one, and the likelier
end counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from tpmsd.offline.diagnosis.assessment.simulated import widened_design
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.refinement.refine import exact_term
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.noise import Noise, with_usual_drift
from tpmsd.offline.inference.noise_fit import NEAR_NATS, RADIUS_DRIFT, log_posterior, refit


def fit_ramps_with_drift(regression: Regression, terms: Sequence[Term]) -> tuple[Regression, list[Term]]:
    """Return the regression with its ramps exact under the likeliest drift, and the terms; both unchanged
    where there is no ramp or more than one drive."""
    if len(regression.drives) > 1 or not any(term.ramp for term in terms):
        return regression, list(terms)
    noise = regression.drives[0].noise
    starts = [noise]
    if noise.radius_drift >= SETTINGS.robustness.drifts_from:
        starts.append(with_usual_drift(noise))
    ends = [_fit_in_turn(regression, terms, start) for start in starts]
    _, found, refined = max(ends, key=lambda end: end[0])
    return found, refined


def _fit_in_turn(
    regression: Regression, terms: Sequence[Term], start: Noise
) -> tuple[float, Regression, list[Term]]:
    """Return the log posterior, the regression and the terms where ramps and drift are fitted in turn from a
    noise."""
    regression, now, before = regression.copied().with_noise({0: start}), list(terms), -math.inf
    best = (-math.inf, regression, now)
    for _ in range(SETTINGS.refinement.drift_rounds):
        regression, now = _exact_ramps(regression, now)
        drive = regression.drives[0]
        windows = drive.reader.windows
        columns = drive.data_and_design(Selector(regression.evidence(), regression.hypotheses).design(now))
        noise = refit(windows, columns, drive.noise, drive.inflate, RADIUS_DRIFT)
        score = log_posterior(windows, columns, noise, drive.inflate)
        regression = regression.with_noise({0: noise})
        if score > best[0]:
            best = (score, regression, now)
        if score - before < NEAR_NATS:
            break
        before = score
    return (best[0], best[1], [as_wide_as(best[1], term) for term in best[2]])


def _exact_ramps(regression: Regression, terms: Sequence[Term]) -> tuple[Regression, list[Term]]:
    """Return the regression with a column for each ramp at its likeliest course under the present noise, one
    after the other."""
    now, regression = list(terms), regression.copied()
    for k, term in enumerate(now):
        if term.ramp:
            evidence = regression.evidence()
            others = Selector(evidence, regression.hypotheses).design([*now[:k], *now[k + 1 :]])
            now[k] = exact_term(regression, evidence, others, term)
            now = [as_wide_as(regression, one) for one in now]
    return regression, now


def as_wide_as(regression: Regression, term: Term) -> Term:
    """Return the term with a row for each of a regression's columns, those that it has not at zero."""
    return replace(term, design=widened_design(term.design, regression.hypotheses.width))
