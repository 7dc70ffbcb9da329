"""Fraction of the reachable improvement that the found physics reached, and structure of what is left.

In: each drive's whitened columns and the chosen terms. Out: `Reach`. What is reachable is measured, not
assumed: on top of the found model a flexible one (every spline term of every wheel pattern, every effect's
column, all at once, shrunk as far as the data ask for) is fitted to the same blocks and must predict the same
held-out ones. What it still gains there is what a better model could have gained.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.special import chdtrc

from tpmsd.car.physics.catalogue import ALWAYS
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.terms import Name
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.gram import Grams
from tpmsd.offline.inference.least_squares import FOLDS
from tpmsd.offline.inference.windows import CHANNEL_NAMES

_SHRINKAGE = SETTINGS.assessment.shrinkage
"""Prior standard deviation of a column's value, in units of its own noise."""
_MODELS = ("calibration", "model")
_CALIBRATION = (*ALWAYS, "data", "ramp", "wheel_slip", "side_slip")
"""Columns that are no part of the flexible model: ramps and slips are spline terms once more."""


@dataclass(frozen=True)
class ChannelReach:
    """One channel's share; nats of held-out log-likelihood."""

    found: float
    """Gained by the found model over calibration alone."""
    left: float
    """Gained by the flexible model beyond the found one."""
    correlation: float
    """Correlation of what is left with itself one window later."""
    whiteness: float
    """Probability that white noise would be as correlated over the next windows as what is left."""


@dataclass(frozen=True)
class Reach:
    """Record of what was reached and what is left."""

    found: float
    left: float
    left_std: float
    """Standard deviation by the scatter of the blocks."""
    channels: dict[str, ChannelReach]

    @property
    def share(self) -> float | None:
        """Return the share of the reachable log-likelihood gain that the found model reached, 0 to 1.

        None where nothing was found and nothing is left.
        """
        found, left = max(self.found, 0.0), max(self.left, 0.0)
        return None if found == 0.0 and not self.structured else found / (found + left)

    @property
    def structured(self) -> bool:
        """True if the gain that is left exceeds what the scatter of the blocks explains."""
        return self.left > max(2.0 * self.left_std, 4.0)


@dataclass(frozen=True)
class WhitenedColumns:
    """One drive's whitened columns; designs are in its own n columns, the data's first."""

    white: FloatArray
    """(w, 9, n)"""
    measured: np.ndarray
    """(w, 9)"""
    blocks: np.ndarray
    """(w,) the block of each window."""
    names: Sequence[Name]
    """Names of the columns; there may be further columns, which belong to the model alone."""
    calibration: FloatArray
    """(n, c) and `model` (n, k): what is fitted before and after. Their columns are the same numbers in all
    drives; what is another drive's own is zero here."""
    model: FloatArray


def assess_reach(drives: Sequence[WhitenedColumns]) -> Reach:
    """Return the held-out gains of the found model over calibration, and of a flexible model over the found
    one; every fifth block of each drive is held out in turn."""
    gains = [np.zeros((2, *one.measured.shape)) for one in drives]
    residuals = [np.zeros(one.measured.shape) for one in drives]
    folds = [Grams(one.white, one.blocks).by_fold(FOLDS) for one in drives]
    wholes = [one.sum(axis=0) for one in folds]
    for fold in range(FOLDS):
        trained = [whole - one[fold] for whole, one in zip(wholes, folds, strict=True)]
        values = [_fitted_values(drives, trained, name) for name in _MODELS]
        for one, gram, gain, left in zip(drives, trained, gains, residuals, strict=True):
            here = one.blocks % FOLDS == fold
            rolling, found = (
                _residual_weights(one, name, v) for name, v in zip(_MODELS, values, strict=True)
            )
            free = found - _flexible_weights(one, found, gram)
            rows = [one.white[here] @ weights for weights in (rolling, found, free)]
            gain[0, here] = 0.5 * (rows[0] ** 2 - rows[1] ** 2)
            gain[1, here] = 0.5 * (rows[1] ** 2 - rows[2] ** 2)
            left[here] = rows[1]
    by_block = np.concatenate(
        [np.bincount(one.blocks, gain[1].sum(axis=1)) for one, gain in zip(drives, gains, strict=True)]
    )
    measured = np.concatenate([one.measured for one in drives])
    found_gain, left_gain = (np.concatenate([gain[k] for gain in gains]) for k in range(2))
    return Reach(
        found=float(found_gain.sum()),
        left=float(left_gain.sum()),
        left_std=float(np.sqrt(len(by_block) * by_block.var())),
        channels={
            name: _channel_reach(name, measured, found_gain, left_gain, np.concatenate(residuals))
            for name in dict.fromkeys(CHANNEL_NAMES)
            if measured[:, _channel_mask(name)].any()
        },
    )


def _fitted_values(
    drives: Sequence[WhitenedColumns], trained: Sequence[FloatArray], which: str
) -> FloatArray:
    """Return the (k,) values of a design, fitted to Gram matrices (n, n) of all drives' trained blocks."""
    gram: FloatArray = np.zeros(0)
    for one, whole in zip(drives, trained, strict=True):
        design = getattr(one, which)
        into = np.concatenate([np.eye(len(design), 1), design], axis=1)
        part = into.T @ whole @ into
        gram = part if not gram.size else gram + part
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram)[1:], 1e-300))
    A = gram[1:, 1:] * np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
    return np.asarray(np.linalg.solve(A, gram[1:, 0] * scale) * scale)


def _residual_weights(one: WhitenedColumns, which: str, values: FloatArray) -> FloatArray:
    """Return the (n,) weights of the columns in the residual of a design with these values."""
    weights: FloatArray = -getattr(one, which) @ values
    weights[0] += 1.0
    return weights


def _flexible_weights(one: WhitenedColumns, found: FloatArray, gram: FloatArray) -> FloatArray:
    """Return the (n,) weights by which the flexible model explains part of the found model's residual, from
    the Gram matrix (n, n) of the trained blocks.
    Its values are shrunk by the factor under which the data are likeliest (MacKay, Neural Computation 4,
    1992); the calibration is fitted along.
    """
    data = gram @ found
    base = one.calibration[:, np.any(one.calibration != 0.0, axis=0)]
    base = base / np.sqrt(np.maximum((base * (gram @ base)).sum(axis=0), 1e-300))
    A = scipy.linalg.cho_factor(base.T @ gram @ base + 1e-9 * np.eye(base.shape[1]))
    columns = np.array([k for k, name in enumerate(one.names) if name[0] not in _CALIBRATION])
    cross = scipy.linalg.cho_solve(A, base.T @ gram[:, columns])
    information = np.diag(gram)[columns]
    rest = gram[np.ix_(columns, columns)] - (gram[columns] @ base) @ cross
    # Columns that say nothing, or nothing that calibration does not say already, stay out.
    new = (information > 1e-12 * max(information.max(), 1e-300)) & (np.diag(rest) > 1e-6 * information)
    columns, cross, size = columns[new], cross[:, new], np.sqrt(information[new])
    b = (data[columns] - cross.T @ (base.T @ data)) / size
    eigenvalues, vectors = np.linalg.eigh(rest[np.ix_(new, new)] / np.outer(size, size))
    eigenvalues, b = np.maximum(eigenvalues, 0.0), vectors.T @ b
    power = (_SHRINKAGE**2 * max(float(gram[0, 0]), 1.0))[:, None]
    likelihood = 0.5 * (power * b**2 / (1.0 + power * eigenvalues) - np.log1p(power * eigenvalues)).sum(
        axis=1
    )
    best = power[int(np.argmax(likelihood)), 0]
    out = np.zeros(len(gram))
    out[columns] = vectors @ (best * b / (1.0 + best * eigenvalues)) / size
    out += base @ scipy.linalg.cho_solve(A, base.T @ (data - gram @ out))
    return out


def _channel_mask(name: str) -> np.ndarray:
    """Return the (9,) mask of the columns that belong to a channel."""
    return np.array([channel == name for channel in CHANNEL_NAMES])


def _channel_reach(
    name: str, measured: np.ndarray, found: FloatArray, left: FloatArray, residual: FloatArray
) -> ChannelReach:
    """Return one channel's gains found and left, and the autocorrelation and Ljung-Box p-value of its
    residual."""
    at = _channel_mask(name)
    rows, here = np.where(measured[:, at], residual[:, at], np.nan), int(measured[:, at].sum())
    rows = rows - np.nanmean(rows)
    correlations = []
    for lag in range(1, SETTINGS.assessment.lags + 1):
        products = rows[lag:] * rows[:-lag]
        correlations.append(float(np.nansum(products) / max(np.nansum(rows**2), 1e-300)))
    # Ljung and Box, Biometrika 65, 1978.
    portmanteau = here * (here + 2) * sum(r**2 / max(here - lag, 1) for lag, r in enumerate(correlations, 1))
    return ChannelReach(
        found=float(found[:, at].sum()),
        left=float(left[:, at].sum()),
        correlation=correlations[0],
        whiteness=float(chdtrc(SETTINGS.assessment.lags, portmanteau)),
    )
