"""Equivalent weights (IGG-III): how much to believe a reading.

In: residuals in standard deviations. Out: factors from 0 to 1. [Liu 2022, eq. 19], after Yang, Song and Xu
2002 (J. Geodesy 76), "Robust estimator for correlated observations based on bifactor equivalent weights".
"""

from __future__ import annotations

import numpy as np

from tpmsd.foundation.wheels import FloatArray


def igg3(residual: FloatArray, believe: float, refuse: float) -> FloatArray:
    """Return the weights, 0 to 1, of residuals in standard deviations, same shape.

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
