"""Gain of a group of columns, by Gram matrices.

In: a design, the Gram matrix and correlation of all columns. Out: log-likelihood and first value.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg.lapack import dgesv

from tpmsd.foundation.wheels import FloatArray


def group_gain(design: FloatArray, gram: FloatArray, b: FloatArray) -> tuple[float, float]:
    """Return the log-likelihood gain (nats) of a design (p, k) and its first fitted value, from the Gram
    matrix (p, p) and the correlation with the data (p,)."""
    rows = np.flatnonzero(np.any(design != 0.0, axis=1))
    return gain_of_rows(rows, design[rows], gram, b)


def gain_of_rows(rows: np.ndarray, part: FloatArray, gram: FloatArray, b: FloatArray) -> tuple[float, float]:
    """Return gain and first value as `group_gain`, of a design whose rows `rows` (m,) are `part` (m, k) and
    else zero."""
    if part.shape == (1, 1):
        return _gain_of_scaled_column(float(part[0, 0]), float(gram[rows[0], rows[0]]), float(b[rows[0]]))
    A = part.T @ gram[rows[:, None], rows] @ part
    score = part.T @ b[rows]
    diagonal = A.ravel()[:: len(score) + 1]
    scale = np.sqrt(np.maximum(diagonal, 1e-300))
    A /= scale[:, None] * scale
    # A column that the others already explain has next to nothing left: it cannot bring anything.
    diagonal += 1e-6
    score /= scale
    _, _, values, failed = dgesv(A, score)
    if failed:
        raise np.linalg.LinAlgError("singular Gram matrix")
    return 0.5 * float(score @ values), float(values[0] / scale[0])


def _gain_of_scaled_column(factor: float, square: float, correlation: float) -> tuple[float, float]:
    """Return gain and first value as `gain_of_rows` of a multiple of one column, in scalar arithmetic."""
    information, score = factor * square * factor, factor * correlation
    scale = math.sqrt(max(information, 1e-300))
    score /= scale
    value = score / (information / (scale * scale) + 1e-6)
    return 0.5 * (score * value), value / scale
