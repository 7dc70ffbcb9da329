"""A reading taken by all hypotheses of slow leaks; how far readings scatter is learned by each.

In: Gaussians, a reading of three contrasts, what was learned of its scatter. Out: Gaussians, likelihoods.

The variance of a reading is an unknown factor times (that of its estimates + what load, sun and road
scatter): one factor for both left-right differences, one for front against rear. A factor has an
inverse-gamma density (shape, sum of squares), so a reading is Student-t; the sum grows by the square that is
expected of the reading's own error (variational Bayes: Sarkka, Nummenmaa 2009, IEEE Transactions on Automatic
Control 54). An outlier scatters by more; both cases are joined again by their moments.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.slow_leaks.settings import TrendSettings

LEVEL_OF = (0, 0, 1)
"""Index of the factor of each contrast."""


@dataclass(frozen=True, slots=True)
class NoiseLevels:
    """Learned factors that all hypotheses share."""

    settings: TrendSettings
    shape: tuple[float, float]
    """Half the number of readings that each factor was learned from."""

    @classmethod
    def initial(cls, settings: TrendSettings) -> NoiseLevels:
        """Return the levels before the first reading."""
        return cls(settings, (settings.noise_shape, settings.noise_shape))

    def initial_sums(self, n: int) -> FloatArray:
        """Return the (n, 2) sums of squares that stand for factors of one."""
        return np.full((n, 2), self.settings.noise_shape)

    def after_reading(self, value: FloatArray, sums: FloatArray) -> tuple[NoiseLevels, FloatArray]:
        """Return the levels after one reading more, and the sums (n, 2) that belong to them: beyond
        `max_noise_shape` readings the older ones fade."""
        shape, out = list(self.shape), sums.copy()
        for contrast, level in enumerate(LEVEL_OF):
            shape[level] += 0.5 * bool(np.isfinite(value[contrast]))
        for level in range(2):
            fade = min(self.settings.max_noise_shape / shape[level], 1.0)
            shape[level] *= fade
            out[:, level] *= fade
        return NoiseLevels(self.settings, (shape[0], shape[1])), out


@dataclass(frozen=True, slots=True)
class FilterMoments:
    """n Gaussians of d values, with what each has learned of scatter."""

    mean: FloatArray
    """(n, d)"""
    covariance: FloatArray
    """(n, d, d)"""
    noise: FloatArray
    """(n, 2)"""


def update_by_reading(
    before: FilterMoments, seen: FloatArray, value: FloatArray, variance: FloatArray, levels: NoiseLevels
) -> tuple[FilterMoments, FloatArray]:
    """Return the moments after a reading (3,) of `seen` (3, d) times the values, NaN where there is none,
    with its `variance`; and its log-likelihood (n,) but for a constant."""
    s = levels.settings
    mean, covariance, noise = before.mean, before.covariance, before.noise.copy()
    log, shape = np.zeros(len(mean)), list(levels.shape)
    for contrast in np.flatnonzero(np.isfinite(value)):
        level, row = LEVEL_OF[contrast], seen[contrast]
        relative = float(variance[contrast]) + s.noise_floor[contrast] ** 2
        own_noise = noise[:, level] / shape[level] * relative
        freedom = 2.0 * shape[level]
        off = value[contrast] - mean @ row
        column = covariance @ row
        own = column @ row
        logs, gains, squares = [], [], []
        for factor, share in ((1.0, 1.0 - s.outlier_share), (s.outlier_variance, s.outlier_share)):
            spread = own + factor * own_noise
            kernel = np.log1p(off**2 / (freedom * spread))
            logs.append(math.log(share) - 0.5 * np.log(spread) - 0.5 * (freedom + 1.0) * kernel)
            gains.append(1.0 / spread)
            rest = factor * own_noise / spread
            squares.append(((off * rest) ** 2 + own * rest) / (factor * relative))
        either = np.logaddexp(*logs)
        plain = np.exp(logs[0] - either)
        gain = plain * gains[0] + (1.0 - plain) * gains[1]
        apart = (gains[0] - gains[1]) * off
        shrink = gain - plain * (1.0 - plain) * apart**2
        mean = mean + column * (gain * off)[:, None]
        covariance = covariance - shrink[:, None, None] * column[:, :, None] * column[:, None, :]
        noise[:, level] += 0.5 * (plain * squares[0] + (1.0 - plain) * squares[1])
        shape[level] += 0.5
        log += either
    return FilterMoments(mean, covariance, noise), log
