"""A finding that its block-wise variance does not bear out is a suspicion."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.offline.diagnosis.prepared.admission import admitted_readers
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.reporting.findings import report
from tpmsd.offline.diagnosis.robustness.certify import certified
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.diagnosis.stages import examine
from tpmsd.offline.inference.least_squares import Evidence

Examined = tuple[Regression, Selection, Evidence]


@pytest.fixture(scope="module")
def spin() -> Examined:
    """Five minutes in which the front wheels turn 1.2 % faster for 20 s."""
    recording = recording_of(drive(Spec(duration_s=300.0, road="rural", driven="front"), 8))
    times = recording.edges_s[:-1]
    spinning = (times >= 150.0) & (times < 170.0)
    factor = 1.0 + 0.012 * spinning[:, None] * np.array([1.0, 1.0, 0.0, 0.0])
    regression = Regression(
        admitted_readers([replace(recording, rotation_rad=recording.rotation_rad * factor)])[0]
    )
    return examine(regression, lambda share: None)


def test_a_gain_below_its_penalty_by_the_block_wise_variance_makes_no_mismatch(spin: Examined) -> None:
    """With the same evidence: no mismatch and no effect in the model, and no certificate mends it."""
    regression, selection, evidence = spin
    (one,) = selection.chosen

    sure = report(regression, selection, evidence)
    doubted = replace(selection, chosen=(replace(one, admitted_by=-1.0),))
    unsure = report(regression, doubted, evidence)
    asked = certified(regression, doubted, evidence, unsure, 3, np.random.default_rng(5))

    assert ("mismatch", ["finding"]) == (sure.verdict, [finding.status for finding in sure.findings])
    assert 1 == len(sure.model.effects)
    for diagnosis in (unsure, asked):
        assert "consistent" == diagnosis.verdict
        assert ["suspicion"] == [finding.status for finding in diagnosis.findings]
        assert () == diagnosis.model.effects


def test_what_is_less_likely_than_nothing_is_not_suspected(spin: Examined) -> None:
    """A gain far below its penalty by the block-wise variance is not reported, and not in the model."""
    regression, selection, evidence = spin
    (one,) = selection.chosen
    doubted = replace(selection, chosen=(replace(one, admitted_by=-20.0, confidence=1e-9),))
    diagnosis = report(regression, doubted, evidence)

    assert ("consistent", (), ()) == (diagnosis.verdict, diagnosis.findings, diagnosis.model.effects)


def test_a_gain_is_held_against_what_the_model_leaves(spin: Examined) -> None:
    """The same gain is a finding where the model leaves noise, and a suspicion where it leaves as many times
    the expected variance as the gain has nats."""
    regression, selection, evidence = spin
    (one,) = selection.chosen
    fits = report(regression, selection, evidence)
    leaves = replace(fits, model_rms=math.sqrt(one.gain))
    found, doubted = (
        certified(regression, selection, evidence, diagnosis, 5, np.random.default_rng(5)).findings[0]
        for diagnosis in (fits, leaves)
    )
    assert fits.model_rms < 1.2
    assert ("finding", "suspicion") == (found.status, doubted.status)
    assert found.p_value is not None
    assert doubted.p_value is not None
    assert found.p_value == pytest.approx(1.0 / 6.0)
    assert (True, False) == (found.p_value_is_bound, doubted.p_value_is_bound)
