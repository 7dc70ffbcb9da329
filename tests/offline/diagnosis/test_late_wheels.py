"""Wheel speeds behind a low-pass, against fixes that are old on arrival: one delay to first order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.catalogue import make_effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.diagnosis.prepared.admission import admitted_readers
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.refinement.beyond_linear import prune_by_exact_responses
from tpmsd.offline.diagnosis.refinement.damped import damped_values
from tpmsd.offline.diagnosis.refinement.relinearise import relinearised
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.stages import with_estimated_noise
from tpmsd.offline.inference.noise_fit import SearchStage
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.windows import Reader

FILTER = "wheel_speed_filter"


def smoothed(seed: int, tau_s: float, latency_s: float) -> Recording:
    """City traffic whose control unit smooths its speeds by `tau_s`, and fixes that are `latency_s` old."""
    spec = Spec(duration_s=170.0, road="city", stops=True, doppler_mps=0.02, doppler_tau_s=0.05)
    recording = recording_of(drive(spec, seed))
    b, a = bilinear([1.0], [tau_s, 1.0], 1.0 / recording.dt_s)
    turns = lfilter(b, a, np.nan_to_num(recording.rotation_rad), axis=0)
    return replace(
        recording,
        rotation_rad=turns,
        quantum_rad=np.zeros(4),
        fix_time_s=recording.fix_time_s + latency_s,
    )


def test_with_a_low_pass_the_motion_changes_and_not_what_the_wheels_show() -> None:
    """Behind its own low-pass the restored motion shows the speeds of the reference: the receiver's are ahead
    of them by the constant times the acceleration.
    """
    recording = smoothed(3, 0.3, 0.0)
    reader = Reader(recording, reference(recording))
    model = ExtendedModel((make_effect(FILTER, time_constant_s=0.3),))
    plain, restored = reader.predict(ExtendedModel()), reader.predict(model)
    accel = reader.windows.covariates["accel_kinematic"]
    ahead = restored[:, 5] - plain[:, 5]
    known = np.isfinite(ahead)

    assert restored[:, :4].mean(axis=1) == pytest.approx(plain[:, :4].mean(axis=1), abs=2e-3)
    assert np.polyfit(accel[known], ahead[known], 1)[0] == pytest.approx(0.3, abs=0.015)


def test_what_cancels_to_first_order_must_act_as_it_says() -> None:
    """A rough road and no gyro: a low-pass of 3.3 s and fixes as old gain thirty nats together by what little
    differs in their linear responses, but as they act they are far off."""
    spec = Spec(duration_s=240.0, road="motorway", doppler_mps=0.03, doppler_tau_s=3.0, receiver_hz=4.0)
    plain = recording_of(drive(spec, 2))
    shape = plain.rotation_rad.shape
    rough = plain.rotation_rad + 0.1 * plain.dt_s * np.random.default_rng(2).normal(size=shape)
    blind = {**plain.inertial, "yaw_rate_radps": np.full(plain.ticks, np.nan)}
    recording = replace(plain, rotation_rad=rough, quantum_rad=np.zeros(4), inertial=blind)
    regression = Regression(admitted_readers([recording])[0])
    regression = with_estimated_noise(regression, regression.hypotheses.fullest_design, SearchStage.FIRST)
    selector = Selector(regression.evidence(), regression.hypotheses, last=True)
    regression = relinearised(regression, selector.selection_of([]))
    evidence = regression.evidence()
    selector = Selector(evidence, regression.hypotheses, last=True)
    pair = [one for one in regression.hypotheses.catalogue if one.effect in (FILTER, "gnss_latency")]
    linear = selector.selection_of(pair)
    assert 2 == len(linear.chosen)

    assert () == prune_by_exact_responses(regression, linear, evidence, last=True).chosen


def test_a_step_is_no_longer_than_the_exact_likelihood_allows() -> None:
    """Of a fit three times as far as the low-pass of 0.3 s, half is taken, or a quarter."""
    regression = Regression(admitted_readers([smoothed(5, 0.3, 0.0)])[0])
    regression = with_estimated_noise(regression, regression.hypotheses.fullest_design, SearchStage.FIRST)
    term = next(one for one in regression.hypotheses.catalogue if one.effect == FILTER)
    fair = Selector(regression.evidence(), regression.hypotheses).selection_of([term])
    far = replace(fair, fit=replace(fair.fit, values=3.0 * fair.fit.values))
    shorter = damped_values(regression, far)

    assert damped_values(regression, fair) is None
    assert shorter is not None
    assert shorter[-1] == pytest.approx(0.5 * far.fit.values[-1]) or shorter[-1] == pytest.approx(
        0.25 * far.fit.values[-1]
    )


def test_a_low_pass_is_found_with_its_size_and_no_latency() -> None:
    """0.3 s, by wheels that are read beside a gyro."""
    (one,) = diagnose([smoothed(5, 0.3, 0.0)]).findings
    value = one.parameters["time_constant_s"].value

    assert one.effect == FILTER
    assert isinstance(value, float)
    assert value == pytest.approx(0.3, abs=0.03)
