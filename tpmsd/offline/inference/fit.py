"""Least squares over drives, as pure functions: the same arguments give the same bits.

In: innovations and columns of each drive (`Gram`), priors. Out: `ParameterFit`. Columns of one key are one
value whatever the drive. Data may have r replicates (a bootstrap): gains and columns are computed once for
all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True)
class Gram:
    """All that least squares need of one drive."""

    keys: tuple[str, ...]
    """(p,)"""
    XX: FloatArray
    """(p, p)"""
    XY: FloatArray
    """(p, r)"""
    YY: FloatArray
    """(r,)"""
    logdet: float = 0.0
    """Sum of the innovations' log variances."""


@dataclass(frozen=True)
class ParameterFit:
    """Values of all keys, for each of r replicates."""

    keys: tuple[str, ...]
    """(k,)"""
    values: FloatArray
    """(k, r)"""
    covariance: FloatArray
    """(k, k)"""
    log_likelihood: FloatArray
    """(r,) with the values at their best, up to a constant that no noise changes; with a prior, of the
    posterior."""

    def std(self, key: str) -> float:
        """Return the standard deviation of a key's value."""
        at = self.keys.index(key)
        return float(np.sqrt(self.covariance[at, at]))


Prior = Mapping[str, tuple[float, float]]
"""Mean and standard deviation by key; a key that is not there is free."""


def gram(keys: Sequence[str], y: FloatArray, X: FloatArray, logdet: float = 0.0) -> Gram:
    """Return the Gram matrices of innovations: data (n, r) and columns (n, p)."""
    XX, XY, YY = read_only(X.T @ X, X.T @ y, (y * y).sum(axis=0))
    return Gram(tuple(keys), XX, XY, YY, logdet)


def solved(grams: Sequence[Gram], prior: Prior) -> ParameterFit:
    """Return the maximum-a-posteriori values (k, r) of the summed Gram matrices of all drives."""
    keys = tuple(dict.fromkeys(key for one in grams for key in one.keys))
    index = {key: at for at, key in enumerate(keys)}
    replicates = grams[0].XY.shape[1]
    information, right = np.zeros((len(keys), len(keys))), np.zeros((len(keys), replicates))
    misfit = np.zeros(replicates)
    for one in grams:
        at = [index[key] for key in one.keys]
        np.add.at(information, np.ix_(at, at), one.XX)
        np.add.at(right, at, one.XY)
        misfit += one.YY + one.logdet
    for key, (mean, std) in prior.items():
        if key in index:
            at_key = index[key]
            information[at_key, at_key] += 1.0 / std**2
            right[at_key] += mean / std**2
            misfit += (mean / std) ** 2 + 2.0 * np.log(std)
    size = np.sqrt(np.diag(information))
    if not np.all(size > 0.0):
        raise ValueError(f"nothing tells {keys[int(np.argmin(size))]}")
    try:
        factor = scipy.linalg.cho_factor(information / np.outer(size, size), lower=True)
    except np.linalg.LinAlgError:
        raise ValueError(f"the drives do not tell {' '.join(keys)} apart") from None
    covariance = scipy.linalg.cho_solve(factor, np.eye(len(keys))) / np.outer(size, size)
    covariance = 0.5 * (covariance + covariance.T)
    values = covariance @ right
    likelihood = -0.5 * (misfit - (right * values).sum(axis=0))
    values, covariance, likelihood = read_only(values, covariance, likelihood)
    return ParameterFit(keys, values, covariance, likelihood)


def read_only(*arrays: FloatArray) -> tuple[FloatArray, ...]:
    """Mark the arrays as read-only and return them."""
    for array in arrays:
        array.flags.writeable = False
    return arrays
