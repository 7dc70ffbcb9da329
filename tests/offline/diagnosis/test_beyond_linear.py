"""Terms that only explain what linearising another leaves are told from those that act."""

from __future__ import annotations

import pytest

from bench.worlds.instruments import observe
from bench.worlds.kinematic import Spec
from tests.offline.diagnosis.recorded import recording_of
from tests.offline.diagnosis.test_found_by_name import driven, smoothed
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.diagnosis.prepared.admission import admitted_readers
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.refinement.beyond_linear import gain_beyond_linear, prune_by_exact_responses
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.stages import with_estimated_noise
from tpmsd.offline.inference.noise_fit import SearchStage
from tpmsd.offline.inference.recording import Recording

LAG, SMOOTHING = "velocity_lag", "gnss_smoothing"


def late(lag_s: float, time_constant_s: float = 0.0) -> Recording:
    """A quiet receiver whose speed and course are late and, where asked for, smoothed."""
    spec = Spec(
        duration_s=240.0, road="city", stops=True, doppler_age_s=lag_s, doppler_mps=0.02, doppler_tau_s=0.05
    )
    trip, rng = driven(spec, 5)
    seen = observe(trip, spec, rng, 5)
    return recording_of(smoothed(seen, time_constant_s) if time_constant_s else seen)


@pytest.mark.parametrize(("time_constant_s", "stay"), [(0.0, {LAG}), (1.0, {LAG, SMOOTHING})])
def test_a_low_pass_stays_beside_a_lag_where_there_is_one(time_constant_s: float, stay: set[str]) -> None:
    """Linearised, a lag of 0.4 s looks like one of 0.26 s with a low-pass; one of 1 s is there."""
    regression = Regression(admitted_readers([late(0.4, time_constant_s)])[0])
    regression = with_estimated_noise(regression, regression.hypotheses.fullest_design, SearchStage.FIRST)
    evidence = regression.evidence()
    both = [term for term in regression.hypotheses.catalogue if term.effect in (LAG, SMOOTHING)]
    linear = Selector(evidence, regression.hypotheses).selection_of(both)
    assert {LAG, SMOOTHING} == {one.term.effect for one in linear.chosen}

    assert stay == {one.term.effect for one in prune_by_exact_responses(regression, linear, evidence).chosen}


def test_a_long_lag_is_reported_with_its_size() -> None:
    """0.4 s, and not 0.32 s beside a low-pass of 0.08 s."""
    diagnosis = diagnose([late(0.4)])

    (finding,) = diagnosis.findings
    lag = finding.parameters["lag_s"]
    assert LAG == finding.effect
    assert isinstance(lag.value, float) and lag.std is not None
    assert pytest.approx(0.4, abs=3.0 * lag.std) == lag.value
    assert lag.std < 0.01
    assert not diagnosis.notes


def test_what_is_beyond_the_linear_is_what_the_forward_model_says() -> None:
    """Of a lag that acts, its shift explains what its slope leaves; of a low-pass in its place, less."""
    regression = Regression(admitted_readers([late(0.4)])[0])
    regression = with_estimated_noise(regression, regression.hypotheses.fullest_design, SearchStage.FIRST)
    evidence = regression.evidence()
    lag, smoothing = (
        next(term for term in regression.hypotheses.catalogue if term.effect == name)
        for name in (LAG, SMOOTHING)
    )
    selector = Selector(evidence, regression.hypotheses)
    exactly = {
        term: selector.gain([term]) + gain_beyond_linear(regression, selector, [term])
        for term in (lag, smoothing)
    }
    judged = [
        Selector(evidence, regression.hypotheses, beyond=more).selection_of([lag]).chosen[0]
        for more in (lambda terms: 0.0, lambda terms: gain_beyond_linear(regression, selector, terms))
    ]

    assert gain_beyond_linear(regression, selector, []) == pytest.approx(0.0, abs=1e-6)
    assert gain_beyond_linear(regression, selector, [lag]) > 20.0
    assert exactly[lag] > exactly[smoothing] + 20.0
    assert judged[0].confidence <= judged[1].confidence
