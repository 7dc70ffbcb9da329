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

from tpmsd.car.physics.catalogue import parameters_of
from tpmsd.car.physics.effect import Parameter, SecondParameter
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.penalties import ramp_penalty
from tpmsd.offline.diagnosis.hypotheses.response import ramp_knots
from tpmsd.offline.diagnosis.hypotheses.terms import Term, for_drive
from tpmsd.offline.diagnosis.prepared.drive_regression import Refined, refined
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.refinement.finer_knots import Shape, best_knots, finer_shape, finest_shape
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import Evidence

ByDrive = tuple[Refined, dict[int, FloatArray]]
"""Keys of columns, and the column (w, 9) in each drive in which it acts."""


@dataclass(frozen=True)
class Point:
    """A trial of a term's nonlinear parameters."""

    first: float
    """Middle of a ramp (s), begin of a pulse (s) or value of the parameter that enters nonlinearly."""
    second: float = 0.0
    """Duration of a ramp (s), end of a pulse (s), value of a second nonlinear parameter (0: none)."""
    course: str = ""
    """Course of a ramp; empty: the plainest. Of others `first` is the onset, and `second` the time constant.
    """


def refine(regression: Regression, selection: Selection, evidence: Evidence, again: bool) -> bool:
    """Give the regression exact columns for the terms with nonlinear parameters; return whether there are
    any.
    They are hypotheses like all others from then on, beside those on the grid. With `again` those that are
    exact are refined once more.
    """
    terms = [one.term for one in selection.chosen]
    added: list[tuple[Term, Point]] = []
    columns: list[ByDrive] = []
    for k, term in enumerate(terms):
        if term.ramp or term.pulse or term.at is not None:
            if not again and int(np.flatnonzero(term.design[:, 0])[0]) >= regression.grid:
                continue
            others = [other for j, other in enumerate(terms) if j != k]
            point, best = _likeliest_point(
                regression, evidence, Selector(evidence, regression.hypotheses).design(others), term
            )
            added.append((term, point))
            columns += best
    shapes = [] if regression.simulation else _finer_shapes(regression, evidence, terms)
    indices = regression.append([*columns, *(column for shape in shapes for column in shape.columns)])
    at = len(columns)
    for shape in shapes:
        shape.add_to(regression, indices[at : at + len(shape.columns)])
        at += len(shape.columns)
    at = 0
    for term, point in added:
        width = term.design.shape[1]
        _add_hypothesis(regression, term, point, indices[at : at + width])
        at += width
    return bool(added or shapes)


def _add_hypothesis(regression: Regression, term: Term, point: Point, indices: Sequence[int]) -> None:
    """Make a hypothesis of a term at a point off its grid, whose columns have these indices."""
    if term.ramp:
        onset = _onset(point)
        regression.hypotheses.add_ramp(term.wheel, (onset, onset + point.second), indices[0], point.course)
    elif term.pulse:
        regression.hypotheses.add_pulse(term, (point.first, point.second), indices[0])
    else:
        regression.hypotheses.add_off_grid(term, point.first, indices, point.second or None)
    _restrict_to_its_drive(regression, term)


def most_significant_shape(regression: Regression, evidence: Evidence, design: FloatArray) -> Term | None:
    """Return the most significant spline (on its finest knots, over time on the first ones), ramp or pulse
    (with its exact span) beyond a design; None if none is significant.

    It is a hypothesis like all others from then on.
    """
    hypotheses = regression.hypotheses
    gram, b = evidence.projected(design)
    found = (
        hypotheses.ramp_gains(gram, b) + hypotheses.pulse_gains(gram, b) + hypotheses.smooth_gains(gram, b)
    )
    found = sorted(found, key=lambda entry: entry[1].penalty - entry[0])
    gain, term = found[0]
    if gain - term.penalty < SETTINGS.refinement.plain_nats:
        return None
    if regression.simulation:
        return term
    if not _is_coarse(term):
        # What a few knots over a covariate do not hold looks like many events: like is compared with like.
        coarse = [one for _, one in found if _is_coarse(one)][: SETTINGS.refinement.compared]
        scores = [best_knots(regression, design, one).score for one in coarse]
        if not scores or max(scores) <= gain - term.penalty:
            if not (term.ramp or term.pulse):
                return term
            alternatives = [
                one for _, one in found if one is not term and one.pulse and _has_same_span(one, term)
            ]
            return exact_term(regression, evidence, design, term, alternatives)
        term = coarse[scores.index(max(scores))]
    shape = finest_shape(regression, term)
    shape.add_to(regression, regression.append(shape.columns))
    return next(one for one in hypotheses.catalogue if one.knots == shape.knots and one.key == term.key)


def exact_term(
    regression: Regression,
    evidence: Evidence,
    design: FloatArray,
    term: Term,
    alternatives: Sequence[Term] = (),
) -> Term:
    """Return a ramp or pulse refined off its grid; alternatives on the same wheels and span are added
    likewise.
    Knots are up to half a minute off: what a strong event leaves there would pass for noise.
    """
    point, columns = _likeliest_point(regression, evidence, design, term)
    indices = regression.append(columns)
    for one in (*alternatives, term):
        _add_hypothesis(regression, one, point, indices)
    return regression.hypotheses.catalogue[-1]


def _has_same_span(one: Term, other: Term) -> bool:
    """Return whether two terms have the same wheel pattern and times."""
    return (one.pattern, one.span_s) == (other.pattern, other.span_s)


def _restrict_to_its_drive(regression: Regression, term: Term) -> None:
    """Restrict the hypothesis added last to one drive, if the term that it refines acts in one alone."""
    if term.drive is not None:
        exact = regression.hypotheses.catalogue.pop()
        regression.hypotheses.catalogue.append(for_drive(exact, term.drive, len(regression.drives)))


def _finer_shapes(regression: Regression, evidence: Evidence, terms: list[Term]) -> list[Shape]:
    """Return finer shapes of the smooth terms, and of the best unchosen one, whose gain they improve.
    Also of the best that was not chosen: on few knots a narrow shape leaves so much in some blocks that its
    heights look unsure.
    """
    asked = [(term, terms[:k] + terms[k + 1 :]) for k, term in enumerate(terms)]
    for _, found in Selector(evidence, regression.hypotheses).candidates(terms)[: SETTINGS.refinement.best]:
        if _is_coarse(found[0]):
            asked.append((found[0], terms))
            break
    out = []
    for term, others in asked:
        if _is_coarse(term):
            finer = finer_shape(regression, evidence, others, term)
            if finer is not None:
                out.append(finer)
    return out


def _is_coarse(term: Term) -> bool:
    """Return whether a term is a spline on its covariate's usual knots, and not over time or distance, where
    knots stay as wide as the blocks that are held out."""
    shape = term.nonparametric and not term.pulse and not term.knots
    return shape and term.covariate not in ("time", "distance")


def _columns_at(term: Term, point: Point) -> tuple[Refined, ...]:
    """Return the exact columns of a term at a trial point."""
    return refined(term, _onset(point) if term.ramp else point.first, point.second, point.course)


def _onset(point: Point) -> float:
    """Return the onset (s) of a ramp at a trial point."""
    return point.first if point.course else point.first - point.second / 2


def _trial_points(term: Term, centre: Point, width: Point) -> list[Point]:
    """Return the trial points about a centre: a grid of two parameters, or a line of one."""
    if term.ramp and centre.course:
        return [
            Point(centre.first + a * width.first, centre.second * width.second**b, centre.course)
            for a in np.linspace(-1.0, 1.0, 7)
            for b in np.linspace(-1.0, 1.0, 7)
        ]
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
    along = [Point(centre.first * width.first**a) for a in np.linspace(-1.0, 1.0, 11)]
    if not centre.second:
        return along
    seconds = centre.second * width.second ** np.linspace(-1.0, 1.0, 5)
    low, high = _second_parameter(term).range
    return [Point(one.first, float(np.clip(second, low, high))) for one in along for second in seconds]


def _second_parameter(term: Term) -> SecondParameter:
    """Return a term's second nonlinear parameter, which it has."""
    grid = term.kind_of.nonlinear.grid
    assert grid is not None
    assert grid.second is not None
    return grid.second


def _likeliest_point(
    regression: Regression, evidence: Evidence, design: FloatArray, term: Term
) -> tuple[Point, list[ByDrive]]:
    """Return the point of maximum likelihood of a term's nonlinear values, with its columns. A ramp is also
    fitted with its other courses, and takes one whose gain exceeds its larger penalty.
    """
    centre, width = _search_start(regression, term)
    point, columns, gain = _search_likeliest_point(regression, evidence, design, term, centre, width)
    if term.ramp and point.second > SETTINGS.selection.step_s:
        # The mean delay of a ramp is half of it, that of an exponential its time constant.
        tau = point.second / 2
        for course in term.kind_of.nonlinear.courses[1:]:
            begin = Point(_onset(point), tau, course)
            other = _search_likeliest_point(
                regression, evidence, design, term, begin, Point(tau, 2.0, course)
            )
            long = other[0].second > SETTINGS.selection.step_s
            if long and other[2] - ramp_penalty(course) > gain - ramp_penalty(point.course):
                point, columns, gain = other
    return point, columns


def _search_start(regression: Regression, term: Term) -> tuple[Point, Point]:
    """Return the centre and the half-widths of the first grid of a search."""
    knots = ramp_knots(regression.drives[regression.acting_drives(term)[0]].reader)
    if term.ramp:
        step = float(np.median(np.diff(knots)))
        centre = Point(0.5 * (term.span_s[0] + term.span_s[1]), term.span_s[1] - term.span_s[0])
        width = Point(step, max(1.5 * step, 0.3 * centre.second))
    elif term.pulse:
        step = 0.5 * float(np.median(np.diff(knots)))
        centre, width = Point(*term.span_s), Point(step, step)
    else:
        grid = term.kind_of.nonlinear.grid
        assert grid is not None
        assert term.at is not None
        centre, width = Point(term.at), Point(grid.step)
        if grid.second is not None:
            known = parameters_of(term.effect)[grid.second.parameter]
            assert isinstance(known, Parameter)
            centre = Point(term.at, known.typical if term.second is None else term.second)
            width = Point(grid.step, grid.second.step)
    return centre, width


def _search_likeliest_point(
    regression: Regression, evidence: Evidence, design: FloatArray, term: Term, centre: Point, width: Point
) -> tuple[Point, list[ByDrive], float]:
    """Return the point of greatest likelihood with all linear values of a design fitted along, its columns,
    one per value of the term, and its gain.
    """
    accepted = sum(part.small(design).sum(axis=0) for part in evidence.parts)
    acting = [(number, regression.drives[number]) for number in regression.acting_drives(term)]
    values, gain = term.design.shape[1], 0.0
    columns: list[ByDrive] = []
    for _ in range(SETTINGS.refinement.rounds):
        points = _trial_points(term, centre, width)
        parts = [part for point in points for part in _columns_at(term, point)]
        cross = np.zeros((len(accepted), len(points), values))
        size = np.zeros((len(points), values, values))
        trials = {}
        for number, drive in acting:
            trial = np.stack([part.column(drive.reader, drive.base) for part in parts], axis=2)
            rows = drive.whitened(trial).reshape(-1, len(points), values)
            known = np.concatenate([drive.white[:, :, :1], drive.whitened_design(design)], axis=2)
            cross += np.tensordot(known.reshape(-1, len(accepted)), rows, (0, 0))
            size += np.einsum("nti,ntj->tij", rows, rows, optimize=True)
            trials[number] = trial
        gains = _trial_gains(accepted, cross, size)
        best = int(np.argmax(gains - np.array([_penalty_of_second(term, point) for point in points])))
        centre, gain = points[best], float(gains[best])
        columns = [
            (parts[k], {number: trial[:, :, k] for number, trial in trials.items()})
            for k in range(best * values, (best + 1) * values)
        ]
        on_grid = term.at is not None
        factor = on_grid or bool(centre.course)
        width = Point(
            width.first**0.4 if on_grid else width.first / 2.5,
            width.second**0.4 if factor else width.second / 2.5,
        )
    return centre, columns, gain


def _penalty_of_second(term: Term, point: Point) -> float:
    """Return the penalty (nats) of the value of a second nonlinear parameter; 0 without one."""
    return _second_parameter(term).penalty(point.second) if term.at is not None and point.second else 0.0


def _trial_gains(accepted: FloatArray, cross: FloatArray, size: FloatArray) -> FloatArray:
    """(t,) gain of each trial's columns beyond the accepted ones, from Gram matrices.

    `accepted` (1 + k, 1 + k) holds the data first, `cross` (1 + k, t, v) is with the trials' v columns, and
    `size` (t, v, v) these columns' Gram matrices.
    """
    scale = 1.0 / np.sqrt(np.maximum(np.diag(accepted), 1e-300))
    length = np.sqrt(np.maximum(np.diagonal(size, axis1=1, axis2=2), 1e-300))
    gram = accepted * np.outer(scale, scale)
    both = cross * scale[:, None, None] / length
    score = both[0]
    left = size / (length[:, :, None] * length[:, None, :])
    if len(accepted) > 1:
        A = gram[1:, 1:] + 1e-9 * np.eye(len(gram) - 1)
        solved = np.linalg.solve(A, both[1:].reshape(len(A), -1)).reshape(both[1:].shape)
        score = score - np.tensordot(gram[0, 1:], solved, 1)
        left = left - np.einsum("kti,ktj->tij", both[1:], solved)
    found = np.linalg.solve(left + 1e-9 * np.eye(left.shape[1]), score[:, :, None])[:, :, 0]
    return np.asarray(0.5 * (score * found).sum(axis=1) / scale[0] ** 2)
