"""Refines what enters nonlinearly: when a radius began to change and for how long, and how slowly tyres warm
up.

In: the chosen terms on their grids. Out: the same terms with exact columns, and the standard deviations
of the nonlinear parameters by the curvature of the profile likelihood. All trial columns are whitened in
one pass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.diagnosis.channels import Reader
from tpmsd.diagnosis.evidence import Evidence
from tpmsd.diagnosis.joint_terms import for_drive
from tpmsd.diagnosis.response import ramp_column, ramp_knots, thermal_column
from tpmsd.diagnosis.selection import Selection, Selector
from tpmsd.diagnosis.study import Study
from tpmsd.diagnosis.terms import Term
from tpmsd.wheels import WHEELS, FloatArray

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
    added: list[tuple[Term, Point]] = []
    columns: list[dict[int, FloatArray]] = []
    for k, term in enumerate(terms):
        if term.effect in ("radius_change", "thermal_growth"):
            others = [other for j, other in enumerate(terms) if j != k]
            point, column = _best(study, evidence, others, term)
            added.append((term, point))
            columns.append(column)
    places = study.append(columns)
    for (term, point), place in zip(added, places, strict=True):
        if term.effect == "radius_change":
            onset = point.first - point.second / 2
            study.hypotheses.add_ramp(term.wheel, (onset, onset + point.second), place)
        else:
            study.hypotheses.add_thermal(point.first, place)
        if term.drive is not None:
            exact = study.hypotheses.catalogue.pop()
            study.hypotheses.catalogue.append(for_drive(exact, term.drive, len(study.drives)))
    return bool(added)


def _column(reader: Reader, term: Term, point: Point) -> FloatArray:
    if term.effect == "radius_change":
        onset = point.first - point.second / 2
        return ramp_column(reader, WHEELS.index(term.wheel), onset, point.second)
    return thermal_column(reader, point.first)


def _trials(term: Term, centre: Point, width: Point) -> list[Point]:
    if term.effect == "radius_change":
        return [
            Point(centre.first + a * width.first, max(0.0, centre.second + b * width.second))
            for a in np.linspace(-1.0, 1.0, 7)
            for b in np.linspace(-1.0, 1.0, 7)
        ]
    return [Point(centre.first * width.first**a) for a in np.linspace(-1.0, 1.0, 11)]


def _best(
    study: Study, evidence: Evidence, others: list[Term], term: Term
) -> tuple[Point, dict[int, FloatArray]]:
    """The point of greatest likelihood with all linear values fitted along, and its column by drive."""
    design = Selector(evidence, study.hypotheses).design(others)
    believed = sum(part.small(design).sum(axis=0) for part in evidence.parts)
    acting = [(number, study.drives[number]) for number in study.acting(term)]
    if term.effect == "radius_change":
        knots = ramp_knots(acting[0][1].reader)
        step = float(np.median(np.diff(knots)))
        centre = Point(0.5 * (term.span_s[0] + term.span_s[1]), term.span_s[1] - term.span_s[0])
        width = Point(step, max(1.5 * step, 0.3 * centre.second))
    else:
        centre, width = Point(term.time_constant_s), Point(1.4)
    columns: dict[int, FloatArray] = {}
    for _ in range(ROUNDS):
        points = _trials(term, centre, width)
        cross, size = np.zeros((len(believed), len(points))), np.zeros(len(points))
        trials = {}
        for number, drive in acting:
            trial = np.stack([_column(drive.reader, term, point) for point in points], axis=2)
            rows = drive.whitened(trial).reshape(-1, len(points))
            known = np.concatenate([drive.white[:, :, :1], drive.white @ drive.own(design)], axis=2)
            cross += known.reshape(-1, len(believed)).T @ rows
            size += (rows**2).sum(axis=0)
            trials[number] = trial
        best = int(np.argmax(_gains(believed, cross, size)))
        centre = points[best]
        columns = {number: trial[:, :, best] for number, trial in trials.items()}
        width = Point(
            width.first / 2.5 if term.effect == "radius_change" else width.first**0.4, width.second / 2.5
        )
    return centre, columns


def _gains(believed: FloatArray, cross: FloatArray, size: FloatArray) -> FloatArray:
    """(t,) gain of each trial column beyond the believed ones, from Gram matrices.

    `believed` (1 + k, 1 + k) holds the data first, `cross` (1 + k, t) is with the trials, `size` (t,) their
    squared length.
    """
    scale = 1.0 / np.sqrt(np.maximum(np.diag(believed), 1e-300))
    length = np.sqrt(np.maximum(size, 1e-300))
    gram = believed * np.outer(scale, scale)
    both = cross * scale[:, None] / length
    score, left = both[0], np.ones(len(size))
    if len(believed) > 1:
        A = gram[1:, 1:] + 1e-9 * np.eye(len(gram) - 1)
        solved = np.linalg.solve(A, both[1:])
        score = score - gram[0, 1:] @ solved
        left = left - (both[1:] * solved).sum(axis=0)
    return np.asarray(0.5 * (score / scale[0]) ** 2 / np.maximum(left, 1e-9))
