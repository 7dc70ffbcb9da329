"""One model of grip for what is seen now, over minutes and over a drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.onboard.monitor.drives import RADIUS_M, VEHICLE
from tests.onboard.monitor.test_drive_evidence import RADIUS, WHEELS, at, judged, learned_car
from tpmsd.car.config.model import MonitorConfig, TyreConfig
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.monitor.alarms.judge import Judge
from tpmsd.onboard.monitor.baseline.baseline import Change, TyreSetBaseline, least_disturbed_sample
from tpmsd.onboard.monitor.baseline.reference import RadiusReference
from tpmsd.onboard.monitor.evidence.grip import Grip
from tpmsd.onboard.monitor.evidence.nuisance import log_normal
from tpmsd.onboard.monitor.sampling.drive_evidence import ChangeSinceStart
from tpmsd.onboard.monitor.settings import DRIVE_EVIDENCE
from tpmsd.onboard.timeline.tick import Tick

MODELS = {model.name: model for model in DRIVE_EVIDENCE.models}
AXLE_DIFFERENCES = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]])
ASKED = MonitorConfig().raise_probability


def test_slip_lasts_and_scatter_falls_with_the_number_of_samples() -> None:
    """On loose ground the mean of four samples has the variance s^2 + (a^2 + o^2) / 4 on a driven wheel
    beside the estimate's, s^2 + a^2 / 4 between the driven ones; the others have the same without s^2. With
    the probability 1 - (1 - p)^4 a wheel spun in one of them: e^2 / 16 more on each."""
    loose = MODELS["loose ground"]
    chances = dict.fromkeys(MODELS, 0.0) | {"loose ground": 1.0}
    found = Grip(VEHICLE, WHEELS, RADIUS).change_hypotheses(np.zeros(4), 1e-8 * np.eye(4), 4, chances)
    comes, own = loose.axle_scatter**2 / 4, loose.own_scatter**2 / 4
    expected = np.diag([loose.slip_std**2] * 2 + [0.0] * 2) + comes * np.kron(np.eye(2), np.ones((2, 2)))
    expected[0, 1] = expected[1, 0] = loose.slip_std**2 + comes
    expected += own * np.eye(4)
    spun = expected + loose.event_std**2 / 16 * np.eye(4)
    for covariance_m2, relative in zip(found.covariance_m2[-2:], (expected, spun), strict=True):
        assert covariance_m2 == pytest.approx(1e-8 * np.eye(4) + relative * RADIUS_M**2, rel=1e-9)
    densities = log_normal(np.zeros(4), found.covariance_m2)
    chance = np.exp(found.log_weight[-2:] - densities[-2:])
    assert chance == pytest.approx([(1.0 - loose.event_share) ** 4, 1.0 - (1.0 - loose.event_share) ** 4])


def test_a_change_weighs_the_models_by_their_likelihood() -> None:
    """Beforehand both are as probable; after a change of 3 mm of one wheel that does not slip on a usual road
    the odds are those of two normal densities."""
    chances = dict.fromkeys(MODELS, 0.0) | {"as learned": 0.5, "loose ground": 0.5}
    change = np.array([0.0, 0.0, -3e-3, 0.0])
    plain = 5e-4**2 * np.eye(4)
    found = Grip(VEHICLE, WHEELS, RADIUS).change_hypotheses(change, plain, 1, chances)
    densities = [
        -0.5 * change @ np.linalg.inv(one) @ change - 0.5 * np.log(np.linalg.det(one))
        for one in (plain, *found.covariance_m2[-2:])
    ]
    chances_of = np.log([1.0 - MODELS["loose ground"].event_share, MODELS["loose ground"].event_share])
    got = found.log_weight[-2:] - found.log_weight[0]
    assert got == pytest.approx(np.array(densities[1:]) - densities[0] + chances_of, rel=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_wheels_that_jump_on_loose_ground_are_no_loss_while_they_jump(seed: int) -> None:
    """Each wheel strays by 1.2 mm from sample to sample for itself, and at the end one that is not driven has
    strayed by -2.5 mm: nothing is raised, neither now nor over minutes nor over the drive."""
    rng = np.random.default_rng(seed + 70)
    extra = 1.2e-3 * rng.standard_normal((60, 4))
    extra[-1, 2] = -2.5e-3
    found = judged(learned_car().mean.copy(), extra, seed)
    assert found.drive_models["loose ground"] > 0.99
    assert np.all(found.deflated < ASKED)


@pytest.mark.parametrize("seed", range(4))
def test_a_soft_tyre_on_loose_ground_is_named_by_the_drive_as_a_whole(seed: int) -> None:
    """The same ground, and a rear tyre loses 3 mm after a third of the drive: it is named, and no other."""
    rng = np.random.default_rng(seed + 90)
    extra = 1.2e-3 * rng.standard_normal((60, 4))
    extra[20:, 3] -= 3e-3
    found = judged(learned_car().mean.copy(), extra, seed)
    assert [3] == np.flatnonzero(found.deflated > ASKED).tolist()


def test_a_wheel_that_is_locked_for_seconds_is_not_what_twenty_seconds_have_seen() -> None:
    """Of twenty moments rl is off by 40 mm in the first six and fr by -20 mm in the last six: the sample is
    one of those between; of a step after twelve it is one before it; what both wheels of an axle do stays."""
    reference = learned_car()
    h = reference.features(at(20.0))
    usual = h @ reference.mean * RADIUS_M
    shared = (1e-8 * np.eye(4), np.zeros((4, 4)), h)
    off = np.zeros((20, 4))
    off[:, 0] = 1e-5 * np.arange(20)
    off[:6, 2], off[-6:, 1] = 40e-3, -20e-3
    found = least_disturbed_sample(
        [(usual + one, *shared) for one in off], reference.mean, RADIUS, AXLE_DIFFERENCES
    )
    assert 6 <= round((found[0] - usual)[0] / 1e-5) < 14
    off[:, 1:] = 0.0
    off[12:, 3] = -2e-3
    found = least_disturbed_sample(
        [(usual + one, *shared) for one in off], reference.mean, RADIUS, AXLE_DIFFERENCES
    )
    assert 0.0 == pytest.approx((found[0] - usual)[3], abs=1e-9)
    off[12:, 2] = -2e-3
    found = least_disturbed_sample(
        [(usual + one, *shared) for one in off], reference.mean, RADIUS, AXLE_DIFFERENCES
    )
    assert -2e-3 == pytest.approx((found[0] - usual)[3], abs=1e-9)


@pytest.mark.parametrize(("level_m", "raised"), [(0.0, True), (2.3e-3, False)])
def test_minutes_say_which_tyre_of_an_axle_has_changed(level_m: float, raised: bool) -> None:
    """fl is 2.3 mm smaller than fr. Now, as the driven front axle slips, fl is low and fr is as learned: a
    loss where minutes have seen it so, and none where over minutes fr was larger and fl as learned."""
    own_m2 = np.full((4, 4), 5e-4**2) + np.eye(4) * 1e-4**2
    change = np.array([-2.3e-3, 0.0, 0.0, 0.0])
    before = change + np.array([level_m, level_m, 0.0, 0.0])
    judge = Judge(VEHICLE, MonitorConfig(), TyreConfig(), WHEELS)
    changes = Change(change, own_m2, 1, own_m2, True), Change(before, own_m2, 9, own_m2, True)
    known = ChangeSinceStart(before[None], own_m2[None], np.zeros(1), np.zeros(1) > 0.0)
    found = judge.judge(*changes, before=(known, None))
    assert raised == (found.deflated[0] > ASKED)
    assert np.all(found.deflated[1:] < 0.5)


def test_an_estimate_that_no_tyre_explains_is_no_change() -> None:
    """A wheel that seems 8 % larger than was learned; by 3 %, as with a snow chain, it is one."""
    baseline = TyreSetBaseline(VEHICLE, WHEELS, 180.0)
    found = {share: baseline.changes(estimate(share * RADIUS_M), np.eye(4) * 1e-8) for share in (0.03, 0.08)}
    assert found[0.08] is None
    assert found[0.03] is not None and found[0.03][0].change_m[1] == pytest.approx(
        0.03 * RADIUS_M, abs=1e-3
    )  # warmth of a cold start is taken off


def test_to_ask_for_the_change_takes_nothing_up() -> None:
    """Of twenty seconds of driving the change is asked ten times, and each answer is the first one; once
    they are observed, the mean holds one sample more."""
    baseline, nuisance_m2, seen = TyreSetBaseline(VEHICLE, WHEELS, 180.0), np.eye(4) * 1e-8, estimate(0.0)
    tick = Tick(0, 0.0, 21.0, np.full(4, 21.0 * 20.0 / RADIUS_M), np.full(4, 0.05))
    baseline.update(tick, seen)
    asked = [baseline.changes(seen, nuisance_m2) for _ in range(10)]
    assert [1] * 10 == [one[1].samples for one in asked if one is not None]
    baseline.observe(seen, nuisance_m2)
    after = baseline.changes(seen, nuisance_m2)
    assert after is not None and after[1].samples == 2


def estimate(larger_m: float) -> RadiusEstimate:
    deviation = np.array([0.0, larger_m, 0.0, 0.0])
    covariance = np.eye(4) * 1e-4**2
    return RadiusEstimate(
        0.0,
        deviation,
        covariance,
        np.full(4, 1e-3),
        True,
        0.0,
        20.0,
        0.0,
        0.0,
        0.0,
        0.0,
        1.0,
        0.01,
        0.1,
        100.0,
    )


def test_two_driven_axles_slip_by_half_each() -> None:
    """Each transmits half of the force: a quarter of the variance, on four wheels."""
    one = RadiusReference(VEHICLE).slip_covariance(MODELS["low grip"])
    both = RadiusReference(replace(VEHICLE, driven_axle="all")).slip_covariance(MODELS["low grip"])
    assert np.diag(both) == pytest.approx(np.full(4, one[0, 0] / 4.0))
    assert one[0, 0] == pytest.approx(MODELS["low grip"].slip_std ** 2)


def test_driving_since_the_last_sample_counts_from_nothing() -> None:
    """A new set of tyres has been driven for as long as it was driven informatively, and the saved state says
    so: ticks that are not informative do not count."""
    baseline = TyreSetBaseline(VEHICLE, WHEELS, 180.0)
    for k in range(40):
        seen = estimate(0.0)._replace(informative=k % 2 == 0)
        baseline.update(Tick(k, 0.5 * k, 0.5, np.full(4, 33.0), np.full(4, 0.01)), seen)
    assert (10.0, 10.0) == (baseline.learned_s, baseline.to_json()["since_s"])
