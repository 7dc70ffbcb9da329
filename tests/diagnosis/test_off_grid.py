"""A term whose nonlinear parameter is moved off its grid."""

from __future__ import annotations

import numpy as np

from tpmsd.diagnosis.hypotheses.terms import Hypotheses
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
