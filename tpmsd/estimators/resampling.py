"""Resampling of weighted particles.

In: normalised weights and a random generator. Out: indices of the particles to keep. Unbiased: a particle's
expected number of copies is N times its weight.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tpmsd.wheels import FloatArray


def effective_number(weights: FloatArray) -> float:
    """Effective number of particles 1 / sum(w^2), paper 000, Table I, line 16."""
    return float(1.0 / np.dot(weights, weights))


def systematic(weights: FloatArray, rng: np.random.Generator) -> NDArray[np.intp]:
    """Systematic resampling: one uniform draw, N equally spaced pointers into the cumulative weights;
    (N,)."""
    count = weights.size
    pointers = (np.arange(count) + rng.random()) / count
    edges = np.cumsum(weights)
    edges[-1] = 1.0  # rounding must not leave a pointer without a particle
    return np.searchsorted(edges, pointers, side="right").astype(np.intp)
