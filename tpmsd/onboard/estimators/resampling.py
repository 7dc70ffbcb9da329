"""Resampling of weighted particles, and what it leaves of them.

In: normalised weights and a random generator. Out: indices of the particles to keep. Unbiased: a particle's
expected number of copies is N times its weight. The marginalized particle filter resamples its Kalman filters
by these weights and moves the copies apart in `bank.particle_bank`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.settings import SETTINGS


def effective_number(weights: FloatArray) -> float:
    """Return the effective number of particles 1 / sum(w^2) [Lundquist 2013, Table I, line 16]."""
    return float(1.0 / np.dot(weights, weights))


def systematic(weights: FloatArray, rng: np.random.Generator, count: int | None = None) -> NDArray[np.intp]:
    """Return the (count,) indices of a systematic resampling: one uniform draw, `count` equally spaced
    pointers (None: as many as weights) into the cumulative weights."""
    count = weights.size if count is None else count
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


class Lineage:
    """Lineage: the earlier particles that the present ones descend from."""

    def __init__(self, count: int) -> None:
        self._older = np.arange(count)
        self._newer = np.arange(count)
        self._since_s = 0.0
        self.ancestors = count
        """Number of particles of `SETTINGS.lineage_s` to twice as long ago that have descendants."""

    def keep(self, index: NDArray[np.intp]) -> None:
        """Update the ancestors after a resampling to these indices."""
        self._older, self._newer = self._older[index], self._newer[index]
        self.ancestors = np.unique(self._older).size

    def copy(self, child: NDArray[np.intp], parent: NDArray[np.intp]) -> None:
        """Update the ancestors after particles `child` were overwritten by copies of `parent`."""
        self._older[child], self._newer[child] = self._older[parent], self._newer[parent]

    def elapse(self, duration_s: float) -> None:
        """Advance the time; every `SETTINGS.lineage_s` the ancestors become those of a later time."""
        self._since_s += duration_s
        if self._since_s >= SETTINGS.lineage_s:
            self._since_s = 0.0
            self._older, self._newer = self._newer, np.arange(self._newer.size)
            self.ancestors = np.unique(self._older).size


def between_std(radii_m: FloatArray, weights: FloatArray) -> float:
    """Return the standard deviation of radii (d, N) between particles, m, root mean square over the
    wheels."""
    away = radii_m - (radii_m @ weights)[:, None]
    return float(np.sqrt((np.square(away) @ weights).mean()))
