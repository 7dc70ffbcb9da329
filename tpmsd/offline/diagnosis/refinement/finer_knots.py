"""Gives a shape that was found the knots that it needs.

In: a chosen smooth term on its usual few knots. Out: knots by which the data say more than the further
heights cost, and the responses of their hats. A shape that is too coarse leaves a residue at which other
effects, which are not there, find something to explain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.diagnosis.hypotheses.penalties import spline_penalty
from tpmsd.offline.diagnosis.hypotheses.response import READINGS, finer_knots, first_hat, hat_functions
from tpmsd.offline.diagnosis.hypotheses.terms import ANTISYMMETRIC, Term
from tpmsd.offline.diagnosis.prepared.drive_regression import HatFunction, Refined
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import Evidence, gain_of

Columns = list[tuple[Refined, dict[int, FloatArray]]]


@dataclass(frozen=True)
class Shape:
    """Finer knots for a smooth term, and the columns that are missing for them."""

    term: Term
    knots: tuple[float, ...]
    columns: Columns
    """For each of `patterns` in turn the hats that it needs."""
    patterns: tuple[str, ...]
    """Each wheel, or the one reading."""

    def add_to(self, regression: Regression, at: list[int]) -> None:
        """Add the shape to the hypotheses, its columns at these positions of the common index.
        A shape on wheels is one for every pattern of wheels: which of them it was on the few knots need not
        be right on the finer ones.
        """
        hats = len(at) // len(self.patterns)
        columns = {pattern: at[k * hats : (k + 1) * hats] for k, pattern in enumerate(self.patterns)}
        regression.hypotheses.add_shapes(self.term, self.knots, columns, len(regression.drives))


def finest_shape(regression: Regression, term: Term) -> Shape:
    """Return the finest shape instead of a term."""
    return _shape_with_knots(regression, term, _finest_knots(regression, term))


def finer_shape(regression: Regression, evidence: Evidence, others: list[Term], term: Term) -> Shape | None:
    """Return the spline on its best knots, others fixed; None if its gain is not better."""
    selector = Selector(evidence, regression.hypotheses)
    if len(_finest_knots(regression, term)) < 4:
        return None
    found = best_knots(regression, selector.design(others), term)
    least = selector.gain([*others, term]) - found.without - term.penalty + SETTINGS.refinement.finer_nats
    return None if found.score <= least else _shape_with_knots(regression, term, found.at)


@dataclass(frozen=True)
class Knots:
    """The knots of a shape on which it brings most."""

    at: FloatArray
    """(k,)"""
    score: float
    """Gain beyond the design, less the penalty of its heights (nats)."""
    without: float
    """Gain of the design alone."""


def best_knots(regression: Regression, design: FloatArray, term: Term) -> Knots:
    """Return the best of some spacings of knots for a term, beside a design."""
    acting = regression.acting_drives(term)
    fine = _finest_knots(regression, term)
    first = _first_hat(term)
    std = _covariate_std(regression, term)
    hats = [HatFunction(term.pattern, term.covariate, tuple(fine), k, std) for k in range(len(fine))]
    gram = np.zeros((1 + design.shape[1] + len(hats),) * 2)
    for number, drive in enumerate(regression.drives):
        rows = np.zeros((*drive.white.shape[:2], len(gram)))
        rows[:, :, 0] = drive.white[:, :, 0]
        rows[:, :, 1 : 1 + design.shape[1]] = drive.whitened_design(design)
        if number in acting:
            columns = np.nan_to_num(np.stack([hat.column(drive.reader) for hat in hats], axis=2))
            rows[:, :, 1 + design.shape[1] :] = drive.whitened(columns)
        flat = rows.reshape(-1, len(gram))
        gram += flat.T @ flat
    without = gain_of(gram[: 1 + design.shape[1], : 1 + design.shape[1]])
    best = Knots(fine, -np.inf, without)
    for level in SETTINGS.refinement.levels:
        intervals = min(len(fine) - 1, level * (len(fine) - 1) // SETTINGS.hypotheses.finer)
        at = np.unique(np.round(np.linspace(0, len(fine) - 1, intervals + 1)).astype(int))
        # A coarse hat is a sum of fine ones.
        combined = hat_functions(fine, fine[at])[:, first:]
        wide = np.zeros((len(gram), 1 + design.shape[1] + combined.shape[1]))
        wide[: 1 + design.shape[1], : 1 + design.shape[1]] = np.eye(1 + design.shape[1])
        wide[1 + design.shape[1] :, 1 + design.shape[1] :] = combined
        score = gain_of(wide.T @ gram @ wide) - without - spline_penalty(combined.shape[1])
        if score > best.score:
            best = Knots(fine[at], score, without)
    return best


def _finest_knots(regression: Regression, term: Term) -> FloatArray:
    """Return the finest knots (k,) that a term's covariate allows."""
    drives = [regression.drives[number] for number in regression.acting_drives(term)]
    values = np.concatenate([drive.reader.windows.covariates[term.covariate] for drive in drives])
    return finer_knots(
        values,
        SETTINGS.hypotheses.finer * (len(regression.knots(term)) - 1),
        _covariate_std(regression, term),
    )


def _covariate_std(regression: Regression, term: Term) -> float:
    """Return the largest standard deviation of the error of a term's covariate, over drives."""
    return max(
        regression.drives[number].stds.get(term.covariate, 0.0) for number in regression.acting_drives(term)
    )


def _first_hat(term: Term) -> int:
    """Return the number of the first hat function that a term needs."""
    return 1 if term.pattern in ANTISYMMETRIC else first_hat(term.pattern)


def _shape_with_knots(regression: Regression, term: Term, knots: FloatArray) -> Shape:
    """Return a term's shape on these knots, with the columns of every wheel or of its reading."""
    acting = regression.acting_drives(term)
    read = set.intersection(*(set(regression.drives[number].reader.recording.wheels) for number in acting))
    patterns = (term.pattern,) if term.pattern in READINGS else tuple(WHEELS[wheel] for wheel in sorted(read))
    at = tuple(float(x) for x in knots)
    columns: Columns = []
    for pattern in patterns:
        for k in range(first_hat(pattern), len(at)):
            hat = HatFunction(pattern, term.covariate, at, k, _covariate_std(regression, term))
            response = {n: np.nan_to_num(hat.column(regression.drives[n].reader)) for n in acting}
            columns.append((Refined(hat=hat), response))
    return Shape(term, at, columns, patterns)
