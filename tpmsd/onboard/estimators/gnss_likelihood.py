"""How probable a position is: the likelihoods of sampled beliefs.

In: a `Fix` and how far the particles are from it. Out: a log-likelihood per particle.

[Lundquist 2013, eq. 10d] has white Gaussian errors of one known size. Here the size is what the receiver
states of each fix; the tails are Gaussian as printed, or heavy (multipath): Student-t, so that one outlier
cannot select the particles. That errors of real receivers are correlated over tens of seconds is left out as
in the paper, which makes the posterior too narrow; the Gaussian-sum filter carries them as a state.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Fix

PositionLog = Callable[[FloatArray, int], FloatArray]
"""Squared Mahalanobis distances (N,) and dimension -> log density up to a constant."""


def student_t_log(squared: FloatArray, dimension: int) -> FloatArray:
    """Log density, up to a constant, of a multivariate Student-t; `squared` is the squared Mahalanobis
    distance."""
    dof = SETTINGS.position_dof
    out: FloatArray = -0.5 * (dof + dimension) * np.log1p(squared / dof)
    return out


def gaussian_log(squared: FloatArray, dimension: int) -> FloatArray:
    """The same of a Gaussian, the paper's (10d)."""
    return -0.5 * squared


def position_variance(fix: Fix) -> float:
    """Variance per axis of a position, m2."""
    return max(fix.position_std_m, SETTINGS.position_floor_m) ** 2
