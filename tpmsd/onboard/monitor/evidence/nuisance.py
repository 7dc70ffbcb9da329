"""Harmless changes of radii: what wheels have in common, axles, sides, and each wheel alone.

In: standard deviations. Out: a covariance over wheels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tpmsd.foundation.wheels import IS_FRONT, IS_LEFT, FloatArray
from tpmsd.onboard.monitor.evidence.kernel import compiled


@dataclass(frozen=True, slots=True)
class Nuisance:
    """Standard deviations of nuisance changes since the baseline, relative to the radius."""

    common: float
    axle: float
    side: float
    own: float

    def covariance(self, wheels: list[int], radius_m: FloatArray) -> FloatArray:
        """Return the (d, d) covariance over the given wheels, m2."""
        d = len(wheels)
        out = np.ones((d, d)) * self.common**2 + np.eye(d) * self.own**2
        for contrast, std in ((IS_FRONT[wheels], self.axle), (IS_LEFT[wheels], self.side)):
            sign = np.where(contrast, 1.0, -1.0)
            out += np.outer(sign, sign) * std**2
        return out * np.outer(radius_m, radius_m)

    def averaged(self, share: float) -> Nuisance:
        """Return the nuisance of a mean in which the variances by side and by wheel, which fluctuate quickly,
        have fallen to `share`. What axles and all wheels do together lasts for minutes and stays."""
        quick = math.sqrt(share)
        return replace(self, side=self.side * quick, own=self.own * quick)


def variance_ratio_of_mean(samples: int, correlation: float) -> float:
    """Return the variance of the mean of so many samples in a row, relative to that of one, where neighbours
    have this correlation and those further apart its powers (first-order Gauss-Markov)."""
    lags = np.arange(1, samples)
    return float(1.0 + 2.0 * np.sum((1.0 - lags / samples) * correlation**lags)) / samples


def log_normal(value: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the (n,) log densities of values (n, d) or (d,) under N(0, covariance (n, d, d)), but for a
    constant."""
    square, log_volume = squares(np.broadcast_to(value, covariance.shape[:2]), covariance)
    return np.asarray(-0.5 * (square + log_volume))


def squared_distance(value: FloatArray, covariance: FloatArray) -> float:
    """Return the squared Mahalanobis distance of a value (d,) from 0 under a covariance (d, d)."""
    return float(squares(value[None], covariance[None])[0][0])


def squares(values: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the squared Mahalanobis distance of each value (n, d), and the logarithm of each covariance's
    (n, d, d) determinant, (n,) each: by compiled code where it was built."""
    found = squares_by_compiled(values, covariance) if compiled is not None else None
    return squares_by_arrays(values, covariance) if found is None else found


def squares_by_compiled(values: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Return `squares` computed by `_evidence.c`; None where a covariance has no factor."""
    square, log_volume = np.empty(len(values)), np.empty(len(values))
    given = np.ascontiguousarray(values), np.ascontiguousarray(covariance)
    return (square, log_volume) if compiled.squares(square, log_volume, *given) else None


def squares_by_arrays(values: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return `squares` computed by NumPy, the reference."""
    _, log_volume = np.linalg.slogdet(covariance)
    solved = np.linalg.solve(covariance, values[:, :, None])[:, :, 0]
    return np.asarray(np.einsum("nd,nd->n", values, solved)), log_volume
