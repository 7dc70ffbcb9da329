"""Refines what enters nonlinearly: when a radius began to change and for how long, and how slowly tyres warm
up.

In: the chosen terms on their grids. Out: the same terms with exact columns, and the standard deviations
of the nonlinear parameters by the curvature of the profile likelihood. All trial columns are whitened in
one pass.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tpmsd.diagnosis.evidence import Evidence
from tpmsd.diagnosis.response import ramp_column, thermal_column
from tpmsd.diagnosis.selection import Selection, Selector
from tpmsd.diagnosis.terms import Term
from tpmsd.diagnosis.whitening import whiten
from tpmsd.wheels import WHEELS, FloatArray

if TYPE_CHECKING:
    from tpmsd.diagnosis.diagnose import Study

ROUNDS = 4


@dataclass(frozen=True)
class Point:
    """A trial of a term's nonlinear parameters."""

    first: float
    """Middle of a ramp (s) or time constant (s)."""
    second: float = 0.0
    """Duration of a ramp (s)."""


def refine(study: Study, selection: Selection, evidence: Evidence) -> bool:
    """Give the study exact columns for the terms that have nonlinear parameters; whether there are any.

    They are hypotheses like all others from then on, beside those on the grid.
    """
    terms = [one.term for one in selection.chosen]
    added, columns = [], []
    for k, term in enumerate(terms):
        if term.effect in ("radius_change", "thermal_growth"):
            others = [other for j, other in enumerate(terms) if j != k]
            point, column = _best(study, evidence, others, term)
            added.append((term, point))
            columns.append(column[:, :, None])
    study.columns = np.concatenate([study.columns, *columns], axis=2)
    width = study.columns.shape[2]
    study.hypotheses.widen(width)
    for k, (term, point) in enumerate(added):
        column_at = width - len(added) + k
        if term.effect == "radius_change":
            onset = point.first - point.second / 2
            study.hypotheses.add_ramp(term.wheel, (onset, onset + point.second), column_at)
        else:
            study.hypotheses.add_thermal(point.first, column_at)
    return bool(added)


def _column(study: Study, term: Term, point: Point) -> FloatArray:
    if term.effect == "radius_change":
        onset = point.first - point.second / 2
        return ramp_column(study.reader, WHEELS.index(term.wheel), onset, point.second)
    return thermal_column(study.reader, point.first)


def _trials(term: Term, centre: Point, width: Point) -> list[Point]:
    if term.effect == "radius_change":
        return [
            Point(centre.first + a * width.first, max(0.0, centre.second + b * width.second))
            for a in np.linspace(-1.0, 1.0, 7)
            for b in np.linspace(-1.0, 1.0, 7)
        ]
    return [Point(centre.first * width.first**a) for a in np.linspace(-1.0, 1.0, 11)]


def _best(study: Study, evidence: Evidence, others: list[Term], term: Term) -> tuple[Point, FloatArray]:
    """The point of greatest likelihood with all linear values fitted along, and its column."""
    selector = Selector(evidence, study.hypotheses)
    design = selector.design(others)
    believed = study.believed(design)
    if term.effect == "radius_change":
        step = float(np.median(np.diff(study.hypotheses.knots_s)))
        centre = Point(0.5 * (term.span_s[0] + term.span_s[1]), term.span_s[1] - term.span_s[0])
        width = Point(step, max(1.5 * step, 0.3 * centre.second))
    else:
        centre, width = Point(term.time_constant_s), Point(1.4)
    column = _column(study, term, centre)
    for _ in range(ROUNDS):
        points = _trials(term, centre, width)
        trial = np.stack([_column(study, term, point) for point in points], axis=2)
        white, _ = whiten(
            study.reader.windows,
            study.noise,
            np.concatenate([believed, trial], axis=2),
            study.inflate,
        )
        best = int(np.argmax(_gains(white, believed.shape[2])))
        centre, column = points[best], trial[:, :, best]
        width = Point(
            width.first / 2.5 if term.effect == "radius_change" else width.first**0.4, width.second / 2.5
        )
    return centre, column


def _gains(white: FloatArray, known: int) -> FloatArray:
    """Gain of each trial column beyond the believed ones."""
    rows = white.reshape(-1, white.shape[2])
    scale = np.sqrt(np.maximum((rows**2).sum(axis=0), 1e-300))
    rows = rows / scale
    X, trial, y = rows[:, 1:known], rows[:, known:], rows[:, 0]
    if X.shape[1]:
        A = X.T @ X + 1e-9 * np.eye(X.shape[1])
        y = y - X @ np.linalg.solve(A, X.T @ y)
        trial = trial - X @ np.linalg.solve(A, X.T @ trial)
    size = np.maximum((trial**2).sum(axis=0), 1e-9)
    return np.asarray(0.5 * (trial.T @ y) ** 2 / size * scale[0] ** 2)
