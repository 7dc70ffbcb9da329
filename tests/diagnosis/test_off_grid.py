"""A term whose nonlinear parameter is moved off its grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bench.worlds.kinematic import Spec, drive
from tests.diagnosis.recorded import recording_of
from tpmsd.diagnosis.hypotheses.terms import Hypotheses
from tpmsd.diagnosis.prepared.admission import admitted
from tpmsd.diagnosis.prepared.study import Study
from tpmsd.diagnosis.refinement.refine import plainest_shape
from tpmsd.physics.catalogue import groups

CURVE = next(group for group in groups() if group[0].effect == "drive_slip_curve" and len(group) == 2)


def test_all_values_of_an_effect_stay_when_its_parameter_is_refined() -> None:
    """The parameter shapes the first value's response; the second value keeps its own column."""
    hypotheses = Hypotheses([("data",), *(probe.key for probe in CURVE)], np.zeros(0), frozenset())
    like = next(term for term in hypotheses.catalogue if len(term.parameters) == 2)
    hypotheses.widen(4)

    hypotheses.add_off_grid(like, 3.1, column=3)

    exact = hypotheses.catalogue[-1]
    assert like.parameters == exact.parameters
    assert 3.1 == exact.at
    assert [[3], [2]] == [np.flatnonzero(column).tolist() for column in exact.design.T]


def test_a_spline_over_time_keeps_its_knots() -> None:
    """Radii that swing for the whole drive are neither a ramp nor a pulse: there is no span to refine."""
    recording = recording_of(drive(Spec(duration_s=200.0, road="rural"), 6))
    swing = 6e-3 * np.sin(2.0 * np.pi * recording.edges_s[:-1] / 90.0)
    turns = recording.rotation_rad * (1.0 + swing[:, None] * np.array([0.0, 0.0, 1.0, 0.0]))
    study = Study(admitted([replace(recording, rotation_rad=turns)])[0])

    term = plainest_shape(study, study.evidence(), study.hypotheses.nuisance)

    assert term is not None
    assert ("rl", False, False) == (term.place, term.ramp, term.pulse)
    assert term.covariate in ("time", "distance")
