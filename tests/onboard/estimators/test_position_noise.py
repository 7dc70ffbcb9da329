"""Unknown variances of positions, eq. (32f) of [Lundquist 2013], against loops written from the print."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from tests.onboard.estimators.world import World, estimator, run
from tpmsd.onboard.estimators.published.position_noise import PositionNoise
from tpmsd.onboard.estimators.published.samples import SampledBelief
from tpmsd.onboard.estimators.settings import SETTINGS

WINDOW_S = 20.0


def test_the_likelihood_and_the_statistics_are_those_of_the_print() -> None:
    """Particle by particle and axis by axis: (20c), (20d), then the Student-t of (34) with d = 1 and a known
    mean, as scipy has it, then (19c), (19d)."""
    rng = np.random.default_rng(3)
    noise = PositionNoise(WINDOW_S, floor_m=1e-3)
    state = noise.begin(3, 1.5)
    nu, scale = 5.0, np.full((2, 3), 1.5**2 * 3.0)
    for _ in range(30):
        error = rng.standard_normal((2, 3)) * 2.0
        log = noise.weigh(state, error, 0.2)
        forgetting = 1.0 - 0.2 / WINDOW_S
        nu, scale = forgetting * nu, forgetting * scale
        expected = np.zeros(3)
        for i in range(3):
            for axis in range(2):
                root = math.sqrt(scale[axis, i] / nu)
                expected[i] += stats.t.logpdf(error[axis, i], nu, scale=root)
                scale[axis, i] += error[axis, i] ** 2
        nu += 1.0
        assert log - log[0] == pytest.approx(expected - expected[0])
        assert state.scale == pytest.approx(scale)
        assert state.nu == pytest.approx(nu)


def test_the_variance_of_a_known_error_is_found() -> None:
    """Errors of 0.7 and 2 m, stated as 1.5 m: E[Sigma] = Lambda / (nu - d - 1) comes to within a fifth."""
    rng = np.random.default_rng(4)
    noise = PositionNoise(60.0)
    state = noise.begin(1, 1.5)
    for _ in range(2000):
        noise.weigh(state, rng.standard_normal((2, 1)) * np.array([[0.7], [2.0]]), 0.2)
    found = np.sqrt(state.scale[:, 0] / (state.nu - 2.0))
    assert found == pytest.approx([0.7, 2.0], rel=0.2)


def test_a_variance_never_falls_below_the_floor() -> None:
    """A receiver whose error the particles follow leaves nothing to learn from."""
    noise = PositionNoise(60.0)
    state = noise.begin(2, 1.5)
    for _ in range(5000):
        noise.weigh(state, np.zeros((2, 2)), 0.2)
    assert np.all(np.sqrt(state.scale / (state.nu - 2.0)) >= SETTINGS.position_floor_m * (1 - 1e-9))


def test_mpf_mn_holds_statistics_of_its_own_per_particle() -> None:
    """After a drive they have the window's nu, a variance for each particle and axis, and are no longer what
    the receiver states; a filter of another row has none."""
    world = World(duration_s=40.0)
    ticks = world.drive().ticks
    mn, pf = (estimator(name, world, front=False, particles=200) for name in ("mpf-mn", "aug-pf"))
    run(mn, ticks)
    run(pf, ticks)
    assert isinstance(mn.belief, SampledBelief)
    assert isinstance(pf.belief, SampledBelief)
    assert pf.belief.particles.position_noise is None
    held = mn.belief.particles.position_noise
    assert held is not None
    assert held.scale.shape == (2, 200)
    assert np.all(held.scale > 0.0)
    assert 5.0 < held.nu < 5.0 + sum(len(tick.fixes) for tick in ticks)
    stated = next(tick.fixes[0].position_std_m for tick in ticks if tick.fixes)
    assert np.all(np.abs(np.sqrt(held.scale.mean(axis=1) / (held.nu - 2.0)) / stated - 1.0) > 0.05)
