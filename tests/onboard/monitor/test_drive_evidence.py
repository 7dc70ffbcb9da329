"""A drive as a whole: changes beside all that is harmless, and what is confounded with a loss."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.onboard.monitor.drives import RADIUS_M, VEHICLE
from tpmsd.car.config.model import MonitorConfig, TyreConfig
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.alarms.judge import Judge, Judgement
from tpmsd.onboard.monitor.baseline.baseline import Change
from tpmsd.onboard.monitor.baseline.reference import (
    CAR,
    DRAG,
    GROWTH,
    HILL,
    KNOTS_MPS,
    SIZE,
    RadiusReference,
    speed_weights,
)
from tpmsd.onboard.monitor.evidence.change_bank import ChangeBank
from tpmsd.onboard.monitor.evidence.sizes import unchanged_sizes
from tpmsd.onboard.monitor.sampling.conditions import Conditions
from tpmsd.onboard.monitor.sampling.drive_evidence import ChangeHypotheses, DriveEvidence
from tpmsd.onboard.monitor.sampling.slip_sums import Slope
from tpmsd.onboard.monitor.settings import DRIVE_EVIDENCE, JUDGE

WHEELS = [0, 1, 2, 3]
RADIUS = np.full(4, RADIUS_M)
USUAL = unchanged_sizes(4)
NOISE_M = 1.5e-4
"""Of an estimate, each wheel."""
KNOWN_SHARE = 0.1
"""Of the prior standard deviations: how well the car has been learned where nothing else is said."""
SPEEDS = 33.0 + 9.0 * np.sin(np.arange(60) / 3.0)
"""An autobahn, m/s."""


def learned_car(known_share: float | None = None) -> RadiusReference:
    """Radii and slip are learned; growth is not unless a share is given, as the car was never driven fast."""
    reference = RadiusReference(VEHICLE)
    scale = np.full(SIZE, known_share or KNOWN_SHARE)
    scale[CAR:] = 1.0
    if known_share is None:
        scale[GROWTH] = 1.0
    reference.covariance = reference.covariance * np.outer(scale, scale)
    return reference


def at(speed_mps: float) -> Conditions:
    return Conditions(speed_mps**2, 0.0, (0.0, 0.0), 0.0, 0.0)


def judged(
    truth: FloatArray, extra: FloatArray, seed: int = 1, known_share: float | None = None
) -> Judgement:
    """Of a drive in which the parameters are `truth` (SIZE,) and `extra` (n, 4) m comes on top."""
    rng = np.random.default_rng(seed)
    reference = learned_car(known_share)
    evidence = DriveEvidence(reference, WHEELS, RADIUS)
    noise_m2 = np.eye(4) * NOISE_M**2
    for speed, more in zip(SPEEDS, extra, strict=True):
        features = reference.features(at(float(speed)))
        seen = features @ truth * RADIUS_M + more + rng.normal(0.0, NOISE_M, 4)
        evidence.update(seen, noise_m2, np.zeros((4, 4)), features, 20.0)
    expected, spread = reference.expected(at(float(SPEEDS[-1])))
    change = Change(seen - expected, spread + noise_m2, 1, noise_m2, True)
    mean = Change(seen - expected, spread + noise_m2, JUDGE.full_samples, noise_m2, True)
    judge = Judge(VEHICLE, MonitorConfig(), TyreConfig(), WHEELS)
    return judge.judge(change, mean, change_hypotheses=evidence.change_hypotheses)


def test_changes_are_those_of_generalised_least_squares() -> None:
    """Size, covariance and likelihood are those of one regression over all samples at once, parameters with
    their prior and the change without one."""
    rng = np.random.default_rng(4)
    reference = learned_car()
    mean, prior = reference.mean.copy(), reference.covariance.copy()
    bank = ChangeBank(reference.copy(), np.zeros((4, 4)))
    rows = [reference.features(at(float(v))) for v in SPEEDS[:12]]
    noise = np.eye(4) * 4e-4**2
    seen = [row @ mean + rng.normal(0.0, 1e-3, 4) for row in rows]
    for row, sample in zip(rows, seen, strict=True):
        bank.update(sample, noise, row, 0.0, USUAL)
    h, y = np.vstack(rows), np.concatenate(seen)
    whole = h @ prior @ h.T + np.kron(np.eye(12), noise)
    precision, off = np.linalg.inv(whole), y - h @ mean
    likelihood = -0.5 * off @ precision @ off - 0.5 * np.linalg.slogdet(whole)[1]
    assert likelihood == pytest.approx(bank.log_likelihood, rel=1e-9)
    found = bank.changes(USUAL)
    change, covariance = found.change[0], found.covariance[0]
    assert 1.0 == pytest.approx(float(np.exp(found.log_weight).sum()))
    old = np.flatnonzero(12 - bank._onset >= JUDGE.full_samples)
    assert {False, True} == set(bank._ramp[old].tolist())
    for index, place in enumerate(old):
        onset = int(bank._onset[place])
        since = np.arange(12.0) - onset
        share = np.maximum(since, 0.0) if bank._ramp[place] else (since >= 0.0).astype(float)
        design = np.kron(share[:, None], np.eye(4)) / float(share[-1])
        information = design.T @ precision @ design
        size = np.linalg.solve(information, design.T @ precision @ off)
        assert size == pytest.approx(change[index], rel=1e-4, abs=1e-8)
        assert np.linalg.inv(information) == pytest.approx(covariance[index], rel=1e-4, abs=1e-12)


def test_what_all_but_the_last_samples_say_is_what_was_said_before_them() -> None:
    """The beginning of a drive before its last n samples is the last one of a drive that ended there."""

    def taken(samples: int) -> DriveEvidence:
        rng = np.random.default_rng(7)
        reference = learned_car()
        evidence = DriveEvidence(reference, WHEELS, RADIUS)
        for speed in SPEEDS[:samples]:
            features = reference.features(at(float(speed)))
            seen = features @ reference.mean + rng.normal(0.0, NOISE_M, 4)
            evidence.update(seen, np.eye(4) * NOISE_M**2, np.zeros((4, 4)), features, 20.0)
        return evidence

    whole = taken(5)
    for last in range(3):
        before, ended = whole.change_before(last), taken(5 - last).change_before(0)
        assert before is not None
        assert ended is not None
        assert np.array_equal(before.change_m, ended.change_m)
        assert np.array_equal(before.log_weight, ended.log_weight)
    assert whole.change_before(5) is None


@pytest.mark.parametrize("driven", ["front", "rear"])
def test_changes_beside_slip_slopes_are_those_of_generalised_least_squares(driven: str) -> None:
    """The same on a hilly road, with a slip slope after each sample: the slopes are rows more of that
    regression, of the driven axle's slip per force less the other one's, in which no change is."""
    rng = np.random.default_rng(6)
    reference = RadiusReference(replace(VEHICLE, driven_axle=driven))
    mean, prior = reference.mean.copy(), reference.covariance.copy()
    bank = ChangeBank(reference.copy(), np.zeros((4, 4)))
    hills = rng.normal(0.0, 0.5, 12)
    rows = [
        reference.features(replace(at(float(v)), slope_mps2=float(hill)))
        for v, hill in zip(SPEEDS[:12], hills, strict=True)
    ]
    axles = np.zeros((1, SIZE))
    axles[0, HILL] = (-1.0, 1.0) if driven == "front" else (1.0, -1.0)
    noise, slope_std = np.eye(4) * 4e-4**2, 6e-4
    seen = [row @ mean + rng.normal(0.0, 1e-3, 4) for row in rows]
    slopes = rng.normal(9e-3, slope_std, 12)
    for row, sample, slope in zip(rows, seen, slopes, strict=True):
        bank.update(sample, noise, row, 0.0, USUAL)
        bank.update_slip(Slope(float(slope), slope_std**2))
    h = np.vstack([*rows, *[axles] * 12])
    own = np.zeros((60, 60))
    own[:48, :48], own[48:, 48:] = np.kron(np.eye(12), noise), np.eye(12) * slope_std**2
    whole = h @ prior @ h.T + own
    precision, off = np.linalg.inv(whole), np.concatenate([*seen, slopes]) - h @ mean
    likelihood = -0.5 * off @ precision @ off - 0.5 * np.linalg.slogdet(whole)[1]
    assert likelihood == pytest.approx(bank.log_likelihood, rel=1e-9)
    found = bank.changes(USUAL)
    change, covariance = found.change[0], found.covariance[0]
    old = np.flatnonzero(12 - bank._onset >= JUDGE.full_samples)
    for index, place in enumerate(old):
        since = np.arange(12.0) - int(bank._onset[place])
        share = np.maximum(since, 0.0) if bank._ramp[place] else (since >= 0.0).astype(float)
        design = np.vstack([np.kron(share[:, None], np.eye(4)) / float(share[-1]), np.zeros((12, 4))])
        information = design.T @ precision @ design
        size = np.linalg.solve(information, design.T @ precision @ off)
        assert size == pytest.approx(change[index], rel=1e-4, abs=1e-8)
        assert np.linalg.inv(information) == pytest.approx(covariance[index], rel=1e-4, abs=1e-12)


@pytest.mark.parametrize("driven", ["front", "rear"])
@pytest.mark.parametrize("name", ["as learned", "another load", "evenly low grip", "low grip"])
def test_a_drive_model_expects_so_many_times_the_learned_slip(driven: str, name: str) -> None:
    """At 30 m/s up a slope of 0.5 m/s2, driven wheels of a car with 7e-3 per m/s2 and 8e-7 per (m/s)^2
    slip more by what the model multiplies each by; the others are as learned."""
    model = {one.name: one for one in DRIVE_EVIDENCE.models}[name]
    reference = RadiusReference(replace(VEHICLE, driven_axle=driven))
    reference.mean[HILL.start + (driven == "rear")] = -7e-3
    uphill = replace(at(30.0), slope_mps2=0.5)
    found = reference.widened(model).expected(uphill)[0] - reference.expected(uphill)[0]
    more = (model.slip_slope_times[0] - 1.0) * 7e-3 * 0.5 + (model.drag_times[0] - 1.0) * 8e-7 * 900.0
    pulls = np.array([1.0, 1.0, 0.0, 0.0] if driven == "front" else [0.0, 0.0, 1.0, 1.0])
    assert found == pytest.approx(-more * pulls * RADIUS_M, rel=1e-9, abs=1e-12)


def test_the_car_beside_a_change_is_that_of_generalised_least_squares() -> None:
    """What is known of the car beside a step of all radii has mean and covariance of one regression over all
    samples, the step without a prior."""
    rng = np.random.default_rng(5)
    reference = learned_car()
    mean, prior = reference.mean.copy(), reference.covariance.copy()
    bank = ChangeBank(reference.copy(), np.zeros((4, 4)))
    rows = [reference.features(at(float(v))) for v in SPEEDS[:12]]
    step = np.array([0.0, 0.0, -5e-3, 0.0])
    noise = np.eye(4) * 4e-4**2
    seen = [row @ mean + rng.normal(0.0, 4e-4, 4) + (k >= 3) * step for k, row in enumerate(rows)]
    for row, sample in zip(rows, seen, strict=True):
        bank.update(sample, noise, row, 0.0, USUAL)
    design = np.hstack([np.vstack(rows), np.kron((np.arange(12) >= 3)[:, None], np.eye(4))])
    flat = np.diag(np.r_[np.zeros(SIZE), np.zeros(4)])
    flat[:SIZE, :SIZE] = np.linalg.pinv(prior, hermitian=True)
    weight = np.kron(np.eye(12), np.linalg.inv(noise))
    whole = np.linalg.pinv(design.T @ weight @ design + flat, hermitian=True)
    start = np.r_[mean, np.zeros(4)]
    best = start + whole @ design.T @ weight @ (np.concatenate(seen) - design @ start)
    place = int(np.argmin(np.abs(bank.changes(USUAL).change[0] - best[SIZE:]).sum(axis=1)))
    found = bank.reference_fitted_jointly(0, place, USUAL)
    assert best[:SIZE] == pytest.approx(found.mean, abs=2e-6)
    assert np.diag(whole)[:SIZE] == pytest.approx(np.diag(found.covariance), rel=1e-3, abs=1e-12)


@pytest.mark.parametrize("wheel", WHEELS)
def test_a_tyre_that_stands_out_on_its_axle_is_named_beside_a_load(wheel: int) -> None:
    """One tyre is 20 % low and a trailer has lowered the other axle by 0.5 mm: whether that axle's tyres are
    soft as well is open, and this one is named all the same; a lowered axle alone is not."""
    other_axle = [w for w in WHEELS if w // 2 != wheel // 2]
    own_m2 = np.full((4, 4), 3e-4**2) + np.eye(4) * 1e-4**2
    judge = Judge(VEHICLE, MonitorConfig(), TyreConfig(), WHEELS)
    loaded = np.zeros(4)
    loaded[other_axle] = -5e-4
    soft = loaded.copy()
    soft[wheel] -= 1.5e-3
    named = []
    for radii in (soft, loaded):
        now = Change(radii - 6e-4, own_m2, 1, own_m2, True)
        found = judge.judge(now, now)
        named.append([w for w in WHEELS if found.deflated[w] > 0.99])
    assert [[wheel], []] == named


def test_what_is_harmless_belongs_to_the_likelihood_without_a_loss() -> None:
    """The evidence of an account without a loss is the marginal likelihood of all samples with a normal,
    harmless change from its onset on."""
    rng = np.random.default_rng(5)
    reference = learned_car()
    mean, prior = reference.mean.copy(), reference.covariance.copy()
    evidence = DriveEvidence(reference, WHEELS, RADIUS)
    rows = [reference.features(at(float(v))) for v in SPEEDS[:9]]
    noise = np.eye(4) * 4e-4**2
    seen = [row @ mean + rng.normal(0.0, 1e-3, 4) for row in rows]
    for row, sample in zip(rows, seen, strict=True):
        evidence.update(sample * RADIUS_M, noise * RADIUS_M**2, np.zeros((4, 4)), row, 0.0)
    change_hypotheses = evidence.change_hypotheses
    assert change_hypotheses is not None
    nuisance = np.diag([3e-4, 4e-4, 5e-4, 6e-4]) ** 2
    _, log_weight = change_hypotheses.with_nuisance(nuisance * RADIUS_M**2)
    h, off = np.vstack(rows), np.concatenate(seen) - np.vstack(rows) @ mean
    own = DRIVE_EVIDENCE.estimate_share * noise + evidence._whole._quick
    design = np.tile(np.eye(4), (9, 1))
    likelihood = []
    for more in (np.zeros((4, 4)), nuisance):
        whole = h @ prior @ h.T + np.kron(np.eye(9), own) + design @ more @ design.T
        likelihood.append(-0.5 * off @ np.linalg.solve(whole, off) - 0.5 * np.linalg.slogdet(whole)[1])
    as_learned_from_the_start = float(log_weight[0] - change_hypotheses.log_weight[0])
    assert likelihood[1] - likelihood[0] == pytest.approx(as_learned_from_the_start, rel=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_four_tyres_that_were_soft_at_the_start_are_not_a_load(seed: int) -> None:
    """A car that is known well sets off with all four 25 % low: all four are named, and no other load."""
    soft = np.full((60, 4), -0.0056 * RADIUS_M)
    found = judged(learned_car().mean.copy(), soft, seed, known_share=0.03)
    assert np.all(found.deflated > 0.99)
    assert found.drive_models["as learned"] > 0.9


@pytest.mark.parametrize("seed", range(4))
def test_four_tyres_that_lost_a_fifth_are_named_beside_another_load(seed: int) -> None:
    """All four are 0.42 % small, which is 1.3 mm, on a car that is known to a twentieth of its prior: they
    are named, though another load may lower both axles. A full van that is 0.25 mm lower at its front and
    0.95 mm at its rear, and one with a trailer's nose on its rear besides, names no wheel."""
    truth = learned_car().mean.copy()
    assert np.all(judged(truth, np.full((60, 4), -0.0042 * RADIUS_M), seed, known_share=0.05).deflated > 0.99)
    for rear_m in (-9.5e-4, -12.5e-4):
        full = np.tile([-2.5e-4, -2.5e-4, rear_m, rear_m], (60, 1))
        assert np.all(judged(truth, full, seed, known_share=0.05).deflated < 0.6)


@pytest.mark.parametrize("seed", range(4))
def test_four_soft_tyres_are_seen_beside_growth_that_was_never_learned(seed: int) -> None:
    """All four lose 20 % in ten minutes of autobahn, on a car whose growth is one standard deviation off: the
    present radii do not show it, the drive does, for it tells growth from loss by its speeds."""
    reference = learned_car()
    truth = reference.mean.copy()
    truth[GROWTH] += math.sqrt(reference.covariance[GROWTH, GROWTH])
    loss = -0.0048 * RADIUS_M * np.clip((np.arange(60.0) - 12.0) / 30.0, 0.0, 1.0)
    found = judged(truth, np.tile(loss[:, None], 4), seed)
    assert found.finding is not None
    assert "drive" == found.finding.over
    assert np.all(found.deflated > 0.99)
    assert np.all(judged(truth, np.zeros((60, 4)), seed).deflated < 0.1)


@pytest.mark.parametrize("seed", range(4))
def test_a_trailer_is_no_loss_of_the_driven_axle(seed: int) -> None:
    """Three times the drag slip and 600 N on each rear wheel, from the start: no wheel is named, and the load
    or the trailer is what explains it."""
    truth = learned_car().mean.copy()
    truth[DRAG] *= 3.0
    extra = np.tile([5e-5, 5e-5, -3e-4, -3e-4], (60, 1))
    found = judged(truth, extra, seed)
    assert np.all(found.deflated < 0.2)
    assert found.drive_models["a trailer"] + found.drive_models["another load"] > 0.8


@pytest.mark.parametrize("seed", range(4))
def test_driven_wheels_that_slip_at_low_grip_are_no_loss(seed: int) -> None:
    """The driven front axle slips by 2 mm, give or take 1 mm from sample to sample: nothing is raised,
    neither as a loss nor as a deviation, and low grip is what explains it."""
    rng = np.random.default_rng(seed + 50)
    slip = -2e-3 + 1e-3 * rng.standard_normal(60)
    extra = np.stack([slip, slip, np.zeros(60), np.zeros(60)], axis=1)
    found = judged(learned_car().mean.copy(), extra, seed)
    settings = MonitorConfig()
    assert np.all(found.deflated < settings.raise_probability)
    assert np.all(found.deviates < settings.raise_probability)
    assert sum(found.drive_models[name] for name in DRIVE_EVIDENCE.slipping) > 0.99


def test_speeds_lie_between_the_two_nearest_knots() -> None:
    """Weights are linear between knots, add up to one, and belong to the outer knot beyond it."""
    assert np.array_equal(np.eye(KNOTS_MPS.size), [speed_weights(knot) for knot in KNOTS_MPS.tolist()])
    for low, (slow, fast) in enumerate(pairwise(KNOTS_MPS.tolist())):
        expected = np.zeros(KNOTS_MPS.size)
        expected[low], expected[low + 1] = 0.75, 0.25
        assert expected == pytest.approx(speed_weights(slow + 0.25 * (fast - slow)))
    assert np.array_equal(speed_weights(0.0), speed_weights(KNOTS_MPS[0]))
    assert np.array_equal(speed_weights(200.0), speed_weights(KNOTS_MPS[-1]))


def test_hypotheses_of_another_size_begin_anew() -> None:
    """Those of the first row have wheels as learned and are left out; the others weigh what went before."""
    n, rows = 5, np.array([0, 1, 0, 2, 1])
    given = ChangeHypotheses(
        np.arange(4.0 * n).reshape(n, 4), np.tile(np.eye(4), (n, 1, 1)), np.arange(float(n)), rows,
        *(rows, np.arange(n), 0.01 * np.arange(n), 0.001 * np.arange(n), 7),
    )  # fmt: skip
    found = given.only_resized(-2.5)
    assert ([1, 2, 1], [1, 3, 4], 7) == (found.row.tolist(), found.index.tolist(), found.samples)
    assert [-1.5, 0.5, 1.5] == found.log_weight.tolist()
    assert np.array_equal(given.change_m[[1, 3, 4]], found.change_m)
