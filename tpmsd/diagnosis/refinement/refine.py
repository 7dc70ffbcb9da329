"""Refines what enters nonlinearly: when a radius began to change and for how long, and how slowly tyres warm
up.

In: the chosen terms on their grids. Out: the same terms with exact columns, and the standard deviations
of the nonlinear parameters by the curvature of the profile likelihood. All trial columns are whitened in
one pass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.diagnosis.hypotheses.response import ramp_knots
from tpmsd.diagnosis.hypotheses.terms import Term, for_drive, numbers_of, wheels_of
from tpmsd.diagnosis.prepared.drive_study import Refined
from tpmsd.diagnosis.prepared.study import Study
from tpmsd.diagnosis.refinement.finer import Shape, best_knots, finer_shape, finest_shape
from tpmsd.diagnosis.selection.chosen import Selection
from tpmsd.diagnosis.selection.selector import Selector
from tpmsd.diagnosis.settings import SETTINGS
from tpmsd.inference.least_squares import Evidence
from tpmsd.wheels import FloatArray


@dataclass(frozen=True)
class Point:
    """A trial of a term's nonlinear parameters."""

    first: float
    """Middle of a ramp (s), begin of a pulse (s) or value of the parameter that enters nonlinearly."""
    second: float = 0.0
    """Duration of a ramp (s), end of a pulse (s)."""


def refine(study: Study, selection: Selection, evidence: Evidence, again: bool) -> bool:
    """Give the study exact columns for the terms that have nonlinear parameters; whether there are any.

    They are hypotheses like all others from then on, beside those on the grid. With `again` those that are
    exact are refined once more.
    """
    terms = [one.term for one in selection.chosen]
    added: list[tuple[Term, Point]] = []
    columns: list[tuple[Refined, dict[int, FloatArray]]] = []
    for k, term in enumerate(terms):
        if term.ramp or term.pulse or term.at is not None:
            if not again and int(np.flatnonzero(term.design[:, 0])[0]) >= study.grid:
                continue
            others = [other for j, other in enumerate(terms) if j != k]
            design = Selector(evidence, study.hypotheses).design(others)
            # A term's further values are fitted along, where they stand.
            design = np.concatenate([design, term.design[:, 1:]], axis=1)
            point, column = _best(study, evidence, design, term)
            added.append((term, point))
            columns.append((_refined(term, point), column))
    shapes = [] if study.simulation else _shapes(study, evidence, terms)
    places = study.append([*columns, *(column for shape in shapes for column in shape.columns)])
    at = len(columns)
    for shape in shapes:
        shape.add_to(study, places[at : at + len(shape.columns)])
        at += len(shape.columns)
    for (term, point), place in zip(added, places[: len(columns)], strict=True):
        _add(study, term, point, place)
    return bool(added or shapes)


def _add(study: Study, term: Term, point: Point, place: int) -> None:
    """Make a hypothesis of a term at a point off its grid, whose column stands at that place."""
    if term.ramp:
        onset = point.first - point.second / 2
        study.hypotheses.add_ramp(term.wheel, (onset, onset + point.second), place)
    elif term.pulse:
        study.hypotheses.add_pulse(term, (point.first, point.second), place)
    else:
        study.hypotheses.add_off_grid(term, point.first, place)
    _of_its_drive(study, term)


def plainest_shape(study: Study, evidence: Evidence, design: FloatArray) -> Term | None:
    """The term that brings most beyond a design: a spline on its finest knots (over time on the first
    ones), a ramp or a pulse with its exact span; None if none is plain.

    It is a hypothesis like all others from then on.
    """
    hypotheses = study.hypotheses
    gram, b = evidence.projected(design)
    found = (
        hypotheses.ramp_gains(gram, b) + hypotheses.pulse_gains(gram, b) + hypotheses.smooth_gains(gram, b)
    )
    found = sorted(found, key=lambda entry: entry[1].penalty - entry[0])
    gain, term = found[0]
    if gain - term.penalty < SETTINGS.refinement.plain_nats:
        return None
    if study.simulation:
        return term
    if not _is_coarse(term):
        # What a few knots over a covariate do not hold looks like many events: like is compared with like.
        coarse = [one for _, one in found if _is_coarse(one)][: SETTINGS.refinement.compared]
        scores = [best_knots(study, design, one).score for one in coarse]
        if not scores or max(scores) <= gain - term.penalty:
            if not (term.ramp or term.pulse):
                return term
            rivals = [one for _, one in found if one is not term and one.pulse and _same_span(one, term)]
            return exact(study, evidence, design, term, rivals)
        term = coarse[scores.index(max(scores))]
    shape = finest_shape(study, term)
    shape.add_to(study, study.append(shape.columns))
    return next(one for one in hypotheses.catalogue if one.knots == shape.knots and one.key == term.key)


def exact(
    study: Study, evidence: Evidence, design: FloatArray, term: Term, rivals: Sequence[Term] = ()
) -> Term:
    """A ramp or pulse off its grid, and so are the rivals that act on the same wheels and span.

    Knots are up to half a minute off: what a strong event leaves there would pass for noise.
    """
    point, column = _best(study, evidence, design, term)
    (place,) = study.append([(_refined(term, point), column)])
    for one in (*rivals, term):
        _add(study, one, point, place)
    return study.hypotheses.catalogue[-1]


def _same_span(one: Term, other: Term) -> bool:
    return (one.place, one.span_s) == (other.place, other.span_s)


def _of_its_drive(study: Study, term: Term) -> None:
    """Make the hypothesis added last one drive's, if the term that it refines is."""
    if term.drive is not None:
        exact = study.hypotheses.catalogue.pop()
        study.hypotheses.catalogue.append(for_drive(exact, term.drive, len(study.drives)))


def _shapes(study: Study, evidence: Evidence, terms: list[Term]) -> list[Shape]:
    """Finer shapes for the smooth terms that need them.

    Also of the best that was not chosen: on few knots a narrow shape leaves so much in some blocks that its
    heights look unsure.
    """
    asked = [(term, terms[:k] + terms[k + 1 :]) for k, term in enumerate(terms)]
    for _, found in Selector(evidence, study.hypotheses).candidates(terms)[: SETTINGS.refinement.best]:
        if _is_coarse(found[0]):
            asked.append((found[0], terms))
            break
    out = []
    for term, others in asked:
        if _is_coarse(term):
            finer = finer_shape(study, evidence, others, term)
            if finer is not None:
                out.append(finer)
    return out


def _is_coarse(term: Term) -> bool:
    """Over time knots stay as wide as the blocks that are held out: finer ones predict none of them."""
    shape = term.free and not term.pulse and not term.knots
    return shape and term.covariate not in ("time", "distance")


def _refined(term: Term, point: Point) -> Refined:
    if term.ramp:
        onset = point.first - point.second / 2
        return Refined(numbers_of(term.wheel), onset, point.second)
    if term.pulse:
        return Refined(wheels_of(term.place), point.first, point.second, pulse=True)
    return Refined((), point.first, like=term)


def _trials(term: Term, centre: Point, width: Point) -> list[Point]:
    if term.ramp:
        return [
            Point(centre.first + a * width.first, max(0.0, centre.second + b * width.second))
            for a in np.linspace(-1.0, 1.0, 7)
            for b in np.linspace(-1.0, 1.0, 7)
        ]
    if term.pulse:
        return [
            Point(begin := centre.first + a * width.first, max(begin + 2.0, centre.second + b * width.second))
            for a in np.linspace(-1.0, 1.0, 7)
            for b in np.linspace(-1.0, 1.0, 7)
        ]
    return [Point(centre.first * width.first**a) for a in np.linspace(-1.0, 1.0, 11)]


def _best(
    study: Study, evidence: Evidence, design: FloatArray, term: Term
) -> tuple[Point, dict[int, FloatArray]]:
    """The point of greatest likelihood with all linear values of a design fitted along, and its column by
    drive: of several values of the term, the first one's, which the point shapes."""
    design = np.concatenate([design, term.design[:, 1:]], axis=1)
    believed = sum(part.small(design).sum(axis=0) for part in evidence.parts)
    acting = [(number, study.drives[number]) for number in study.acting(term)]
    if term.ramp:
        knots = ramp_knots(acting[0][1].reader)
        step = float(np.median(np.diff(knots)))
        centre = Point(0.5 * (term.span_s[0] + term.span_s[1]), term.span_s[1] - term.span_s[0])
        width = Point(step, max(1.5 * step, 0.3 * centre.second))
    elif term.pulse:
        step = 0.5 * float(np.median(np.diff(ramp_knots(acting[0][1].reader))))
        centre, width = Point(*term.span_s), Point(step, step)
    else:
        grid = term.kind_of.grid
        assert grid is not None
        assert term.at is not None
        centre, width = Point(term.at), Point(grid.step)
    columns: dict[int, FloatArray] = {}
    for _ in range(SETTINGS.refinement.rounds):
        points = _trials(term, centre, width)
        cross, size = np.zeros((len(believed), len(points))), np.zeros(len(points))
        trials = {}
        for number, drive in acting:
            trial = np.stack(
                [_refined(term, point).column(drive.reader, drive.base) for point in points], axis=2
            )
            rows = drive.whitened(trial).reshape(-1, len(points))
            known = np.concatenate([drive.white[:, :, :1], drive.acting(design)], axis=2)
            cross += known.reshape(-1, len(believed)).T @ rows
            size += (rows**2).sum(axis=0)
            trials[number] = trial
        best = int(np.argmax(_gains(believed, cross, size)))
        centre = points[best]
        columns = {number: trial[:, :, best] for number, trial in trials.items()}
        on_grid = term.at is not None
        width = Point(width.first**0.4 if on_grid else width.first / 2.5, width.second / 2.5)
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
