"""Kalman arithmetic for many small filters at once.

In: means (N, n) and covariances (N, n, n) of N particles. Out: the same, updated in place, with
log-likelihoods. Scalar measurements one after the other: no matrix inverse, and each can be judged on its
own.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.settings import SETTINGS

Weights = Callable[[FloatArray], FloatArray]
"""Equivalent weights, 0 < w <= 1, of residuals in standard deviations."""


def square_weights(size: FloatArray) -> FloatArray:
    """Return the (n,) robust weights of standardised residuals: 1 up to `robust_from`, then falling with
    their square."""
    return np.asarray(np.maximum(size / SETTINGS.robust_from, 1.0) ** -2)


def scalar_update(
    mean: FloatArray,
    covariance: FloatArray,
    innovation: FloatArray,
    row: FloatArray,
    variance: float,
    frozen_from: int | None = None,
    weights: Weights = square_weights,
) -> FloatArray:
    """Update by one scalar measurement z = row . x + noise for all particles, robustly; changes mean and
    covariance in place.

    innovation (N,): z - prediction; row (n,) or (N, n). The measurement variance of a particle is divided by
    the equivalent weight of its innovation: an outlier's pull falls off as its distance grows. States from
    `frozen_from` on are considered but not changed (Schmidt's consider filter): the others' gains and
    covariances allow for them, their own mean and covariance stay. Returns the log-likelihood (N,) under a
    Student-t of the same scale.
    """
    # Hypotheses last: in this order those of the mixture lie in memory (`error_state.side_by_side`).
    state, spread, size = mean.T, covariance.transpose(1, 2, 0), mean.shape[1]
    if row.ndim == 2:
        gain = np.einsum("jkn,nk->jn", spread, row)
        projected = np.einsum("jn,nj->n", gain, row)
    else:
        gain = (row @ spread.reshape(size, -1)).reshape(size, -1)
        projected = row @ gain
    total = projected + variance
    squared = innovation**2 / total
    dof = SETTINGS.innovation_dof
    log = -0.5 * (dof + 1.0) * np.log1p(squared / dof) - 0.5 * np.log(total)
    total = projected + variance / weights(np.sqrt(squared))
    # K g' with K = g / total, formed from one scaled copy of g, so that rounding keeps it symmetric.
    root = gain / np.sqrt(total)
    first = slice(frozen_from)
    state[first] += gain[first] * (innovation / total)
    spread[first] -= root[first, None] * root
    if frozen_from is not None:
        spread[frozen_from:, first] -= root[frozen_from:, None] * root[first]
    return np.asarray(log)


MIN_VARIANCE = 1e-14
"""Rounding error of a variance that has become nothing, in any of the states' units squared."""


def symmetrise(covariance: FloatArray) -> None:
    """Make covariances symmetric with positive diagonals again, which rounding has spoilt, in place."""
    covariance += covariance.swapaxes(-1, -2)
    covariance *= 0.5
    diagonal = np.einsum("ijj->ij", covariance)
    np.maximum(diagonal, MIN_VARIANCE, out=diagonal)
