"""Spline terms: enough knots, a constant of their own, the right wheels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.worlds.instruments import observe
from bench.worlds.kinematic import Spec, course, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.offline.diagnosis.assessment.result import RollingDiagnosis
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.diagnosis.hypotheses.response import finer_knots, hat_functions
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.windows import Reader


def diagnosed(seed: int, spec: Spec) -> RollingDiagnosis:
    """The diagnosis of a drive of the tests' own world."""
    return diagnose([recording_of(drive(spec, seed))])


def test_a_narrow_dip_is_found_in_its_place_and_size() -> None:
    """Its depth to a quarter, its speed to the spacing of the knots."""
    dip = {"at_mps": 17.0, "width_mps": 1.5, "wheels": [0, 1], "size_m": -1.4e-3}
    diagnosis = diagnosed(41, Spec(duration_s=600.0, physics={"strange_speed_hump": dip}))

    assert ["unknown"] == [finding.effect for finding in diagnosis.findings]
    finding = diagnosis.findings[0]
    assert (("fl", "fr"), "speed") == (finding.where.wheels, finding.where.covariate)
    speeds, heights = (np.array(x) for x in list(zip(*finding.shape, strict=True))[:2])
    assert speeds[np.argmin(heights)] == pytest.approx(17.0, abs=1.5)
    assert np.ptp(heights) == pytest.approx(1.4e-3, rel=0.25)


def test_a_dip_narrower_than_the_first_knots_does_not_pass_for_noise() -> None:
    """Between the few knots of the first look it left so much that 12,000 nats were no finding."""
    dip = {"at_mps": 17.0, "width_mps": 0.8, "wheels": [0, 1], "size_m": -1.4e-3}
    spec = Spec(duration_s=600.0, road="rural", physics={"strange_speed_hump": dip})
    diagnosis = diagnosed(45, spec)

    assert ["unknown"] == [finding.effect for finding in diagnosis.findings]
    finding = diagnosis.findings[0]
    assert (("fl", "fr"), "speed") == (finding.where.wheels, finding.where.covariate)
    speeds, heights = (np.array(x) for x in list(zip(*finding.shape, strict=True))[:2])
    assert speeds[np.argmin(heights)] == pytest.approx(17.0, abs=0.8)
    assert finding.gain > 4000.0


def test_a_gyro_that_bends_needs_no_bias_beside_it() -> None:
    """A shape of the gyro's reading holds its own constant."""
    spec = Spec(duration_s=600.0, road="rural", physics={"strange_gyro_square": {"per_rad": 0.6}})
    diagnosis = diagnosed(43, spec)

    assert ["unknown"] == [finding.effect for finding in diagnosis.findings]
    assert ("yaw_rate", "yaw_rate") == (
        diagnosis.findings[0].where.channel,
        diagnosis.findings[0].where.covariate,
    )


def test_a_warm_up_longer_than_the_drive_has_an_interval_that_says_so() -> None:
    """All long time constants do alike within ten minutes: the interval reaches to the true one."""
    truth = {"amplitude_m": 2.5e-3, "time_constant_s": 1500.0}
    diagnosis = diagnosed(44, Spec(duration_s=700.0, physics={"thermal_growth": truth}))

    assert "thermal_growth" == diagnosis.findings[0].effect
    for name, value in truth.items():
        quantity = diagnosis.findings[0].parameters[name]
        assert isinstance(quantity.value, float)
        assert quantity.std is not None
        assert abs(quantity.value - value) < 1.96 * quantity.std


def test_finer_knots_reach_into_the_tails_and_never_stand_on_too_little() -> None:
    """Most readings near nothing, few far out: knots on both, each interval with its readings."""
    rng = np.random.default_rng(5)
    values = np.concatenate([rng.normal(0.0, 0.02, 900), rng.uniform(-3.0, 2.0, 100)])
    knots = finer_knots(values, 20)

    counts = np.histogram(values, np.concatenate([[-np.inf], knots[1:-1], [np.inf]]))[0]
    assert int(counts.min()) >= SETTINGS.hypotheses.fewest_between_knots
    assert np.count_nonzero(np.abs(knots) > 0.5) >= 5
    assert hat_functions(values, knots).sum(axis=1) == pytest.approx(np.ones(len(values)))


def test_brakes_of_another_balance_than_the_engine_get_their_names() -> None:
    """Each axle slips in its own way: the slip under drive and what brakes add to it, and no receiver is late
    because of it."""
    spec = Spec(duration_s=800.0, road="mixed")
    rng = np.random.default_rng(51)
    plain = course(spec, rng)
    drives, brakes = np.maximum(plain.accel, 0.0), np.minimum(plain.accel, 0.0)
    drag = 4e-6 * plain.speed**2
    front, rear = 9e-3 * drives + 6e-3 * brakes + drag, 3e-3 * brakes
    spin = np.stack([front, front, rear, rear], axis=1)
    slipping = replace(plain, spin=spin)
    diagnosis = diagnose([recording_of(observe(slipping, spec, rng, 51))])

    assert ["longitudinal_slip", "brake_slip"] == [finding.effect for finding in diagnosis.findings]
    assert "accel_long" == diagnosis.findings[0].where.covariate
    found = {**diagnosis.findings[0].parameters, **diagnosis.findings[1].parameters}
    truth = {"slip_per_accel": 9e-3, "slip_per_speed2": 4e-6, "front": -3e-3, "rear": 3e-3}
    for name, value in truth.items():
        quantity = found[name]
        assert isinstance(quantity.value, float)
        assert quantity.std is not None
        assert pytest.approx(value, abs=3.0 * quantity.std + 0.02 * abs(value)) == quantity.value


def test_a_shape_that_is_hardly_better_than_two_effects_gets_their_names() -> None:
    """Slips that bend under force: the spline brings a thousandth more than drive and brake slip do, less
    than its handicap."""
    spec = Spec(duration_s=300.0, road="mixed", driven="rear", stops=True)
    rng = np.random.default_rng(8)
    plain = course(spec, rng)
    bent = plain.force * (1.0 + np.abs(plain.force))
    drives, brakes = np.maximum(bent, 0.0), np.minimum(bent, 0.0)
    front, rear = 5e-3 * brakes, 6e-3 * drives + 3e-3 * brakes
    slipping = replace(plain, spin=np.stack([front, front, rear, rear], axis=1))
    recording = recording_of(observe(slipping, spec, rng, 8))
    regression = Regression([Reader(recording, reference(recording))])
    selector = Selector(regression.evidence(), regression.hypotheses)
    shape = next(
        terms
        for _, terms in selector.candidates([])
        if terms[0].nonparametric and "accel_long" == terms[0].covariate
    )
    penalised_gain, _ = selector.pairs_over("accel_long", [])[0]

    assert selector.gain(shape) - shape[0].penalty > selector.gain([]) + penalised_gain
    assert {"brake_slip", "longitudinal_slip"} == {
        term.effect for term in selector._with_effects_for_splines(shape)
    }
