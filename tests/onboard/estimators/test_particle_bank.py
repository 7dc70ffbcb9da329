"""The particles of MPF-PN: what is drawn keeps the distribution that it stands for, and never degenerates."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.onboard.estimators.test_error_state import NOMINAL
from tests.onboard.estimators.world import VEHICLE, Receiver, World, errors_m, estimator, run, stds_m
from tpmsd.car.config.model import GnssConfig
from tpmsd.onboard.estimators.bank.error_state import MU, PSI, E, N
from tpmsd.onboard.estimators.bank.marginal import MarginalBelief, MarginalPieces
from tpmsd.onboard.estimators.bank.particle_bank import SampledHypotheses, mean_and_root, shrink_and_jitter
from tpmsd.onboard.estimators.belief import FixMeasurement, GatedTick
from tpmsd.onboard.estimators.build import filter_car
from tpmsd.onboard.estimators.resampling import Lineage
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Fix, Tick

HYPOTHESES = SampledHypotheses()


def belief_of(count: int, seed: int = 1) -> MarginalBelief:
    car = filter_car(VEHICLE, GnssConfig(), True)
    return MarginalBelief(car, MarginalPieces(), count, np.random.default_rng(seed))


def test_copies_are_moved_apart_and_the_moments_stay() -> None:
    """a theta + (1 - a) mean + h root z with a^2 + h^2 = 1 keeps mean and covariance: over 200 moves of
    20,000 particles both stay within the error of so many draws; a walk without shrinkage makes 19 of 1."""
    rng = np.random.default_rng(5)
    truth = np.array([[1.0, 0.6, 0.0], [0.6, 2.0, -0.3], [0.0, -0.3, 0.5]])
    theta = np.linalg.cholesky(truth) @ rng.standard_normal((3, 20_000)) + np.array([[1.0], [-2.0], [0.0]])
    even = np.full(20_000, 1 / 20_000)
    mean, root = mean_and_root(theta, even)
    assert root @ root.T == pytest.approx(np.cov(theta, bias=True), rel=1e-9, abs=1e-9)
    moved = theta
    for _ in range(200):
        moved = shrink_and_jitter(moved, *mean_and_root(moved, even), HYPOTHESES.kernel, rng)
    assert np.abs(moved.mean(axis=1) - mean).max() < 0.1
    assert np.abs(np.cov(moved) - np.cov(theta)).max() < 0.25
    assert not np.allclose(moved, theta, atol=0.5)


def test_noise_parameters_walk_about_their_prior() -> None:
    """Whatever they begin with, theta has the prior's mean and standard deviation in the end."""
    rng = np.random.default_rng(2)
    bank = HYPOTHESES.begin(20_000, NOMINAL, rng)
    bank.theta[:] = 3.0
    for _ in range(100):
        HYPOTHESES.walk(bank, 60.0, rng)
    prior = np.array([HYPOTHESES.noise_std, HYPOTHESES.level_std, *[HYPOTHESES.contrast_std] * 4])
    centre = np.array([0.0, HYPOTHESES.level_mean, 0.0, 0.0, 0.0, 0.0])
    assert np.abs(bank.theta.mean(axis=1) - centre).max() < 0.05
    assert bank.theta.std(axis=1) == pytest.approx(prior, rel=0.03)
    assert np.array_equal(bank.noise_factor, np.exp(bank.theta[0]))
    assert np.allclose(bank.level, np.exp(bank.theta[1] + bank.theta[2:]).T)


def test_changes_are_proposed_often_and_weigh_what_they_should() -> None:
    """In a share of the places one wheel is assumed to have just changed, as many for each; together
    they weigh the prior probability of a change, each is wider by a change's variance, and their parents come
    by their weights. They take the places that a resampling left free."""
    rng = np.random.default_rng(8)
    count = 5000
    bank, lineage = HYPOTHESES.begin(count, NOMINAL, rng), Lineage(count)
    alive = round((1.0 - SETTINGS.reserved_share) * count)
    bank.log_weights[:1000] = 1.5
    bank.state[E] = np.arange(count)
    weights = bank.weights()
    before = np.einsum("ijj->ij", bank.covariance)[:, MU:].copy()
    HYPOTHESES.propose(bank, lineage, 1.0, NOMINAL, rng)
    wider = np.einsum("ijj->ij", bank.covariance)[:, MU:] - before
    jumped = wider.max(axis=1) > 0.0
    assert jumped.sum() == round(SETTINGS.proposed_share * count)
    assert not jumped[:alive].any()
    assert np.array_equal(np.bincount(wider[jumped].argmax(axis=1)), [jumped.sum() // 4] * 4)
    chance = 4.0 * SETTINGS.jump_rate_per_s
    assert bank.weights()[jumped].sum() == pytest.approx(chance / (1.0 + chance), rel=1e-6)
    assert np.all(np.count_nonzero(wider[jumped], axis=1) == 1)
    size = SETTINGS.jump_std * NOMINAL[wider[jumped].argmax(axis=1)]
    assert wider[jumped].max(axis=1) == pytest.approx(size**2)
    parents = bank.state[E, jumped]
    assert (parents < 1000).mean() == pytest.approx(weights[:1000].sum(), abs=0.01)
    assert np.array_equal(bank.theta[:, jumped], bank.theta[:, parents.astype(int)])
    assert np.array_equal(bank.level[jumped], bank.level[parents.astype(int)])


def test_resampling_keeps_the_expectation_and_counts_ancestors() -> None:
    """Copies come in proportion to the weights; a quarter of the places is left without any; the number of
    ancestors is that of the particles that have descendants."""
    rng = np.random.default_rng(3)
    bank = HYPOTHESES.begin(1000, NOMINAL, rng)
    bank.state[MU] = np.arange(1000) * 1e-6
    bank.log_weights[:] = np.where(np.arange(1000) < 100, 0.0, -3.0)
    weights = bank.weights()
    expected = float(weights @ bank.state[MU])
    lineage = Lineage(1000)
    assert not HYPOTHESES.resample(bank, lineage, 501.0, rng)
    assert HYPOTHESES.resample(bank, lineage, 1.0 / float(weights @ weights), rng)
    after = bank.weights()
    assert float(after @ bank.state[MU]) == pytest.approx(expected, abs=2e-6)
    assert lineage.ancestors == np.unique(bank.state[MU]).size
    assert lineage.ancestors < 1000
    assert np.count_nonzero(after == 0.0) == 250
    assert after[after > 0.0] == pytest.approx(1.0 / 750.0)


def test_ancestors_older_than_two_minutes_count_no_more() -> None:
    """One ancestor is left after a collapse; between one and two minutes later all particles count again."""
    lineage = Lineage(50)
    lineage.keep(np.zeros(50, dtype=np.intp))
    assert lineage.ancestors == 1
    lineage.elapse(SETTINGS.lineage_s)
    assert lineage.ancestors == 1
    lineage.elapse(SETTINGS.lineage_s)
    assert lineage.ancestors == 50


def test_the_particles_never_degenerate() -> None:
    """Ten minutes with a loss of 2 % in the middle: the effective number stays above a tenth of the particles
    but for the seconds of the loss, those of a minute have many ancestors at the end, and the noise
    parameters keep half of the prior's spread at least."""
    world = World(600.0, fault=(2, -0.02, 300.0), fault_takes_s=10.0)
    drive = world.drive()
    filter_ = estimator("mpf-pn", world)
    estimates = run(filter_, drive.ticks)
    belief = filter_.belief
    assert isinstance(belief, MarginalBelief)
    effective = np.array([e.effective_particles for e in estimates]) / SETTINGS.marginal_particles
    assert np.quantile(effective, 0.02) > 0.1
    assert estimates[-1].ancestors > 0.1 * SETTINGS.marginal_particles
    prior = np.array([HYPOTHESES.noise_std, HYPOTHESES.level_std, *[HYPOTHESES.contrast_std] * 4])
    spread = np.sqrt(np.diag(np.cov(belief.bank.theta, aweights=belief.bank.weights())))
    assert np.all(spread > 0.5 * prior)
    assert np.abs(errors_m(drive, estimates)[-1]).max() < 0.4e-3


def test_a_fifth_of_the_particles_says_the_same() -> None:
    """200 and 1000 particles differ in the radii by less than a fifth of their standard deviation on a quiet
    drive: pose and radii are marginalised, so that few things are left to be drawn."""
    world = World(180.0)
    drive = world.drive()
    few, many = (run(estimator("mpf-pn", world, particles=n), drive.ticks)[-1] for n in (200, 1000))
    std = np.sqrt(np.diag(many.covariance_m2))
    assert np.all(np.abs(few.deviation_m - many.deviation_m) < 0.2 * std)


def measurement_at(east_m: float, north_m: float) -> FixMeasurement:
    fix = Fix(0.1, 1.0, east_m, north_m, 1.0)
    tick = Tick(1, 0.1, 0.1, np.full(4, 5.0), np.zeros(4), (fix,))
    return FixMeasurement(fix, tick, 0.0, 0.0, 1.0)


def test_the_gate_knows_how_far_the_particles_are_apart() -> None:
    """Half of the particles 30 m east of the others, each sure of its place: a fix where the one half is lies
    within what the gate allows, for their variance about the mean is 15 m squared."""
    belief = belief_of(100)
    belief.bank.log_weights[:] = 0.0
    belief.bank.spread[[E, N], [E, N]] = 1.0
    belief.bank.state[E, :50] = 30.0
    residual_m, variance_m2 = belief.distance(measurement_at(30.0, 0.0))
    assert residual_m == pytest.approx(15.0, abs=1.0)
    assert variance_m2 == pytest.approx(15.0**2 + 1.0 + 2.0, abs=1.0)


def test_a_lost_pose_reopens_the_radii_and_keeps_what_they_have_in_common() -> None:
    """Where the receiver has left the wheels, half of the particles have one radius wider by a change; means,
    correlations of the others and the other half stay."""
    belief = belief_of(1000)
    bank = belief.bank
    before_mean, before = bank.mean.copy(), bank.covariance.copy()
    belief.forget_pose()
    assert np.array_equal(before_mean, bank.mean)
    wider = np.einsum("ijj->ij", bank.covariance - before)
    opened = wider[:, MU:].max(axis=1) > 0.0
    assert opened.mean() == pytest.approx(0.5, abs=0.06)
    assert np.array_equal(bank.covariance[~opened], before[~opened])
    off_diagonal = ~np.eye(before.shape[1], dtype=bool)
    assert np.array_equal(bank.covariance[:, off_diagonal], before[:, off_diagonal])
    assert np.all(wider[opened, PSI] > 0.0)


def test_a_receiver_elsewhere_costs_no_radius() -> None:
    """The receiver is 500 m off for half a minute: the pose is lost and found, and the radii are right within
    their standard deviations a minute later."""
    world = World(240.0, receiver=Receiver(jumps=((100.0, 130.0, 500.0),)))
    drive = world.drive()
    filter_ = estimator("mpf-pn", world)
    estimates = run(filter_, drive.ticks)
    assert filter_.counts["lost_pose"] >= 1
    error, std = errors_m(drive, estimates), stds_m(estimates)
    assert np.all(np.abs(error[-1]) < 3.0 * std[-1])
    assert np.abs(error[-1]).max() < 0.6e-3


def test_the_spread_between_particles_is_part_of_that_stated() -> None:
    """Particles that differ in a radius by 2 mm either way state so, and the spread between them is 1 mm
    over the root of four wheels."""
    belief = belief_of(200)
    belief.bank.log_weights[:] = 0.0
    belief.bank.state[MU, :100] = 2e-3
    said = belief.moments()
    assert said.between_std_m == pytest.approx(1e-3 / math.sqrt(4.0))
    inside = belief.bank.spread[MU, MU].mean()
    assert said.covariance_m2[0, 0] == pytest.approx(inside + 1e-6)


def test_nothing_is_proposed_that_nothing_can_judge() -> None:
    """A rear pair without fixes and gyro: blocks pass and no radius becomes wider by a change."""
    car = filter_car(VEHICLE, GnssConfig(), False)
    belief = MarginalBelief(car, MarginalPieces(), 500, np.random.default_rng(4))
    before = np.einsum("ijj->ij", belief.bank.covariance)[:, MU:].max()
    for k in range(1, 200):
        tick = Tick(k, 0.1 * k, 0.1, np.full(4, 6.0), np.full(4, 0.05))
        belief.finish_tick(GatedTick(tick, True, 20.0, 0.0, False))
    after = np.einsum("ijj->ij", belief.bank.covariance)[:, MU:].max()
    assert after == pytest.approx(before)
