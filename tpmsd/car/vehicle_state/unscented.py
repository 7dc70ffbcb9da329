"""The unscented transform, for many Gaussians at once.

In: means (..., n) and covariances (..., n, n). Out: sigma points (..., 2n + 1, n) and their weights. With the
defaults (alpha 1, beta 0, kappa 3 - n) a transform through a quadratic has the exact mean in any dimension,
and each direction's fourth moment is that of a Gaussian.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True, slots=True)
class SigmaWeights:
    """Weights of the 2n + 1 points, and their distance from the mean in standard deviations."""

    mean: FloatArray
    covariance: FloatArray
    spread: float


def sigma_weights(
    size: int, alpha: float = 1.0, beta: float = 0.0, kappa: float | None = None
) -> SigmaWeights:
    """Return the weights of the scaled transform; `ValueError` if the points would not spread.

    `kappa` None: 3 - size, or 0 beyond three dimensions, where the middle's weight would be negative.
    """
    extra = max(3.0 - size, 0.0) if kappa is None else kappa
    total = alpha**2 * (size + extra)
    if not total > 0.0:
        raise ValueError(f"alpha^2 (n + kappa) = {total:g} is not above 0")
    mean = np.full(2 * size + 1, 0.5 / total)
    mean[0] = (total - size) / total
    covariance = mean.copy()
    covariance[0] += 1.0 - alpha**2 + beta
    return SigmaWeights(mean, covariance, float(np.sqrt(total)))


def sigma_points(mean: FloatArray, covariance: FloatArray, weights: SigmaWeights) -> FloatArray:
    """Return (..., 2n + 1, n) points: the mean, then mean plus and minus each column of the Cholesky
    factor."""
    root = np.swapaxes(np.linalg.cholesky(covariance), -1, -2) * weights.spread
    centre = mean[..., None, :]
    return np.concatenate([centre, centre + root, centre - root], axis=-2)


def moments(points: FloatArray, weights: SigmaWeights) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean (..., m), covariance (..., m, m) and the centred points of transformed sigma points."""
    mean = np.einsum("j,...jm->...m", weights.mean, points)
    centred = points - mean[..., None, :]
    return mean, cross(centred, centred, weights), centred


def cross(left: FloatArray, right: FloatArray, weights: SigmaWeights) -> FloatArray:
    """Return the (..., n, m) covariance of centred points (..., 2n + 1, n) with (..., 2n + 1, m)."""
    return np.asarray(np.swapaxes(left * weights.covariance[:, None], -1, -2) @ right)
