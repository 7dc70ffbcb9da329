"""Equivalent weights (IGG-III): the weight of a reading by its residual.

In: residuals in standard deviations. Out: factors from 0 to 1. [Liu 2022, eq. 19], after Yang, Song and Xu
2002 (J. Geodesy 76), "Robust estimator for correlated observations based on bifactor equivalent weights".
"""

from __future__ import annotations

import numpy as np

from tpmsd.foundation.wheels import FloatArray


def igg3(residual: FloatArray, k0: float, k1: float) -> FloatArray:
    """Return the weights, 0 to 1, of residuals in standard deviations, same shape.

    1 up to `k0`; then k0 / |v| * ((k1 - |v|) / (k1 - k0))^2; 0 from `k1` on, and
    for NaN.
    """
    if not 0.0 < k0 < k1:
        raise ValueError(f"need 0 < k0 < k1, not {k0:g} and {k1:g}")
    size = np.abs(np.asarray(residual, dtype=np.float64))
    size = np.where(np.isnan(size), np.inf, size)
    between = np.clip(size, k0, k1)
    taper = k0 / between * ((k1 - between) / (k1 - k0)) ** 2
    return np.where(size <= k0, 1.0, np.where(size >= k1, 0.0, taper))
