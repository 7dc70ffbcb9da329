"""Steps of the diagnosis on the regression of one short drive, against closed forms of what each says."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.diagnosis.assessment.explanatory import slip_gains
from tpmsd.offline.diagnosis.assessment.result import CONSISTENT
from tpmsd.offline.diagnosis.hypotheses.group_gain import group_gain
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.hypotheses.wheel_slip import WHEEL_SLIP
from tpmsd.offline.diagnosis.prepared.admission import admitted_readers
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.refinement.finer_knots import best_knots, finest_shape
from tpmsd.offline.diagnosis.refinement.relinearise import relinearised
from tpmsd.offline.diagnosis.reporting.findings import heldout_gain_of_term, report
from tpmsd.offline.diagnosis.reporting.location import location_of, where_of, whole_range
from tpmsd.offline.diagnosis.reporting.traces import drive_map, traces
from tpmsd.offline.diagnosis.robustness.found_terms import FoundTerms
from tpmsd.offline.diagnosis.robustness.gyro_drift import DRIFTS, add_gyro_drift
from tpmsd.offline.diagnosis.selection.candidates import Candidates
from tpmsd.offline.diagnosis.selection.chosen import Chosen, Selection
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import _RIDGE, _common_total
from tpmsd.offline.inference.stack import ColumnStack
from tpmsd.offline.inference.windows import CHANNEL_NAMES, GYRO, NORTH

SECONDS = 300.0


@pytest.fixture(scope="module")
def base() -> Regression:
    """A null drive on a rural road, under the noise that an estimate starts with."""
    readers, notes = admitted_readers([recording_of(drive(Spec(duration_s=SECONDS, road="rural"), 4))])
    assert () == notes
    return Regression(readers)


def injected(base: Regression, columns: FloatArray) -> Regression:
    """The regression with a response (w, 9) added to the data."""
    regression = base.copied()
    (one,) = regression.drives
    every = list(np.moveaxis(one.columns.whole(), 2, 0))
    one.columns = ColumnStack(every[0] + columns, *every[1:])
    one._kept = []
    return regression


def chosen(regression: Regression, *terms: Term) -> Selection:
    """The terms, judged."""
    return Selector(regression.evidence(), regression.hypotheses).selection_of(list(terms))


def shape(regression: Regression, pattern: str, covariate: str) -> Term:
    """The smooth term of a place on its usual knots."""
    gram, b = regression.evidence().projected(regression.hypotheses.nuisance)
    found = [term for _, term in regression.hypotheses.smooth_gains(gram, b)]
    return next(term for term in found if (term.pattern, term.covariate) == (pattern, covariate))


def rows(regression: Regression, columns: FloatArray) -> FloatArray:
    """Whitened combinations of the drive's columns as rows."""
    white = regression.drives[0].white
    return np.asarray((white @ columns).reshape(-1, columns.shape[1]))


def left(y: FloatArray, X: FloatArray) -> FloatArray:
    """What plain least squares leave of a column."""
    return np.asarray(y - X @ np.linalg.lstsq(X, y, rcond=None)[0])


def test_a_slip_explains_what_least_squares_with_its_columns_take_away(base: Regression) -> None:
    """The gain is half the drop of the residual's sum of squares, calibration fitted before and after."""
    evidence = base.evidence()
    (one,) = base.drives
    reported = {entry.variable: entry for entry in slip_gains(base, [], evidence)}
    y, X = (
        rows(base, np.eye(base.width, 1))[:, 0],
        rows(base, base.hypotheses.nuisance),
    )
    at = [k for k, name in enumerate(one.names) if name[0] == WHEEL_SLIP]
    slips = rows(base, np.eye(base.width)[:, at])
    before, after = left(y, X), left(y, np.concatenate([X, slips], axis=1))

    assert reported[WHEEL_SLIP].alone == pytest.approx(0.5 * (before @ before - after @ after), rel=1e-3)
    assert reported[WHEEL_SLIP].beyond == reported[WHEEL_SLIP].alone
    assert () == reported[WHEEL_SLIP].without


@pytest.mark.parametrize("off", [-0.004, 0.003])
def test_the_new_origin_does_not_depend_on_the_radii_that_were_configured(off: float) -> None:
    """One step from radii 0.4 % too small or 0.3 % too large ends where one from right ones does."""
    recording = recording_of(drive(Spec(duration_s=SECONDS, road="rural"), 4))
    found_m = []
    for factor in (1.0, 1.0 + off):
        car = replace(recording.car, radius_m=recording.car.radius_m * factor)
        regression = Regression(admitted_readers([replace(recording, car=car)])[0])
        moved = relinearised(regression, chosen(regression))
        found_m.append(moved.drives[0].reader.reference.car.radius_m)

    assert np.allclose(*found_m, rtol=0.01 * abs(off))


def test_the_hats_of_a_reading_add_up_to_a_constant(base: Regression) -> None:
    """Piecewise linear weights are a partition of one, so that together they are the gyro's bias."""
    finest = finest_shape(base, shape(base, "yaw_rate", "speed"))
    total = sum(columns[0] for _, columns in finest.columns)
    expected = np.zeros((len(base.drives[0].reader.windows), len(CHANNEL_NAMES)))
    expected[:, GYRO] = 1.0

    assert ("yaw_rate",) == finest.patterns
    assert len(finest.knots) == len(finest.columns)
    assert np.allclose(expected, total)


def test_a_narrow_dip_takes_finer_knots_than_none(base: Regression) -> None:
    """Knots are paid for by what they gain: a dip of one fine hat takes them, a null drive does not."""
    term = shape(base, "yaw_rate", "speed")
    finest = finest_shape(base, term)
    middle = finest.columns[len(finest.columns) // 2][1][0]
    dip = injected(base, -0.02 * middle)

    plain, fine = (best_knots(regression, regression.hypotheses.nuisance, term) for regression in (base, dip))

    assert len(plain.at) < len(fine.at)
    assert fine.score > 100.0 + plain.score
    assert finest.knots[len(finest.columns) // 2] in fine.at


def test_a_ramp_stands_from_its_onset_to_the_end_of_the_drive(base: Regression) -> None:
    """A change of the left rear radius between 100 and 140 s lasts; all wheels being read, ratios show it."""
    term = base.hypotheses.ramp_term("rl", 0)
    term = replace(term, span_s=(100.0, 140.0))
    one = Chosen(term, 9.0, 9.0, 9.0, 1.0, (), np.array([1e-3]), np.array([1e-4]))

    where = where_of(base, one)

    assert (("rl",), "wheel_ratio", "time") == (where.wheels, where.channel, where.covariate)
    assert ((100.0, pytest.approx(SECONDS, abs=0.2)),) == where.time_spans
    assert where.time_spans[0] == where.range


def test_a_term_is_placed_where_its_response_has_its_energy(base: Regression) -> None:
    """95 % of a hat's energy lie between the knots beside it; what was not chosen has the whole range."""
    term = shape(base, "yaw_rate", "speed")
    knots = base.knots(term)
    heights = np.zeros(len(knots))
    heights[2] = 1e-2
    one = Chosen(term, 9.0, 9.0, 9.0, 1.0, (), heights, np.ones(len(knots)))
    speed = base.drives[0].reader.windows.covariates["speed"]

    low, high = where_of(base, one).range or (np.nan, np.nan)

    hat = np.interp(speed, knots, heights) ** 2
    inside = hat[(low <= speed) & (speed <= high)].sum() / hat.sum()

    assert knots[1] < low < knots[2] < high < knots[3]
    assert inside > 0.9
    assert (speed.min(), speed.max()) == whole_range(base, term).range
    assert ((), "yaw_rate", "speed") == location_of(base, term)
    assert (("rl", "rr"), "wheel_ratio", "speed") == location_of(base, shape(base, "rear", "speed"))


def test_a_trace_ends_without_a_mean_and_begins_with_the_response(base: Regression) -> None:
    """Least squares leave nothing along a fitted response; without the term its own energy is left."""
    term = shape(base, "yaw_rate", "speed")
    heights = 0.01 * np.arange(term.design.shape[1])
    (one,) = base.drives
    response = one.columns.take(one.local) @ (term.design @ heights)
    regression = injected(base, response)
    selection = chosen(regression, term)

    (trace,) = traces(regression, selection, regression.evidence())
    energy = (regression.drives[0].response(term.design, selection.chosen[0].values) ** 2).sum()

    assert ("unknown", "speed") == (trace.effect, trace.covariate)
    assert np.abs(trace.after).max() < 0.05 * np.abs(trace.before).max()
    assert np.square(trace.before).sum() <= 1.05 * energy
    assert np.all(np.diff(trace.middle) > 0.0)


def test_the_map_shows_places_as_measured_and_what_the_model_gained_there(base: Regression) -> None:
    """The gain of a window is half the drop of its squares, averaged over nine neighbours."""
    term = shape(base, "yaw_rate", "speed")
    (one,) = base.drives
    regression = injected(base, 0.02 * one.columns.take(one.local) @ term.design.sum(axis=1))
    selection, evidence = chosen(regression, term), regression.evidence()
    rolling = evidence.fit(regression.hypotheses.nuisance)
    squares = [
        (regression.drives[0].residual(fit.design, fit.values) ** 2).sum(axis=1)
        for fit in (rolling, selection.fit)
    ]
    gain = 0.5 * (squares[0] - squares[1])

    found = drive_map(regression, selection, evidence)

    assert found is not None
    measured = one.reader.windows.measured[:, NORTH]
    known = np.isfinite(measured)
    assert np.array_equal(measured[known], found.north_m)
    assert gain[96:105].mean() == pytest.approx(found.mismatch[np.flatnonzero(known) == 100][0])


def test_a_null_drive_is_consistent_and_its_size_is_that_of_the_noise(base: Regression) -> None:
    """Nothing chosen: no finding, both models alike, each channel as large as its whitened residual."""
    nothing, evidence = chosen(base), base.evidence()
    (one,) = base.drives

    reported = report(base, nothing, evidence)
    white = one.residual(nothing.fit.design, nothing.fit.values)[:, GYRO]

    assert (CONSISTENT, ()) == (reported.verdict, reported.findings)
    assert reported.baseline_rms == reported.model_rms
    assert len(one.reader.windows) == reported.driving_s
    assert reported.inner is not None
    assert np.sqrt(np.square(white).mean()) == pytest.approx(reported.inner.rms_by_channel["yaw_rate"][1])


def test_a_term_without_an_effect_gains_nothing_on_data_left_out(base: Regression) -> None:
    """Values that were fitted to noise predict worse; those of an injected response predict better."""
    term = shape(base, "yaw_rate", "speed")
    (one,) = base.drives
    regression = injected(base, 0.02 * one.columns.take(one.local) @ term.design[:, 2])
    without, with_it = (
        heldout_gain_of_term(Selector(one.evidence(), one.hypotheses), [], term) for one in (base, regression)
    )

    assert without < 0.0
    assert with_it > 100.0


def test_what_is_tried_under_another_noise_leaves_the_regression_as_it_is(base: Regression) -> None:
    """Twice the noise of all wheels takes gain away in the trial alone; so does a column that is added to a
    copy."""
    regression = base.copied()
    (one,) = regression.drives
    before, noise = regression.evidence().total, one.noise
    tried = one.with_noise(replace(noise, rough_m=2.0 * noise.rough_m))
    weighed = one.with_noise(inflate=np.full(one.columns.shape[:2], 4.0))

    totals = [regression.with_drives([other]).evidence().total for other in (tried, weighed)]

    assert noise == one.noise
    assert one.inflate is None
    assert np.array_equal(before, regression.evidence().total)
    assert all(np.all(np.diag(total) <= (1.0 + 1e-9) * np.diag(before)) for total in totals)
    assert all(total[0, 0] < before[0, 0] for total in totals)
    columns, terms = one.columns, list(regression.hypotheses.catalogue)
    other = regression.copied()
    finest = finest_shape(other, shape(other, "yaw_rate", "speed"))
    finest.add_to(other, other.append(finest.columns))
    assert other.drives[0].columns.shape[2] == columns.shape[2] + len(finest.columns)
    assert (columns is one.columns, terms) == (True, regression.hypotheses.catalogue)
    assert np.array_equal(before, regression.evidence().total)


def test_a_gyro_that_walks_as_usual_is_not_asked_and_another_gets_its_noise_back(
    base: Regression,
) -> None:
    """Without a bend over time nothing is found, and the noise is what it was."""
    regression = base.copied()
    (one,) = regression.drives
    nothing, evidence = chosen(regression), regression.evidence()
    for walk in (0.9 * DRIFTS, 1.1 * DRIFTS):
        walking = regression.with_noise({0: replace(one.noise, gyro_drift_radps=walk)})
        before = FoundTerms(walking, nothing, evidence)
        assert before is add_gyro_drift(before)


def test_the_settings_hold_a_step_of_the_radii_to_what_is_a_calibration(base: Regression) -> None:
    """A radius moves by the share that the settings allow and no more, whatever the fit says."""
    regression = base.copied()
    (one,) = regression.drives
    before_m = one.reader.reference.car.radius_m.copy()
    fit = chosen(regression).fit
    absurd = replace(fit, values=np.where(np.arange(len(fit.values)) < len(WHEELS), 1.0, fit.values))

    moved = relinearised(regression, replace(chosen(regression), fit=absurd))
    grown = moved.drives[0].reader.reference.car.radius_m / before_m - 1.0

    assert np.allclose(SETTINGS.refinement.max_relative_radius_change, grown)
    assert np.array_equal(before_m, one.reader.reference.car.radius_m)


def test_the_gain_of_a_term_is_that_of_its_columns(base: Regression) -> None:
    """What is kept of a term's design gives what the whole design gives, in effects and shapes."""
    evidence, hypotheses = base.evidence(), base.hypotheses
    gram, b = evidence.projected(hypotheses.nuisance)
    shapes = [term for _, term in hypotheses.smooth_gains(gram, b)]
    for term in [*hypotheses.catalogue, *shapes]:
        assert group_gain(term.design[1:], gram, b) == term.gain(gram, b)
        rows, part = term.nonzero_rows
        again = np.zeros_like(term.design)
        again[1 + rows] = part
        assert np.array_equal(term.design, again)


def test_projecting_and_pairs_are_those_of_the_plain_formulas(base: Regression) -> None:
    """Designs that combine a few columns, and the best pairs of all: as from whole matrices and lists."""
    evidence, hypotheses = base.evidence(), base.hypotheses
    some = [term for term in hypotheses.catalogue if term.design.shape[1] > 1][:1]
    gram, b = evidence.projected(design := Candidates(evidence, hypotheses).design(some))
    total = evidence.total
    assert total is evidence.parts[0].total  # of one drive
    assert np.array_equal(total, _common_total([*evidence.parts, *evidence.parts], len(total)) / 2.0)

    unit = design / np.sqrt((design * (total @ design)).sum(axis=0))
    inner = unit.T @ total @ unit + _RIDGE * np.eye(unit.shape[1])
    plain = total - total @ unit @ np.linalg.solve(inner, unit.T @ total)
    size = np.sqrt(np.maximum(np.diag(total), 1e-30))
    assert np.abs((gram - plain[1:, 1:]) / np.outer(size[1:], size[1:])).max() < 1e-9
    assert np.abs((b - plain[1:, 0]) / size[1:] / size[0]).max() < 1e-9

    for term in some:
        A, score = term.design[1:].T @ total[1:, 1:] @ term.design[1:], term.design[1:].T @ total[1:, 0]
        scale = np.sqrt(np.diag(A))
        values = np.linalg.solve(A / np.outer(scale, scale) + 1e-6 * np.eye(len(A)), score / scale)
        of_all = (0.5 * values @ (score / scale), values[0] / scale[0])
        assert group_gain(term.design[1:], total[1:, 1:], total[1:, 0]) == pytest.approx(of_all, rel=1e-9)

    least = SETTINGS.selection.min_own_share * np.diag(total)[1:]
    single = [term for term in hypotheses.catalogue if term.design.shape[1] == 1 and term.key != some[0].key]
    at = [int(np.argmax(np.abs(term.design[1:, 0]))) for term in single]
    usable = [(k, term) for k, term in zip(at, single, strict=True) if gram[k, k] > least[k]]
    every = []
    for (i, one), (j, other) in itertools.combinations(usable, 2):
        pair, score = gram[np.ix_([i, j], [i, j])], b[[i, j]]
        apart = np.linalg.det(pair) > 1e-4 * pair[0, 0] * pair[1, 1]
        gain = 0.5 * score @ np.linalg.solve(pair, score) if apart else 0.0
        if one.key != other.key:
            every.append((gain - one.penalty - other.penalty, [one, other]))
    every.sort(key=lambda entry: -entry[0])
    found = Candidates(evidence, hypotheses).best_pairs(some)
    assert len(found) == SETTINGS.selection.best_pairs < len(every)
    assert [gain for gain, _ in found] == pytest.approx([gain for gain, _ in every[: len(found)]])
    assert [terms for _, terms in found] == [terms for _, terms in every[: len(found)]]


@pytest.mark.parametrize("factor", [1.0, -2e-3, 50.0])
def test_the_gain_of_one_column_is_its_closed_form(factor: float) -> None:
    """A multiple of a column with square 4 and correlation 6 brings 6^2 / (2 * 4) nats, by 6 / (4 factor);
    another column that shares nothing with it changes neither."""
    gram, b = np.diag([9.0, 4.0]), np.array([0.0, 6.0])
    alone, beside = np.array([[0.0], [factor]]), np.array([[0.0, 1.0], [factor, 0.0]])

    for design in (alone, beside):
        assert group_gain(design, gram, b) == pytest.approx((4.5, 1.5 / factor), rel=2e-6)
