"""Equivalent weights of readings, and the adaptive factor, which is the weight of the prediction.

In: innovations and corrections with their standard deviations. Out: factors from 0 to 1. [Liu 2022, eqs 19
and 20].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.vehicle_state.robust import igg3
from tpmsd.foundation.wheels import FloatArray

MIN_WEIGHT = 1e-8
"""A reading of weight 0 is one of a variance so much larger: nothing divides by zero, nothing is learned."""
MIN_FACTOR = 0.02
"""Floor of the adaptive factor. At 0 the prediction would count for nothing, and what no reading sees (the
lateral speed) would be lost."""


@dataclass(frozen=True, slots=True)
class RobustSettings:
    """Limits of both weight functions (IGG-III), in standard deviations."""

    k0: float = 1.5
    """Residual up to which a reading has full weight, K0 of the paper: 1 to 1.5."""
    k1: float = 6.0
    """Residual from which it has none, Kg of the paper: 3 to 8."""
    c0: float = 1.5
    """Correction up to which the prediction has full weight: 1 to 1.5."""
    c1: float = 6.0
    """Correction from which it has least weight: 3 to 8."""

    def weights(self, innovation: FloatArray, std: FloatArray) -> FloatArray:
        """Return the (k,) equivalent weights (IGG-III) of readings by their innovations, at least
        `MIN_WEIGHT`."""
        return np.maximum(igg3(innovation / std, self.k0, self.k1), MIN_WEIGHT)

    def factor(self, correction: FloatArray, variance: FloatArray) -> float:
        """Return the adaptive factor, `MIN_FACTOR` to 1, by the correction of the state (n,) and its
        variances (n,).

        The printed norm adds metres to radians per second; here each state counts in its own standard
        deviations.
        """
        moved = np.sqrt(np.mean(correction**2 / variance))
        return max(float(igg3(moved, self.c0, self.c1)), MIN_FACTOR)
