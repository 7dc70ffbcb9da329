"""A term whose nonlinear parameter is moved off its grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.catalogue import make_effect, probe_groups
from tpmsd.offline.diagnosis.assessment.tangent import nonlinear_stds
from tpmsd.offline.diagnosis.hypotheses.one_drive import DriveHypotheses
from tpmsd.offline.diagnosis.prepared.admission import admitted_readers
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.refinement.refine import most_significant_shape, refine
from tpmsd.offline.diagnosis.selection.selector import Selector

CURVE = next(group for group in probe_groups() if group[0].effect == "drive_slip_curve" and len(group) == 2)


def test_all_values_of_an_effect_stay_when_its_parameter_is_refined() -> None:
    """Each value's response has a column of its own, at the refined parameter."""
    hypotheses = DriveHypotheses([("data",), *(probe.key for probe in CURVE)], np.zeros(0), frozenset())
    like = next(term for term in hypotheses.catalogue if len(term.parameters) == 2)
    hypotheses.widen(5)

    hypotheses.add_off_grid(like, 3.1, columns=(3, 4))

    exact = hypotheses.catalogue[-1]
    assert like.parameters == exact.parameters
    assert 3.1 == exact.at
    assert [[3], [4]] == [np.flatnonzero(column).tolist() for column in exact.design.T]


def test_a_lag_off_the_grid_shapes_all_values_of_its_effect() -> None:
    """A sunny side behind 220 s, between two of the grid's lags: lag and both values within their standard
    deviations, and nothing beside it."""
    recording = recording_of(drive(Spec(duration_s=600.0, road="city", radius_drift=0.0), 8))
    base = Regression(admitted_readers([recording])[0]).drives[0].reader
    truth = make_effect("sun_side", east_m=6e-4, north_m=-4e-4, lag_s=220.0)
    change = truth.radius_change_m(base.reference.motion, base.reference.car)
    turns = recording.rotation_rad / (1.0 + change[: recording.ticks] / recording.car.radius_m)
    regression = Regression(admitted_readers([replace(recording, rotation_rad=turns)])[0])
    evidence = regression.evidence()

    assert refine(regression, Selector(evidence, regression.hypotheses).select(1), evidence, again=True)
    selection = Selector(regression.evidence(), regression.hypotheses).select()
    stds = nonlinear_stds(regression, selection)[0]

    assert ["sun_side"] == [one.term.effect for one in selection.chosen]
    sun = selection.chosen[0]
    assert sun.term.at == pytest.approx(220.0, abs=4.0 * stds["lag_s"])
    assert 40.0 > stds["lag_s"]
    for name, true, found in zip(("east_m", "north_m"), (6e-4, -4e-4), sun.values, strict=True):
        assert found == pytest.approx(true, abs=4.0 * stds[name])
        assert 1e-4 > stds[name] >= 0.99 * float(sun.stds[("east_m", "north_m").index(name)])


def test_a_spline_over_time_keeps_its_knots() -> None:
    """Radii that swing for the whole drive are neither a ramp nor a pulse: there is no span to refine."""
    recording = recording_of(drive(Spec(duration_s=200.0, road="rural"), 6))
    swing = 6e-3 * np.sin(2.0 * np.pi * recording.edges_s[:-1] / 90.0)
    turns = recording.rotation_rad * (1.0 + swing[:, None] * np.array([0.0, 0.0, 1.0, 0.0]))
    regression = Regression(admitted_readers([replace(recording, rotation_rad=turns)])[0])

    term = most_significant_shape(regression, regression.evidence(), regression.hypotheses.nuisance)

    assert term is not None
    assert ("rl", False, False) == (term.pattern, term.ramp, term.pulse)
    assert term.covariate in ("time", "distance")
