"""Smoothing of evenly spaced samples by a Gaussian, a running median or a running mean.

In: samples, a width in samples. Out: as many smoothed ones. The conventions are those of `scipy.ndimage`
(kernel cut off at four standard deviations), whose import alone takes longer than smoothing a drive.
"""

from __future__ import annotations

import numpy as np

from tpmsd.foundation.wheels import FloatArray

CUT_STDS = 4.0
"""Distance at which the Gaussian is cut off, in standard deviations."""
NEAREST, REFLECT = "edge", "symmetric"
"""Values taken for samples beyond the ends: the last one, or those inside, mirrored."""


def gaussian(values: FloatArray, sigma: float, beyond: str = REFLECT) -> FloatArray:
    """Return (n,) or (n, m) values smoothed along the first axis by a Gaussian of `sigma` samples."""
    if not len(values):
        return values.copy()
    radius = int(CUT_STDS * sigma + 0.5)
    weights = np.exp(-0.5 * np.square(np.arange(-radius, radius + 1) / sigma))
    weights /= weights.sum()
    columns = values.reshape(len(values), -1).T
    smooth = [np.convolve(_padded(column, radius, beyond), weights, mode="valid") for column in columns]
    return np.stack(smooth, axis=1).reshape(values.shape)


def running_median(values: FloatArray, size: int, beyond: str = NEAREST) -> FloatArray:
    """Return the (n,) median of an odd number of samples around each."""
    return np.asarray(np.median(_sliding_windows(values, size, beyond), axis=1))


def running_mean(values: FloatArray, size: int, beyond: str = REFLECT) -> FloatArray:
    """Return the (n,) mean of an odd number of samples around each."""
    return np.asarray(np.mean(_sliding_windows(values, size, beyond), axis=1))


def _sliding_windows(values: FloatArray, size: int, beyond: str) -> FloatArray:
    """Return the (n, size) samples around each."""
    return np.lib.stride_tricks.sliding_window_view(_padded(values, size // 2, beyond), size)


def _padded(values: FloatArray, more: int, beyond: str) -> FloatArray:
    """Return the values with `more` samples added at both ends, by the edge's value or mirrored."""
    return np.pad(values, more, mode="edge" if beyond == NEAREST else "symmetric")
