"""The ripple of a ring over several blocks, against draws and the textbook's likelihood."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from tpmsd.car.rings.ripple import common_amplitude_gain

BLOCKS = 15


def test_the_gain_is_that_of_an_exponential_mean() -> None:
    """Log-likelihood of the best mean over mean 1, by SciPy's distribution; nothing below the mean."""
    rng = np.random.default_rng(1)
    gains = 2.5 * rng.exponential(size=BLOCKS)
    best = stats.expon(scale=gains.mean()).logpdf(gains).sum() - stats.expon().logpdf(gains).sum()

    assert best == pytest.approx(float(common_amplitude_gain(gains.sum(), BLOCKS)))
    assert 0.0 == float(common_amplitude_gain(np.array(0.5 * BLOCKS), BLOCKS))


def test_noise_seldom_looks_like_a_ripple() -> None:
    """In 2000 drives of 15 blocks, two wheels and 200 shares the best gain passes 14 nats in none; the sum of
    the blocks' gains is beyond its mean by 11 in most."""
    rng = np.random.default_rng(2)
    sums = rng.gamma(BLOCKS, size=(2000, 2 * 200))

    assert 0 == np.count_nonzero(common_amplitude_gain(sums, BLOCKS).max(axis=1) > 14.0)
    assert 1000 < np.count_nonzero(sums.max(axis=1) - BLOCKS > 11.0)
