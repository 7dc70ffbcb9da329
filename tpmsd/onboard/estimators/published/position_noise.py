"""Unknown variances of the receiver's position, one set per particle: [Lundquist 2013], eq. (32f), MPF-MN.

In: realised position errors of each particle (35). Out: log-likelihoods (34), updated statistics. The mean of
these errors is known, zero (32e), and their covariance diagonal (32f), so each axis has an inverse-Wishart of
dimension d = 1:

    nu <- lambda nu,  Lambda <- lambda Lambda           (20c), (20d), per tick's time since the fix before
    e ~ St(0, Lambda / nu, nu)                          (21) in its exact form, d = 1, mean known
    nu <- nu + 1,     Lambda <- Lambda + e^2            (19c), (19d)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.settings import SETTINGS


@dataclass(slots=True)
class PositionStatistics:
    """Inverse-gamma beliefs of N particles about both variances; nu is the same in every particle."""

    nu: float
    scale: FloatArray
    """(2, N) Lambda of east and north, m2."""

    def select(self, index: NDArray[np.intp]) -> PositionStatistics:
        """Keep the particles of these indices."""
        return PositionStatistics(self.nu, self.scale[:, index])


@dataclass(frozen=True, slots=True)
class PositionNoise:
    """The variances are parameters; frozen, its own parameters alone."""

    window_s: float = 60.0
    """Memory 1 / (1 - lambda), as that of the radii."""
    floor_m: float = SETTINGS.position_floor_m
    """Least standard deviation that may be learned: below it a bootstrap proposal would starve."""

    def remembering(self, window_s: float) -> PositionNoise:
        """Return the model with this memory, s."""
        return replace(self, window_s=window_s)

    def begin(self, count: int, stated_m: float) -> PositionStatistics:
        """Return the statistics of N particles before the first fix: the receiver's statement, as uncertain
        as the radii's noise."""
        nu = SETTINGS.niw_nu
        variance = max(stated_m, self.floor_m) ** 2
        return PositionStatistics(nu, np.full((2, count), variance * (nu - 2.0)))

    def weigh(self, state: PositionStatistics, error_m: FloatArray, since_s: float) -> FloatArray:
        """Return the log-likelihood (N,) of the errors (2, N) of a fix so long after the one before, and
        update the statistics in place. nu is floored at d + 2, where the mean of a variance exists."""
        share = max(0.0, 1.0 - since_s / self.window_s) if np.isfinite(since_s) else 1.0
        nu = max(share * state.nu, 3.0)
        state.scale *= nu / state.nu
        squared = error_m * error_m
        log = -0.5 * (nu + 1.0) * np.log1p(squared / state.scale) - 0.5 * np.log(state.scale)
        state.nu = nu + 1.0
        state.scale += squared
        np.maximum(state.scale, self.floor_m**2 * (state.nu - 2.0), out=state.scale)
        return np.asarray(log.sum(axis=0))
