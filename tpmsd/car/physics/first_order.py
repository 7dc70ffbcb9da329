"""First-order recursions over evenly spaced samples: low-passes, heat that is left, Gauss-Markov sequences.

In: what comes in at each sample and the share that stays from one to the next. Out: what there is. Solved as
a banded triangular system, which needs a fraction of what importing a filter library costs.
"""

from __future__ import annotations

import math

import numpy as np

from tpmsd.foundation.wheels import FloatArray


def accumulated(fresh: FloatArray, kept: float, before: float = 0.0) -> FloatArray:
    """(n,) y with y[k] = kept * y[k - 1] + fresh[k], for fresh (n,); `before` stands before the first."""
    from scipy.linalg.blas import dtbsv

    if not len(fresh):
        return np.zeros(0)
    band = np.empty((2, len(fresh)), order="F")
    band[0], band[1] = 1.0, -kept
    start = np.array(fresh, dtype=np.float64)
    start[0] += kept * before
    return np.asarray(dtbsv(1, band, start, lower=1, diag=1, overwrite_x=1))


def low_passed(values: FloatArray, time_s: FloatArray, time_constant_s: float) -> FloatArray:
    """(n,) after a first-order low-pass that has settled at the first value; evenly spaced times."""
    if len(values) < 2 or time_constant_s <= 0.0:
        return values.copy()
    step = (time_s[-1] - time_s[0]) / (len(time_s) - 1)
    kept = math.exp(-step / time_constant_s)
    # Exact for values that are linear between the samples.
    new = 1.0 - (1.0 - kept) * time_constant_s / step
    old = (1.0 - kept) - new
    fresh = new * values + old * np.concatenate([values[:1], values[:-1]])
    return accumulated(fresh, kept, float(values[0]))
