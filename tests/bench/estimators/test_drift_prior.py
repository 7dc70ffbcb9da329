"""Drawn drift has the distribution that the filters state."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.campaigns.onboard.estimators import drift_prior
from bench.campaigns.onboard.estimators.drift_prior import CHANGES, DRIFT, NONE
from bench.worlds.paper_drive import FL, RADIUS_M, RL, RR, TICK_S
from tpmsd.onboard.estimators.settings import SETTINGS

TICKS = 6000
ROLLING = np.ones(TICKS, dtype=bool)


def test_levels_come_by_their_probabilities() -> None:
    """Of 4,000 drives one in ten has level 1, and 1.4 % one wheel alone; of a pair no wheel is alone."""
    rng = np.random.default_rng(1)
    four = np.array([drift_prior.levels("gaussian-sum", 4, 1, rng)[0] for _ in range(4000)])
    assert 0.1 == pytest.approx(np.mean(np.all(four == 1.0, axis=1)), abs=0.02)
    assert 0.014 == pytest.approx(np.mean(np.ptp(four, axis=1) > 0.0), abs=0.006)
    pair = np.array([drift_prior.levels("gaussian-sum", 2, 1, rng)[0] for _ in range(500)])
    assert 0.0 == np.ptp(pair, axis=1).max()


def test_walking_levels_keep_their_prior() -> None:
    """Log-levels at the end of ten minutes: mean and variance, and those of one wheel against all."""
    rng = np.random.default_rng(2)
    last = np.log([drift_prior.levels("mpf-pn", 4, TICKS, rng)[-1] for _ in range(600)])
    std = math.hypot(SETTINGS.level_log_std, SETTINGS.level_contrast_std)
    assert SETTINGS.level_log_mean == pytest.approx(last.mean(), abs=0.2)
    assert std == pytest.approx(last.std(), rel=0.08)
    one_wheel = last[:, 0] - last.mean(axis=1)
    assert SETTINGS.level_contrast_std * math.sqrt(0.75) == pytest.approx(one_wheel.std(), rel=0.1)


def test_radii_drift_at_the_usual_rate_while_the_car_rolls(monkeypatch: pytest.MonkeyPatch) -> None:
    """At level 1 the rear pair's difference gains 2 x 0.01^2 mm^2 a second in ticks that roll, nothing in
    others; nothing drifts where there is to be none; a pair leaves the front as it is."""
    monkeypatch.setattr(drift_prior, "levels", lambda method, wheels, ticks, rng: np.ones((ticks, wheels)))
    half = np.arange(TICKS) < TICKS // 2
    rng = np.random.default_rng(3)
    runs = np.array([drift_prior.drawn("mpf-pn", 2, half, DRIFT, rng) for _ in range(400)])
    assert np.array_equal(runs[:, TICKS // 2], runs[:, -1])
    off = runs[:, -1, RL] - runs[:, -1, RR]
    assert 2.0 * SETTINGS.drift_own_m**2 * TICK_S * TICKS / 2 == pytest.approx(np.mean(off**2), rel=0.2)
    assert (
        0.0 == np.abs(runs[:, :, FL]).max() == np.abs(drift_prior.drawn("mpf-pn", 4, half, NONE, rng)).max()
    )


def test_changes_come_at_their_rate_and_size() -> None:
    """One an hour and wheel, of 0.8 % of the radius: over 200 pieces of ten minutes and four wheels 133."""
    rng = np.random.default_rng(4)
    steps = np.concatenate(
        [np.diff(drift_prior.drawn("gaussian-sum", 4, ROLLING, CHANGES, rng), axis=0) for _ in range(200)]
    )
    size = SETTINGS.jump_std * RADIUS_M
    large = steps[np.abs(steps) > 0.1 * size]
    assert 133 == pytest.approx(large.size / 0.92, abs=35)
    assert size == pytest.approx(np.sqrt(np.mean(large**2)), rel=0.2)
