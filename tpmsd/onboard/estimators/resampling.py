"""Resampling of weighted particles.

In: normalised weights and a random generator. Out: indices of the particles to keep. Unbiased: a particle's
expected number of copies is N times its weight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.settings import SETTINGS


def effective_number(weights: FloatArray) -> float:
    """Effective number of particles 1 / sum(w^2) [Lundquist 2013, Table I, line 16]."""
    return float(1.0 / np.dot(weights, weights))


def systematic(weights: FloatArray, rng: np.random.Generator) -> NDArray[np.intp]:
    """Systematic resampling: one uniform draw, N equally spaced pointers into the cumulative weights;
    (N,)."""
    count = weights.size
    pointers = (np.arange(count) + rng.random()) / count
    edges = np.cumsum(weights)
    edges[-1] = 1.0  # rounding must not leave a pointer without a particle
    return np.searchsorted(edges, pointers, side="right").astype(np.intp)


@dataclass(frozen=True, slots=True)
class Systematic:
    """Systematic resampling where N_eff <= `below` N (Table I, lines 16 and 17)."""

    below: float = SETTINGS.resample_below

    def __call__(self, weights: FloatArray, rng: np.random.Generator) -> NDArray[np.intp] | None:
        """Indices (N,) of the particles to keep; None: all as they are."""
        if not effective_number(weights) <= self.below * weights.size:  # true for NaN
            return None
        return systematic(weights, rng)


SYSTEMATIC = Systematic()
