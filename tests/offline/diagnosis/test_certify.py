"""The certificate of findings: replicates, p-values, false discoveries."""

from __future__ import annotations

import dataclasses
from fractions import Fraction

import numpy as np
import pytest
from scipy.stats import gumbel_r, kstest

from bench.worlds.instruments import Drive
from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import PER_TICK, recording_of
from tpmsd.car.physics.catalogue import make_effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.offline.diagnosis.assessment.result import Quantity, RollingDiagnosis
from tpmsd.offline.diagnosis.diagnose import Certification, diagnose, examine
from tpmsd.offline.diagnosis.hypotheses.one_drive import DriveHypotheses
from tpmsd.offline.diagnosis.hypotheses.terms import Hypotheses, Term
from tpmsd.offline.diagnosis.prepared.admission import admitted_readers
from tpmsd.offline.diagnosis.prepared.drive_regression import initial_noise
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.reporting.findings import report
from tpmsd.offline.diagnosis.robustness import certify
from tpmsd.offline.diagnosis.robustness.certify import certified
from tpmsd.offline.diagnosis.robustness.negative_control import negative_control
from tpmsd.offline.diagnosis.robustness.p_value import (
    counted_p_value,
    discoveries,
    estimate_p_value,
    is_decided,
    tail_probability,
)
from tpmsd.offline.diagnosis.robustness.verdict import without_suspicions
from tpmsd.offline.diagnosis.selection.candidates import Candidates
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import Evidence, part
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.replicate import replicate
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.windows import COURSE, EAST, GYRO, SPEED, Reader


@pytest.fixture(scope="module")
def recording() -> Recording:
    """Six minutes of a car whose tyres feel the bends."""
    physics: dict[str, dict[str, object]] = {"load_transfer_lateral": {"coefficient": 2e-4}}
    return recording_of(drive(Spec(duration_s=360.0, road="rural", physics=physics), 21))


@pytest.fixture(scope="module")
def diagnosis(recording: Recording) -> RollingDiagnosis:
    """With a certificate."""
    return diagnose([recording], certify=Certification(9, np.random.default_rng(1)))


@pytest.fixture(scope="module")
def plain(recording: Recording) -> RollingDiagnosis:
    """Without one."""
    return diagnose([recording])


def test_a_strong_effect_is_certified(diagnosis: RollingDiagnosis) -> None:
    """No replicate reaches it, it is a finding, and drawing stops before the most that was allowed."""
    finding = diagnosis.findings[0]

    assert ("load_transfer_lateral", "finding", "mismatch") == (
        finding.effect,
        finding.status,
        diagnosis.verdict,
    )
    assert finding.p_value == pytest.approx(1.0 / (diagnosis.replicates + 1))
    assert finding.p_value_is_bound
    assert diagnosis.replicates < 9


def test_an_effect_without_a_parameter_is_certified() -> None:
    """Replicates of a hilly drive are shortened by its slopes, as the recording is: these are a finding."""
    spec = Spec(duration_s=480.0, road="hills", hilly=0.07, teeth=96, doppler_mps=0.02, receiver_hz=10.0)
    hilly = recording_of(drive(spec, 5))
    found = diagnose([hilly], certify=Certification(9, np.random.default_rng(1))).findings

    assert [("road_grade", "finding")] == [(one.effect, one.status) for one in found]
    assert found[0].p_value_is_bound


def test_a_spline_beyond_the_linear_is_certified() -> None:
    """Front tyres that change by 1.2e-4 s3/m * v * a_y are no effect's: `unknown`, and a finding also where
    the drive leaves a dispersion of 100.

    What such a spline does beyond its linear response is hundreds of nats: it is none of chance's.
    """
    made = drive(Spec(duration_s=420.0, road="rural", receiver_hz=10.0, teeth=96), 12)
    plain = recording_of(made)
    readers, notes = admitted_readers([_of_strange_tyres(made, plain)])
    regression, selection, evidence = examine(Regression(readers), lambda share: None)
    noisy = dataclasses.replace(report(regression, selection, evidence, notes), model_rms=10.0)
    again = certified(regression, selection, evidence, noisy, 7, np.random.default_rng(1)).findings[0]

    assert ("unknown", "finding") == (again.effect, again.status)
    assert again.p_value == pytest.approx(1.0 / 8.0)
    assert again.p_value_is_bound


def _of_strange_tyres(made: Drive, plain: Recording) -> Recording:
    """The recording with front tyres that change by 1.2e-4 s3/m * v * a_y."""
    ticks = slice(0, PER_TICK * len(plain.rotation_rad), PER_TICK)
    change = 1.2e-4 * made.speed[ticks] ** 2 * made.yaw_rate[ticks] / plain.car.radius_m[0]
    rotation = plain.rotation_rad.copy()
    rotation[:, :2] *= 1.0 - change[:, None]
    return dataclasses.replace(plain, rotation_rad=rotation)


def test_a_true_effect_beside_a_spline_is_certified(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fix that is 0.2 s old beside those tyres is a finding; where replicates that hold the tyres' spline
    reach it, it is tested again in replicates without, which hold the latency alone."""
    physics: dict[str, dict[str, object]] = {"gnss_latency": {"latency_s": 0.2}}
    spec = Spec(duration_s=420.0, road="rural", receiver_hz=10.0, teeth=96, physics=physics)
    made = drive(spec, 12)
    readers, notes = admitted_readers([_of_strange_tyres(made, recording_of(made))])
    regression, selection, evidence = examine(Regression(readers), lambda share: None)
    before = report(regression, selection, evidence, notes)
    sure = certified(regression, selection, evidence, before, 1, np.random.default_rng(1)).findings
    models: list[ExtendedModel] = []

    def seven(
        regression: Regression, drawn: list[ExtendedModel], statistics: list[object], *rest: object
    ) -> object:
        models.extend(drawn)
        return [[0.0] * 7 for _ in statistics]

    monkeypatch.setattr(certify, "_statistics_of_replicates", seven)
    often = [estimate_p_value(0.0, [1.0] * 7) for _ in before.findings]
    again = certify._p_values_without_splines(
        regression, selection, evidence, before.findings, often, 1.0, 7, np.random.default_rng(1)
    )
    (late,) = (k for k, one in enumerate(before.findings) if one.effect == "gnss_latency")

    assert ("finding", 0.5) == (sure[late].status, sure[late].p_value)
    assert again[late].p_value == pytest.approx(1.0 / 8.0)
    assert ["gnss_latency"] == [effect.name for effect in models[0]]


def test_without_a_certificate_there_is_no_p_value(plain: RollingDiagnosis) -> None:
    """None asked for, or no replicates: a finding stays one."""
    finding = plain.findings[0]

    assert (None, "finding") == (finding.p_value, finding.status)


def test_what_was_not_chosen_is_compared_with_chance_too(
    diagnosis: RollingDiagnosis, plain: RollingDiagnosis
) -> None:
    """Beside the effect that acts, the best of all others is what replicates make as well."""
    assert plain.remaining is None
    assert diagnosis.remaining is not None
    assert diagnosis.remaining.p_value > 0.05
    assert diagnosis.remaining.exceeded <= diagnosis.remaining.replicates == diagnosis.replicates


def test_a_replicate_is_the_drive_with_new_errors(recording: Recording) -> None:
    """Its residuals scatter as the noise says that they were drawn from, channel by channel."""
    reader = Reader(recording, reference(recording))
    noise = dataclasses.replace(
        initial_noise(reader), gyro_radps=4e-3, speed_mps=0.2, cross_mps=0.1, slow_m=3.0, rough_m=2e-3
    )
    again = replicate(reader, ExtendedModel(), noise, np.random.default_rng(2))
    windows = Reader(again, reader.reference).windows
    left = windows.measured - Reader(again, reader.reference).predict(ExtendedModel())
    speed = windows.covariates["speed"]
    distance = np.sqrt(noise.rough_m**2 * speed + 2.0 * np.square(noise.reading_m[0]))

    assert np.std(left[:, 0] / distance) == pytest.approx(1.0, rel=0.15)
    assert np.std(left[:, GYRO]) == pytest.approx(noise.gyro_radps, rel=0.15)
    assert np.nanstd(left[:, SPEED]) == pytest.approx(noise.speed_mps, rel=0.25)
    assert np.nanstd(left[:, COURSE] * speed) == pytest.approx(noise.cross_mps, rel=0.25)
    assert 1.0 < np.nanstd(left[:, EAST]) < 5.0
    assert recording.inertial["accel_lat_mps2"] is again.inertial["accel_lat_mps2"]


def test_a_replicate_of_a_car_far_off_holds_chance_alone(recording: Recording) -> None:
    """Two fine encoders, one on a wheel 8 % too large: nothing is left that any hypothesis would explain."""
    far = dataclasses.replace(
        recording,
        rotation_rad=recording.rotation_rad * np.array([np.nan, np.nan, 44.0 / 48.0, 1.0]),
        quantum_rad=np.full(4, 1e-4),
        inertial={**recording.inertial, "yaw_rate_radps": np.full(recording.ticks, np.nan)},
    )
    regression = Regression([Reader(far, reference(far))])
    (drive,) = regression.drives
    nothing = ExtendedModel()
    drawn = replicate(drive.reader, nothing, drive.noise, np.random.default_rng(4))

    evidence = Evidence([drive.of_replicate(drawn, nothing).drive_grams()], regression.width)

    best, _ = Candidates(evidence, regression.hypotheses).candidates([])[0]
    assert best < SETTINGS.selection.admit_nats


def test_tails_are_uniform_where_nothing_is_to_find() -> None:
    """Of values from the maxima's own distribution; never too small by more than the doubt of few draws."""
    rng = np.random.default_rng(3)
    drawn = gumbel_r.rvs(size=(400, 20), random_state=rng)
    values = [tail_probability(float(row[0]), [float(x) for x in row[1:]]) for row in drawn]

    assert kstest(values, "uniform").statistic < 0.1
    assert np.mean(np.array(values) < 0.01) <= 0.01


def test_p_values_are_no_smaller_than_replicates_support() -> None:
    """Whatever the maxima's distribution: at most a share a of null values has a p-value of a or less."""
    rng = np.random.default_rng(4)
    drawn = rng.standard_cauchy(size=(2000, 10))
    values = np.array([estimate_p_value(float(row[0]), list(row[1:])).p_value for row in drawn])

    assert values.min() == pytest.approx(0.1)
    for level in (0.1, 0.2, 0.3):
        assert np.mean(values <= level + 1e-9) < level + 0.02


@pytest.mark.parametrize("most", [19, 199])
def test_p_values_with_early_stopping_are_those_of_ranks(most: int) -> None:
    """Of a null value and its replicates every order is as likely, and drawing ends with the third beyond it.

    Each p-value that this can give is then exactly the probability of that p-value or less, whatever the
    distribution: k + 1 of m + 2 ranks put the next replicate beyond the value.
    """
    orders, at = {0: Fraction(1)}, dict[Fraction, Fraction]()
    for drawn in range(most):
        further = dict[int, Fraction]()
        for k, chances in orders.items():
            beyond = Fraction(k + 1, drawn + 2)
            for reached, share in ((k + 1, beyond), (k, 1 - beyond)):
                maxima = [1.0] * reached + [-1.0] * (drawn + 1 - reached)
                if (is_decided(0.0, maxima) and reached > k) or drawn + 1 == most:
                    reported = Fraction(counted_p_value(0.0, maxima)[0]).limit_denominator(1000)
                    at[reported] = at.get(reported, Fraction(0)) + chances * share
                else:
                    further[reached] = further.get(reached, Fraction(0)) + chances * share
        orders = further

    total = Fraction(0)
    for reported in sorted(at):
        total += at[reported]
        assert total == reported
    assert min(at) == Fraction(1, most + 1)
    assert total == 1


def test_a_value_that_chance_often_reaches_is_no_discovery() -> None:
    """Counted where replicates reach it; beyond all of them by the tail, the wider the fewer there are."""
    often, once, never = (
        estimate_p_value(1.0, maxima) for maxima in ([0.0, 2.0, 2.0, 2.0], [0.0, 0.0, 2.0], [0.0] * 7)
    )

    assert (0.75, False, 0.75) == (often.p_value, often.is_bound, often.tail)
    assert (0.5, False, 0.5) == (once.p_value, once.is_bound, once.tail)
    assert (0.125, True) == (never.p_value, never.is_bound)
    tails = [tail_probability(12.0, [0.0] * count) for count in (1, 3, 9)]
    assert tails[0] > tails[1] > tails[2]
    assert tail_probability(50.0, [0.0, 1.0] * 4) < 1e-6


def test_a_test_of_its_own_bounds_its_chance() -> None:
    """No decision and no p-value is below the probability of the test's own distribution."""
    one = estimate_p_value(1000.0, [0.0] * 9, own=0.3)

    assert (0.3, False, 0.3) == (one.p_value, one.is_bound, one.tail)


def test_false_discoveries_are_held_as_benjamini_and_hochberg_do() -> None:
    """Their example of 1995 (section 4.2): at 5 %, four of fifteen."""
    p = [1e-4, 4e-4, 0.0019, 0.0095, 0.0201, 0.0278, 0.0298, 0.0344, 0.0459, 0.324]
    p += [0.4262, 0.5719, 0.6528, 0.7590, 1.0]

    assert [True] * 4 + [False] * 11 == discoveries(p, 0.05)
    assert [False, True] == discoveries([0.2, 0.001], 0.05)


def test_what_noise_makes_as_well_is_a_suspicion(recording: Recording, plain: RollingDiagnosis) -> None:
    """A chosen effect whose gain noise reaches in most replicates makes no mismatch and leaves the model."""
    reader = Reader(recording, reference(recording))
    regression, selection, evidence = examine(Regression([reader]), lambda share: None)
    weak = dataclasses.replace(selection.chosen[0], gain=0.5)
    doubtful = dataclasses.replace(selection, chosen=(weak,))
    out = certified(regression, doubtful, evidence, plain, 9, np.random.default_rng(5))

    assert ("suspicion", "consistent", 0) == (out.findings[0].status, out.verdict, len(out.model))


def test_covariates_that_cannot_act_gain_nothing(diagnosis: RollingDiagnosis) -> None:
    """Reversed in time they bring less than they cost."""
    assert diagnosis.control is not None
    assert diagnosis.control < 0.0


def test_the_negative_control_sees_noise_that_is_believed_too_small(recording: Recording) -> None:
    """under a noise model of a third of the true standard deviations chance brings far more than it costs."""
    found = examine(Regression([Reader(recording, reference(recording))]), lambda share: None)
    noise = found.regression.drives[0].noise
    small = dataclasses.replace(
        noise,
        reading_m=tuple(0.3 * one for one in noise.reading_m),
        rough_m=0.3 * noise.rough_m,
        gyro_radps=0.3 * noise.gyro_radps,
        speed_mps=0.3 * noise.speed_mps,
        cross_mps=0.3 * noise.cross_mps,
    )

    calm = negative_control(found.regression, found.selection)
    assert calm < 0.0 < negative_control(found.regression.with_noise({0: small}), found.selection)


def test_only_what_a_suspicion_tells_of_leaves_the_model(diagnosis: RollingDiagnosis) -> None:
    """Effects of the model are found by name and values, however many findings have none of their own."""
    model = ExtendedModel(
        (make_effect("load_transfer_lateral", coefficient=2e-4), make_effect("gnss_latency", latency_s=0.1))
    )
    finding = diagnosis.findings[0]
    doubtful = dataclasses.replace(
        finding, parameters={"coefficient": Quantity(2e-4, None, "s2")}, status="suspicion"
    )
    other = dataclasses.replace(doubtful, parameters={"coefficient": Quantity(3e-4, None, "s2")})

    assert ["gnss_latency"] == [
        effect.name for effect in without_suspicions(model, [doubtful, other, finding])
    ]
    assert 2 == len(without_suspicions(model, [finding, other]))


def test_gains_are_studentised_by_what_blocks_scatter() -> None:
    """Of two equal terms the one whose score scatters from block to block as independent windows do keeps its
    gain; where 25 windows of each block err alike, little of it is left, and the other one is the largest."""
    rng = np.random.default_rng(6)
    blocks = np.repeat(np.arange(30), 25)
    rows = rng.standard_normal((750, 2, 3))
    rows[:, 0, 1] = rows[:, 1, 2] = 0.3
    rows[:, 1, 1] = rows[:, 0, 2] = 0.0
    rows[:, 0, 0] += 0.6 + rng.standard_normal(30)[blocks]
    rows[:, 1, 0] += 0.2
    evidence = Evidence([part(rows, blocks)], 3)
    search = Candidates(evidence, _nothing_but_calibration(evidence))
    terms = [Term("gnss_latency", evidence.unit(k), ("latency_s",), 3.5) for k in (1, 2)]
    nets = [search.gain([term]) - term.penalty for term in terms]
    similar, independent = (
        search.studentised_gain([], term, net) for term, net in zip(terms, nets, strict=True)
    )

    assert nets[0] > 3.0 * nets[1]
    assert independent == pytest.approx(nets[1], rel=0.5)
    assert similar < min(independent, 0.2 * nets[0])


def _nothing_but_calibration(evidence: Evidence) -> Hypotheses:
    hypotheses = DriveHypotheses([("data",), ("a",), ("b",)], np.linspace(0.0, 1.0, 41), frozenset())
    hypotheses.nuisance = np.zeros((evidence.width, 0))
    return hypotheses
