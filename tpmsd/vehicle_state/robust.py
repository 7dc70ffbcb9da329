"""Equivalent weights (IGG-III) and the adaptive factor: how much to believe a reading, and the prediction.

In: residuals in standard deviations. Out: factors from 0 to 1. Paper 004, eqs (19) and (20), after Yang, Song
and Xu 2002 (J. Geodesy 76), "Robust estimator for correlated observations based on bifactor equivalent
weights".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.wheels import FloatArray

MIN_WEIGHT = 1e-8
"""A reading of weight 0 is one of a variance so much larger: nothing divides by zero, nothing is learned."""
MIN_FACTOR = 0.02
"""Floor of the adaptive factor. At 0 the prediction would count for nothing, and what no reading sees (the
lateral speed) would be lost."""


def igg3(residual: FloatArray, believe: float, refuse: float) -> FloatArray:
    """Weights of residuals in standard deviations, same shape.

    1 up to `believe`; then believe / |v| * ((refuse - |v|) / (refuse - believe))^2; 0 from `refuse` on, and
    for NaN.
    """
    if not 0.0 < believe < refuse:
        raise ValueError(f"need 0 < believe < refuse, not {believe:g} and {refuse:g}")
    size = np.abs(np.asarray(residual, dtype=np.float64))
    size = np.where(np.isnan(size), np.inf, size)
    between = np.clip(size, believe, refuse)
    taper = believe / between * ((refuse - between) / (refuse - believe)) ** 2
    return np.where(size <= believe, 1.0, np.where(size >= refuse, 0.0, taper))


@dataclass(frozen=True, slots=True)
class RobustSettings:
    """Zones of both functions, in standard deviations."""

    believe: float = 1.5
    """K0, 1 to 1.5."""
    refuse: float = 6.0
    """Kg, 3 to 8."""
    keep: float = 1.5
    """c0, 1 to 1.5."""
    abandon: float = 6.0
    """c1, 3 to 8."""

    def weights(self, innovation: FloatArray, std: FloatArray) -> FloatArray:
        """Equivalent weights of readings by their innovations, floored so that they can divide."""
        return np.maximum(igg3(innovation / std, self.believe, self.refuse), MIN_WEIGHT)

    def factor(self, correction: FloatArray, variance: FloatArray) -> float:
        """Adaptive factor by how far the readings pull the prediction (n,), given its variances (n,).

        The printed norm adds metres to radians per second; here each state counts in its own standard
        deviations.
        """
        moved = np.sqrt(np.mean(correction**2 / variance))
        return max(float(igg3(moved, self.keep, self.abandon)), MIN_FACTOR)
