"""How probable a position is for each particle of MPF-PN.

In: a `Fix` and how far the particles are from it. Out: a log-likelihood per particle.

Paper 000, eq. (10d), has white Gaussian errors of one known size. Here the size is what the receiver states
of each fix, and the tails are heavy (multipath): Student-t with 4 degrees of freedom, so that one outlier
cannot select the particles. That errors of real receivers are correlated over tens of seconds is left out as
in the paper, which makes the posterior too narrow; `mpf_rb` carries them as a state.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tpmsd.timeline.tick import Fix
from tpmsd.wheels import FloatArray

TAIL_DOF = 4.0
PositionLog = Callable[[FloatArray, int], FloatArray]
"""Squared Mahalanobis distances (N,) and dimension -> log density up to a constant."""
POSITION_FLOOR_M = 0.3
"""Below this the bootstrap proposal of Table I would starve; it also covers what the clocks leave."""


def student_t_log(squared: FloatArray, dimension: int) -> FloatArray:
    """Log density, up to a constant, of a multivariate Student-t; `squared` is the squared Mahalanobis
    distance."""
    out: FloatArray = -0.5 * (TAIL_DOF + dimension) * np.log1p(squared / TAIL_DOF)
    return out


def gaussian_log(squared: FloatArray, dimension: int) -> FloatArray:
    """The same of a Gaussian, the paper's (10d)."""
    return -0.5 * squared


def position_variance(fix: Fix) -> float:
    """Variance per axis of a position, m2."""
    return max(fix.position_std_m, POSITION_FLOOR_M) ** 2
