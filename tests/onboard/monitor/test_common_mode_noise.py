"""Jumps of what all wheels have in common: when a sample's level is doubted, and what that spares."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.stats import norm

from tests.onboard.monitor.drives import RADIUS_M, VEHICLE
from tests.onboard.monitor.test_drive_evidence import NOISE_M, RADIUS, WHEELS, at, learned_car
from tpmsd.car.config.model import MonitorConfig, TyreConfig
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.alarms.judge import Judge
from tpmsd.onboard.monitor.baseline.baseline import Change
from tpmsd.onboard.monitor.sampling.common_mode_noise import CommonModeNoise
from tpmsd.onboard.monitor.sampling.drive_evidence import DriveEvidence
from tpmsd.onboard.monitor.settings import JUDGE, LEVEL

TOWN_MPS = 9.0


def reflected(levels_m: FloatArray, speed_mps: float, std_m: float) -> tuple[list[float], list[float]]:
    """Of a drive whose wheels all have these radii over nominal: probability that each sample is of reflected
    signals, and the standard deviation that it adds, m."""
    reference = learned_car()
    noise = CommonModeNoise(reference)
    features = reference.features(at(speed_mps))
    chances, added_m = [], []
    for level in levels_m:
        variance = noise.update(
            np.full(4, level / RADIUS_M), np.full((4, 4), (std_m / RADIUS_M) ** 2), features
        )
        chances.append(noise.reflected)
        added_m.append(float(np.sqrt(variance)) * RADIUS_M)
    return chances, added_m


def test_the_probability_is_that_of_all_histories_together() -> None:
    """Each sequence of states by itself: its transitions, and each jump of the level normal with what both
    of its ends add."""
    levels = 1e-3 * np.array([0.0, 0.3, -3.5, -2.9, -0.4, 0.1, -0.2])
    std_m = 4e-4
    reported, _ = reflected(levels, TOWN_MPS, std_m)
    error = LEVEL.reflected_mps / TOWN_MPS * RADIUS_M
    leave, enter = 1.0 / LEVEL.reflected_samples, LEVEL.reflected_share / LEVEL.reflected_samples
    change = {(0, 0): 1.0 - enter, (0, 1): enter, (1, 0): leave, (1, 1): 1.0 - leave}
    nuisance = JUDGE.nuisance.common * RADIUS_M
    for last in range(len(levels)):
        sums = [0.0, 0.0]
        for path in itertools.product((0, 1), repeat=last + 2):
            weight = LEVEL.reflected_share if path[0] else 1.0 - LEVEL.reflected_share
            for k, pair in enumerate(itertools.pairwise(path)):
                weight *= change[pair]
                if k > 0:
                    std = np.sqrt(2.0 * (std_m**2 + nuisance**2) + sum(pair) * error**2)
                    weight *= norm.pdf(levels[k] - levels[k - 1], 0.0, std)
            sums[path[-1]] += weight
        assert reported[last] == pytest.approx(sums[1] / sum(sums), rel=1e-9)


def test_a_level_that_jumps_is_doubted_and_one_that_leaks_is_not() -> None:
    """A leak of all tyres, 1.5 mm in half an hour, adds nothing to what is known of 0.3 mm."""
    jumps = 1e-3 * np.array([0.0, 0.0, -4.0, -3.0, -4.5, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    chances, added_m = reflected(jumps, TOWN_MPS, 3e-4)
    assert min(chances[2:6]) > 0.6
    assert max(chances[:2]) < 0.05
    assert chances[-1] < 0.3
    assert min(added_m[2:6]) > 3e-4  # half the weight at most
    leak = np.linspace(0.0, -1.5e-3, 90)
    chances, added_m = reflected(leak, TOWN_MPS, 3e-4)
    assert max(chances) < 0.05
    assert max(added_m) < 0.2 * 3e-4


def test_growth_with_speed_is_no_jump() -> None:
    """From 10 to 36 m/s a tyre grows by 1.1 mm: known of a car that was learned."""
    reference = learned_car(0.01)
    noise = CommonModeNoise(reference)
    for speed in (10.0, 36.0, 10.0, 36.0, 20.0):
        features = reference.features(at(speed))
        noise.update(features @ reference.mean, np.full((4, 4), (2e-4 / RADIUS_M) ** 2), features)
        assert noise.reflected < 0.05


def of_levels(levels_m: FloatArray, seed: int) -> float:
    """Probability that all wheels are deflated, after a drive in town in which all are off by so much at once
    and the level is known to 0.5 mm from sample to sample."""
    rng = np.random.default_rng(seed)
    reference = learned_car(0.1)
    evidence = DriveEvidence(reference, WHEELS, RADIUS)
    noise_m2 = NOISE_M**2 * np.eye(4) + 5e-4**2
    for level in levels_m:
        features = reference.features(at(TOWN_MPS + float(rng.uniform(-3.0, 3.0))))
        seen = features @ reference.mean * RADIUS_M + level + rng.multivariate_normal(np.zeros(4), noise_m2)
        evidence.update(seen, noise_m2, np.zeros((4, 4)), features, 20.0)
    now = Change(np.zeros(4), noise_m2, 1, noise_m2, True)
    mean = Change(np.zeros(4), noise_m2, JUDGE.full_samples, noise_m2, True)
    judge = Judge(VEHICLE, MonitorConfig(), TyreConfig(), WHEELS)
    return float(judge.judge(now, mean, change_hypotheses=evidence.change_hypotheses).deflated.min())


@pytest.mark.parametrize("seed", range(4))
def test_reflections_for_two_minutes_are_no_loss_of_all_tyres(seed: int) -> None:
    """A level that falls by 4 mm, comes and goes and is back after two minutes raises nothing, for which an
    alarm's default asks 0.99; one that stays 2 mm lower is a loss."""
    levels = np.zeros(60)
    levels[50:56] = 1e-3 * np.array([-4.0, -2.0, -4.5, -1.5, -3.0, -1.0])
    assert of_levels(levels, seed) < 0.95
    levels[50:] = -2e-3
    assert of_levels(levels, seed) > 0.99


def test_of_a_single_sample_only_the_prior_is_reported() -> None:
    """Nothing to hold it against: a share of all samples, whatever its level."""
    for level in (-5e-3, 0.0, 5e-3):
        chances, _ = reflected(np.array([level]), TOWN_MPS, 3e-4)
        share, run = LEVEL.reflected_share, LEVEL.reflected_samples
        assert chances[0] == pytest.approx((1.0 - share) * share / run + share * (1.0 - 1.0 / run))
