"""Search for the closed form that takes the place of what has no name.

In: a `Regression` and its `Selection`. Out: `Proposal`s: the expressions over covariates that bring most on
held-out blocks where the unnamed terms are taken out, each on the wheels or the reading that suits it best.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.diagnosis.assessment.result import Proposal
from tpmsd.offline.diagnosis.hypotheses.response import READINGS, response_at
from tpmsd.offline.diagnosis.hypotheses.terms import ANTISYMMETRIC, PATTERNS, Term
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.proposal.expressions import Expression, expressions, shaped_expressions
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.diagnosis.selection.empirical import pattern_text
from tpmsd.offline.diagnosis.settings import SETTINGS


@dataclass(frozen=True)
class Sums:
    """Products of the data, the columns that stay and one trial column, by fold."""

    known: FloatArray
    """(folds, 1 + k, 1 + k)"""
    cross: FloatArray
    """(folds, 1 + k, t)"""
    size: FloatArray
    """(folds, t)"""


def proposals(regression: Regression, selection: Selection) -> tuple[Proposal, ...]:
    """Return the best closed forms for the unnamed spline terms, each over other covariates than those before
    it; empty without such terms.
    Where a simulation takes the rolling model's place, a form acts in the recording alone; the simulation's
    windows hold what both have in common.
    """
    unnamed = [one.term for one in selection.chosen if one.term.nonparametric and not one.term.pulse]
    if not unnamed:
        return ()
    stay = [one.term.design for one in selection.chosen if one.term not in unnamed]
    design = np.concatenate([regression.hypotheses.nuisance, *stay], axis=1)
    best: list[Proposal] = []
    over = sorted({term.covariate for term in unnamed})
    for _, one in sorted(
        _predictive_forms(regression, design, _patterns_to_try(unnamed, regression), over),
        key=lambda each: each[0],
    ):
        if all(set(one.covariates) != set(other.covariates) for other in best):
            best.append(one)
    return tuple(best[: SETTINGS.report.proposals])


def _predictive_forms(
    regression: Regression, design: FloatArray, patterns: Sequence[str], over: Sequence[str]
) -> list[tuple[float, Proposal]]:
    """Return every closed form and wheel pattern with a positive held-out gain jointly with a design, and its
    sort key.
    Forms with numbers of their own are tried over the covariates of the unnamed terms.
    """
    drives = regression.drives
    names = set.intersection(*(set(drive.reader.windows.covariates) for drive in drives))
    forms = expressions(sorted(names))
    for name in over:
        if name in names:
            values = [drive.reader.windows.covariates[name] for drive in regression.examined]
            forms += shaped_expressions(name, np.concatenate(values))
    found: list[tuple[float, Proposal]] = []
    for pattern in patterns:
        sums = [
            _products_by_fold(drive, design, pattern, forms, acts=drive in regression.examined)
            for drive in drives
        ]
        total = Sums(
            sum((one.known for one in sums[1:]), sums[0].known),
            sum((one.cross for one in sums[1:]), sums[0].cross),
            sum((one.size for one in sums[1:]), sums[0].size),
        )
        found += [
            (proposal_sort_key(form, one), one)
            for k, form in enumerate(forms)
            if total.size[:, k].all() and (one := fitted_proposal(total, k, form, pattern)).heldout_gain > 0.0
        ]
    return found


def proposal_sort_key(form: Expression, one: Proposal) -> float:
    """Return the sort key of a proposal: the penalty of its covariates and numbers less its held-out gain,
    nats."""
    values = len(form.covariates) + len(form.numbers)
    return SETTINGS.hypotheses.per_value_nats * values - one.heldout_gain


def _patterns_to_try(unnamed: list[Term], regression: Regression) -> list[str]:
    """Return the readings of the unnamed terms, and all patterns of the wheels that are read if some terms
    act on wheels."""
    readings = [term.pattern for term in unnamed if term.pattern in READINGS]
    if len(readings) == len(unnamed):
        return sorted(set(readings))
    read = [set(drive.reader.recording.wheels) for drive in regression.drives]
    here = {WHEELS[wheel] for wheel in set.intersection(*read)}
    similar = [name for name, members in PATTERNS.items() if set(members) <= here]
    apart = [name for name, members in ANTISYMMETRIC.items() if {wheel for wheel, _ in members} <= here]
    return [*sorted(set(readings)), *similar, *apart]


def _products_by_fold(
    drive: DriveRegression, design: FloatArray, pattern: str, forms: list[Expression], acts: bool
) -> Sums:
    """Return one drive's products of data, design and trial columns; `acts` is False where no form acts in
    it."""
    signs: Mapping[str, float] = dict(ANTISYMMETRIC.get(pattern, ())) or dict.fromkeys(PATTERNS[pattern], 1.0)
    response = sum((sign * response_at(drive.reader, one) for one, sign in signs.items()), start=np.zeros(()))
    covariates = drive.reader.windows.covariates
    weights = np.stack([form.values(covariates) for form in forms], axis=1)
    trial = drive.whitened(
        np.asarray(response)[:, :, None] * (weights if acts else 0.0 * weights)[:, None, :]
    )
    known = np.concatenate([drive.white[:, :, :1], drive.whitened_design(design)], axis=2)
    fold = drive.blocks % SETTINGS.report.folds
    parts = [fold == number for number in range(SETTINGS.report.folds)]
    return Sums(
        np.stack([np.einsum("wci,wcj->ij", known[p], known[p]) for p in parts]),
        np.stack([np.einsum("wci,wct->it", known[p], trial[p]) for p in parts]),
        np.stack([np.einsum("wct,wct->t", trial[p], trial[p]) for p in parts]),
    )


def fitted_proposal(sums: Sums, which: int, form: Expression, pattern: str) -> Proposal:
    """Return a form fitted to all blocks, with its gain in sample and that on each fold fitted to the
    others."""
    folds, width = len(sums.known), sums.known.shape[1] + 1
    gram = np.zeros((folds, width, width))
    gram[:, :-1, :-1] = sums.known
    gram[:, :-1, -1] = gram[:, -1, :-1] = sums.cross[:, :, which]
    gram[:, -1, -1] = sums.size[:, which]
    total = gram.sum(axis=0)
    values, covariance = _fit(total)
    gain = _log_likelihood(total, values) - _log_likelihood(total[:-1, :-1], _fit(total[:-1, :-1])[0])
    heldout = 0.0
    for part in gram:
        rest = total - part
        heldout += _log_likelihood(part, _fit(rest)[0]) - _log_likelihood(
            part[:-1, :-1], _fit(rest[:-1, :-1])[0]
        )
    return Proposal(
        name=form.name,
        formula=form.formula,
        covariates=form.covariates,
        unit=form.unit,
        on=pattern_text(pattern),
        coefficient=float(values[-1]),
        std=float(np.sqrt(covariance[-1, -1])),
        gain=gain,
        heldout_gain=heldout,
    )


def _fit(gram: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return least-squares values (k,) of the first column on the others, and their covariance (k, k)."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram)[1:], 1e-300))
    A = gram[1:, 1:] * np.outer(scale, scale) + SETTINGS.robustness.ridge * np.eye(len(scale))
    inverse = np.linalg.inv(A) * np.outer(scale, scale)
    return inverse @ gram[1:, 0], inverse


def _log_likelihood(gram: FloatArray, values: FloatArray) -> float:
    """Return the log-likelihood (nats, but for a constant) of the first column given these values of the
    others."""
    left = np.concatenate([[1.0], -values])
    return float(-0.5 * left @ gram @ left)
