"""Least squares with standard errors from blocks of driving.

In: a design, an observation, block numbers. Out: coefficients and their covariance (jackknife over blocks:
Bell, McCaffrey 2002), which holds where errors within a block go together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tpmsd.foundation.wheels import FloatArray

_ROUNDS = 6


@dataclass(frozen=True, slots=True)
class RegressionFit:
    """Coefficients (k,) of a linear regression with covariance (k, k), rms residual and number of rows."""

    value: FloatArray
    """(k,)"""
    cov: FloatArray
    """(k, k)"""
    residual_rms: float
    r2: float
    rows: int

    def std(self, k: int) -> float:
        """Return the standard error of one coefficient."""
        return float(np.sqrt(max(self.cov[k, k], 0.0)))


def with_prior(made: RegressionFit, mean: FloatArray, std: FloatArray) -> RegressionFit:
    """Return the coefficients with a prior; `mean`, `std` (k,), infinite for none.

    The product of two normal densities, the fit's with its own covariance: noise between rows that goes
    together is in that already, and a prior among the rows would be drowned by their number.
    """
    scale = np.sqrt(np.maximum(np.diag(made.cov), 1e-300))
    precision = np.linalg.inv(made.cov / np.outer(scale, scale) + 1e-12 * np.eye(len(scale)))
    known = np.diag((scale / std) ** 2)
    cov = np.linalg.inv(precision + known)
    value = cov @ (precision @ (made.value / scale) + known @ (mean / scale))
    return replace(made, value=value * scale, cov=cov * np.outer(scale, scale))


def fit(design: FloatArray, target: FloatArray, block: FloatArray) -> RegressionFit | None:
    """Fit `target` (n,) by `design` (n, k); None where too few rows are known or a column is empty.

    Rows beyond four robust standard deviations are left out once: spins, lost frames.
    """
    known = np.isfinite(target) & np.isfinite(design).all(axis=1)
    if known.sum() < 4 * design.shape[1] + 10:
        return None
    X, y, b = design[known], target[known], block[known]
    scale = np.sqrt((X**2).mean(axis=0))
    scale[scale == 0] = 1.0
    X = X / scale
    ridge = 1e-9 * len(y) * np.eye(X.shape[1])
    value = np.linalg.solve(X.T @ X + ridge, X.T @ y)
    residual = y - X @ value
    for _ in range(_ROUNDS):
        # Huber's weights: a jump of the receiver must not draw the line before it is left out.
        weight = np.minimum(
            1.0, 1.5 * 1.4826 * np.median(np.abs(residual)) / np.maximum(np.abs(residual), 1e-12)
        )
        weighted = X * weight[:, None]
        value = np.linalg.solve(weighted.T @ X + ridge, weighted.T @ y)
        residual = y - X @ value
    spread = 1.4826 * np.median(np.abs(residual))
    kept = np.abs(residual) <= 4.0 * spread + 1e-12
    if kept.sum() >= 4 * X.shape[1] + 10:
        X, y, b = X[kept], y[kept], b[kept]
        ridge = 1e-9 * len(y) * np.eye(X.shape[1])
        value = np.linalg.solve(X.T @ X + ridge, X.T @ y)
        residual = y - X @ value
    cov = _jackknife(X, residual, b, ridge)
    total = float(((y - y.mean()) ** 2).sum())
    r2 = 1.0 - float((residual**2).sum()) / total if total > 0 else 0.0
    return RegressionFit(
        value / scale, cov / np.outer(scale, scale), float(np.sqrt((residual**2).mean())), r2, len(y)
    )


def _jackknife(X: FloatArray, residual: FloatArray, block: FloatArray, ridge: FloatArray) -> FloatArray:
    """Return (k, k) covariance of the coefficients by leaving out one block after the other.

    Bell, McCaffrey 2002: blocks that weigh much (the few tight bends of a drive) pull the line to themselves,
    and a plain sandwich then takes its residuals for small.
    """
    _, index = np.unique(block, return_inverse=True)
    blocks, k = int(index.max()) + 1, X.shape[1]
    if blocks == 1:
        return np.diag(np.full(k, np.inf))
    grams, sums = np.zeros((blocks, k, k)), np.zeros((blocks, k))
    np.add.at(grams, index, X[:, :, None] * X[:, None, :])
    np.add.at(sums, index, X * residual[:, None])
    # A block without which a coefficient is not known leaves that to the ridge: its error is then large.
    moved = np.linalg.solve(X.T @ X + ridge - grams, sums[:, :, None])[:, :, 0]
    return np.asarray((blocks - 1) / blocks * (moved.T @ moved))
