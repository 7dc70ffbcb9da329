"""Functions of place or time that no number of the catalogue describes: slopes and wind over time, and terms
without a name.

In: a selection that finds nothing more in the catalogue. Out: terms that may be added, with their evidence.
Terms without a name are first looked for on a part of the blocks, the best ones then on all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from tpmsd.car.physics.baselines.base import Theta
from tpmsd.car.physics.dynamics_effects.time_spline import (
    COVARIATES,
    DynamicsRoadBank,
    DynamicsRoadGrade,
    DynamicsUnknown,
)
from tpmsd.car.physics.dynamics_effects.winds import DynamicsHeadWind, SideWind
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.arrays import BoolArray
from tpmsd.offline.dynamics.columns import Probe, gram
from tpmsd.offline.dynamics.evidence import Addition, PriorColumns, Statistics, join_columns
from tpmsd.offline.dynamics.screen import block_test, largest_span, row_scores, slow_share
from tpmsd.offline.dynamics.search import Search
from tpmsd.offline.dynamics.settings import SETTINGS
from tpmsd.offline.dynamics.terms import (
    CandidateTerm,
    drop_points_without_rows,
    hat_functions,
    spaced_knots,
    spline_term,
)

SIZES = {"force_x": 0.4, "force_y": 0.6, "moment": 0.6, "force_front": 0.6, "force_rear": 0.6}
"""Prior standard deviations of a term without a name on an equation: m/s2, of the moment rad/s2."""
OUTPUT_SIZES = 5.0
"""Value on an output, in standard deviations of a reading."""


@dataclass(frozen=True)
class LocatedTerm:
    """A term that may be added, with the log evidence for it."""

    term: CandidateTerm
    evidence: float


def located_terms(search: Search) -> list[LocatedTerm]:
    """Return the terms that may be added, best first."""
    found = [*slopes(search), *_winds(search), *nameless(search)]
    return sorted(found, key=lambda located: -located.evidence)


def slopes(search: Search) -> list[LocatedTerm]:
    """Return candidate road slopes (bank, grade) as splines over time that the model lacks, best first."""
    seen = search.cached_statistics
    if seen.slopes is None:
        seen.slopes = _slopes(search)
    return seen.slopes


def _slopes(search: Search) -> list[LocatedTerm]:
    """Compute the result of `slopes`."""
    time = search.setup.drive.time_s
    knots = _time_knots(time)
    flat = (0.0,) * len(knots)
    there = {effect.name for effect in search.theta}
    terms = []
    if DynamicsRoadBank.name not in there and _scores_vary_slowly(
        search, DynamicsRoadBank((0.0, 1.0), (1e-3, 1e-3))
    ):
        terms.append(spline_term(DynamicsRoadBank(knots, flat), SETTINGS.bank_std_rad))
    grade = search.setup.baseline.forces and DynamicsRoadGrade.name not in there
    if grade and _scores_vary_slowly(search, DynamicsRoadGrade((0.0, 1.0), (1e-3, 1e-3))):
        terms.append(spline_term(DynamicsRoadGrade(knots, flat), SETTINGS.grade_std_rad))
    return sorted(_score_terms(search, terms), key=lambda located: -located.evidence)


def _scores_vary_slowly(search: Search, flat: DynamicsRoadBank | DynamicsRoadGrade) -> bool:
    """Return True if the scores of a slope vary slowly enough to compute its evidence."""
    scores = row_scores(search, Probe((*search.theta, flat), 1e-3))
    return slow_share(search, scores, SETTINGS.time_knot_s) > SETTINGS.slow_share


def _score_terms(search: Search, terms: list[CandidateTerm], penalty: float = 0.0) -> list[LocatedTerm]:
    """Return the terms that the drive informs, with their log evidence less the penalty."""
    if not terms:
        return []
    look = search.look(terms)
    out = []
    for k, term in enumerate(terms):
        term_columns = _informed_columns(look.statistics, look.added[k])
        if len(term_columns.index) < 2:
            continue
        addition = look.statistics.addition(join_columns(look.columns), term_columns)
        out.append(LocatedTerm(term, addition.log_evidence() - penalty))
    return out


def _informed_columns(statistics: Statistics, columns: PriorColumns) -> PriorColumns:
    """Return the columns that the drive informs."""
    rows = np.array(columns.index, dtype=int)
    seen = np.diag(statistics.information)[rows] > 1e-3 * columns.precision
    return PriorColumns(tuple(rows[seen].tolist()), columns.offset[seen], columns.precision[seen])


# -- wind ----------------------------------------------------------------------------------------------------


def _winds(search: Search) -> list[LocatedTerm]:
    """Return the likeliest span of wind from the side, and from ahead where speed is an output."""
    time = search.setup.drive.time_s
    boxes = spaced_knots(float(time[0]), float(time[-1]) + 1e-6, SETTINGS.wind_box_s)
    edges = drop_points_without_rows(np.array(boxes), time)
    out = []
    for kind in (SideWind, *((DynamicsHeadWind,) if search.setup.baseline.forces else ())):
        there = [effect for effect in search.theta if isinstance(effect, kind)]
        if len(there) >= SETTINGS.max_spans:
            continue
        moved = (*search.theta, kind(speed_mps=1.0))
        scores = row_scores(search, Probe(moved, 1.0))
        if largest_span(search, scores, SETTINGS.wind_box_s) < SETTINGS.span_sizes:
            continue
        prior = next(p.prior for p in kind.numbers() if p.prior is not None)
        addition = _wind_box_addition(search, moved, edges, prior.std)
        ratio = _box_overdispersion(addition.scores, addition.information)
        middle = 0.5 * (edges[:-1] + edges[1:])
        taken = np.zeros(len(middle), dtype=bool)
        for one in there:
            taken |= (middle >= one.onset_s) & (middle < one.onset_s + one.duration_s)
        spans = _best_spans(addition, prior.std, ratio, taken, SETTINGS.max_spans - len(there))
        if not spans:
            continue
        first, last, coarse = spans[0]
        span = _refine_span(search, moved, (float(edges[first]), float(edges[last])), prior.std, ratio)
        # a spline over time explains all gusts at once: against it they count together
        evidence = max(coarse, span.evidence - _log_spans(len(middle))) + sum(gain for *_, gain in spans[1:])
        effect = kind(0.0, span.onset_s, span.duration_s)
        term = CandidateTerm(
            effect, ("speed_mps",), (0.0,), (prior.std,), {"speed_mps": 0.0}, spread=span.spread
        )
        out.append(LocatedTerm(term, evidence))
    return out


def _wind_box_addition(search: Search, moved: Theta, edges: FloatArray, std: float) -> Addition:
    """Return gain statistics of a wind, one column for each span between neighbouring edges."""
    time = search.setup.drive.time_s
    columns, probes = search.own(0)
    boxes = [
        Probe(moved, 1.0, np.asarray((time >= first) & (time < last), dtype=np.float64))
        for first, last in pairwise(edges)
    ]
    statistics = Statistics(gram(search.setup, search.theta, search.at, search.noise, [*probes, *boxes]))
    count = len(boxes)
    index = tuple(range(len(probes), len(probes) + count))
    added = PriorColumns(index, np.zeros(count), np.full(count, std**-2))
    return statistics.addition(join_columns(columns), added)


@dataclass(frozen=True)
class WindSpan:
    """A span of time with wind."""

    onset_s: float
    duration_s: float
    spread: dict[str, float]
    """Standard deviations by doubt about the span: of onset, duration and the wind's speed."""
    evidence: float
    """Log evidence for the wind, the mean over begins and ends near the coarse ones."""


def _refine_span(
    search: Search, moved: Theta, coarse: tuple[float, float], std: float, ratio: float
) -> WindSpan:
    """Return the likeliest begin and end near those of a coarse span, with the spread of their posterior."""
    time, reach, step = search.setup.drive.time_s, SETTINGS.wind_box_s, SETTINGS.wind_edge_s
    offsets = np.arange(-reach, reach + 0.5 * step, step)
    middle = 0.5 * (coarse[0] + coarse[1])
    # half a step from the middle on either side: where no span is likely the best one would be an empty one
    begins = coarse[0] + offsets
    begins = begins[(begins >= time[0]) & (begins <= middle - 0.5 * step)]
    ends = coarse[1] + offsets
    ends = ends[(ends >= middle + 0.5 * step) & (ends <= time[-1] + step)]
    begins = begins if len(begins) else np.array([max(coarse[0], float(time[0]))])
    ends = ends if len(ends) else np.array([coarse[1]])
    addition = _wind_box_addition(search, moved, np.concatenate([begins, ends]), std)
    total = np.zeros((len(begins) + len(ends),) * 2)
    total[1:, 1:] = np.cumsum(np.cumsum(addition.information, axis=0), axis=1) / ratio
    pull = np.concatenate([[0.0], np.cumsum(addition.gradient)]) / ratio
    i, j = np.meshgrid(np.arange(len(begins)), np.arange(len(ends)) + len(begins), indexing="ij")
    inside = np.maximum(total[j, j] - total[i, j] - total[j, i] + total[i, i], 0.0)
    speed = (pull[j] - pull[i]) / (inside + std**-2)
    gain = 0.5 * (pull[j] - pull[i]) * speed - 0.5 * np.log1p(inside * std**2)
    weight = np.exp(gain - gain.max())
    evidence = float(gain.max()) + math.log(float(weight.mean()))
    weight /= weight.sum()
    onset, duration = begins[i], ends[j - len(begins)] - begins[i]
    best = np.unravel_index(int(np.argmax(gain)), gain.shape)

    def deviation(values: FloatArray) -> float:
        """Return the posterior standard deviation over the spans."""
        about = float(np.sum(weight * values))
        return math.sqrt(float(np.sum(weight * (values - about) ** 2)))

    half = step / math.sqrt(12.0)
    spread = {
        "onset_s": math.hypot(deviation(onset), half),
        "duration_s": math.hypot(deviation(duration), math.sqrt(2.0) * half),
        "speed_mps": deviation(speed),
    }
    return WindSpan(max(float(onset[best]), 0.0), float(duration[best]), spread, evidence)


def _box_overdispersion(scores: FloatArray, information: FloatArray) -> float:
    """Return the overdispersion by the median over boxes, at least 1."""
    size = np.sum(scores**2, axis=0) / np.maximum(np.diag(information), 1e-300)
    return max(float(np.median(size) / 0.455), 1.0)


def _best_spans(
    addition: Addition, std: float, ratio: float, taken: BoolArray, most: int
) -> list[tuple[int, int, float]]:
    """Return (first edge, last edge, log evidence) of the best free span, then of further positive ones."""
    taken = taken.copy()
    out: list[tuple[int, int, float]] = []
    while len(out) < most and not taken.all():
        span = _best_span(addition, std, ratio, taken)
        if out and not span[2] > 0.0:
            break
        out.append(span)
        taken[span[0] : span[1]] = True
    return out


def _best_span(addition: Addition, std: float, ratio: float, taken: BoolArray) -> tuple[int, int, float]:
    """Return (first edge, last edge, log evidence) of the best span without boxes that are taken."""
    n = len(addition.gradient)
    total = np.zeros((n + 1, n + 1))
    total[1:, 1:] = np.cumsum(np.cumsum(addition.information, axis=0), axis=1) / ratio
    pull = np.concatenate([[0.0], np.cumsum(addition.gradient)]) / ratio
    covered = np.concatenate([[0], np.cumsum(taken)])
    i, j = np.triu_indices(n + 1, 1)
    short = j - i <= _longest(n)
    inside = np.maximum(total[j, j] - total[i, j] - total[j, i] + total[i, i], 0.0)
    gain = 0.5 * (pull[j] - pull[i]) ** 2 / (inside + std**-2) - 0.5 * np.log1p(inside * std**2)
    gain = np.where(short & (covered[i] == covered[j]), gain, -np.inf)
    best = int(np.argmax(gain))
    return int(i[best]), int(j[best]), float(gain[best]) - _log_spans(n)


def _longest(boxes: int) -> int:
    """Return the most boxes of a span: a wind throughout the drive is no event."""
    return max(boxes // 3, 1)


def _log_spans(boxes: int) -> float:
    """Return the log of the number of possible spans."""
    longest = _longest(boxes)
    return math.log(longest * boxes - longest * (longest - 1) // 2)


# -- terms without a name ------------------------------------------------------------------------------------


def nameless(search: Search) -> list[LocatedTerm]:
    """Return unnamed splines, for each equation and output over each covariate, best first."""
    seen = search.cached_statistics
    if seen.nameless is None:
        seen.nameless = _nameless(search)
    return seen.nameless


def _nameless(search: Search) -> list[LocatedTerm]:
    """Compute the result of `nameless`."""
    values = search.covariates
    sizes = _sizes(search)
    taken = {(effect.on, effect.over) for effect in search.theta if isinstance(effect, DynamicsUnknown)}
    terms = []
    for on, size in sizes.items():
        for over in COVARIATES:
            if (on, over) in taken:
                continue
            knots = _knots(values[over], over)
            if len(knots) >= 3:
                flat = DynamicsUnknown(knots=knots, heights=(0.0,) * len(knots), on=on, over=over)
                terms.append(spline_term(flat, size))
    penalty = nameless_penalty(search)
    found: list[tuple[float, float, int]] = []
    scores: dict[str, FloatArray] = {}
    for k, term in enumerate(terms):
        effect = term.effect
        assert isinstance(effect, DynamicsUnknown)
        if effect.on not in scores:
            raised = replace(effect, heights=tuple(1e-3 for _ in effect.knots))
            scores[effect.on] = row_scores(search, Probe((*search.theta, raised), 1e-3))
        if effect.over == "time":
            slow = slow_share(search, scores[effect.on], SETTINGS.time_knot_s)
            p_value, gain = (1.0 if slow < SETTINGS.slow_share else 1e-4 / slow), 0.0
        else:
            p_value, gain = block_test(
                search, scores[effect.on], hat_functions(values[effect.over], effect.knots)
            )
        found.append((p_value, -gain, k))
    found.sort()
    likely = [terms[k] for p_value, _, k in found[: SETTINGS.nameless_looked] if p_value < SETTINGS.screen_p]
    return sorted(_score_terms(search, likely, penalty), key=lambda located: -located.evidence)


def _sizes(search: Search) -> dict[str, float]:
    """Return the prior standard deviation of a term without a name, by equation and output."""
    lateral = ("force_y", "moment", "force_front", "force_rear")
    equations = (*lateral, *(("force_x",) if search.setup.baseline.forces else ()))
    noise = zip(search.setup.channels, search.noise.outputs, strict=True)
    return {on: SIZES[on] for on in equations} | {on: OUTPUT_SIZES * std for on, std in noise}


def nameless_penalty(search: Search) -> float:
    """Return the nats against a term without a name: the odds that physics has one, and their number."""
    return SETTINGS.nameless_nats + math.log(len(_sizes(search)) * len(COVARIATES))


def _knots(values: FloatArray, over: str) -> tuple[float, ...]:
    """Return knots over a covariate, even between its 0.5 and 99.5 % quantiles; empty if constant."""
    if over == "time":
        return _time_knots(values)
    low, high = (float(x) for x in np.quantile(values, [0.005, 0.995]))
    if not high - low > 1e-9:
        return ()
    return tuple(float(x) for x in np.linspace(low, high, SETTINGS.spline_knots))


def _time_knots(time_s: FloatArray) -> tuple[float, ...]:
    """Return knots over time without those in long pauses, on which no row depends."""
    knots = spaced_knots(float(time_s[0]), float(time_s[-1]), SETTINGS.time_knot_s)
    return tuple(map(float, drop_points_without_rows(np.array(knots), time_s)))


def fit_located_term(search: Search, located: LocatedTerm) -> CandidateTerm:
    """Return the located term with its heights or size fitted jointly with the model."""
    look = search.look([located.term])
    estimate, _ = look.statistics.fit(join_columns([*look.columns, look.added[0]]))
    own = estimate[len(estimate) - len(located.term.free) :]
    return replace(located.term.moved(own))
