"""How much of the reachable improvement the found physics reached, and whether what is left has structure.

In: whitened columns, their evidence and the chosen terms. Out: `Reach`. What is reachable is measured, not
assumed: on top of the found model a flexible one (every free shape at every place, every effect's column, all
at once, shrunk as far as the data ask for) is fitted to the same blocks and must predict the same held-out
ones. What it still gains there is what a better model could have gained.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.stats import chi2

from tpmsd.diagnosis.channels import CHANNEL_NAMES
from tpmsd.diagnosis.evidence import Evidence
from tpmsd.diagnosis.terms import Name
from tpmsd.wheels import FloatArray

LAGS = 10
"""Windows over which what is left is looked at for correlation."""
_SHRINKAGE = np.concatenate([[0.0], np.logspace(-4, 2, 37)])
"""Prior standard deviation of a column's value, in units of its own noise."""
_CALIBRATION = ("data", "radius", "gyro_delay", "ramp")
"""Columns that are no part of the flexible model: ramps are free shapes over time once more."""


@dataclass(frozen=True)
class ChannelReach:
    """One channel's share; nats of held-out log-likelihood."""

    found: float
    """Gained by the found model over calibration alone."""
    left: float
    """Gained by the flexible model beyond the found one."""
    correlation: float
    """Of what is left with itself one window later."""
    whiteness: float
    """Probability that white noise would be as correlated over the next windows as what is left."""


@dataclass(frozen=True)
class Reach:
    """What was reached and what is left."""

    found: float
    left: float
    left_std: float
    """By the scatter of the blocks."""
    channels: dict[str, ChannelReach]

    @property
    def share(self) -> float | None:
        """What was reached of the reachable; None where nothing was found and nothing is left."""
        found, left = max(self.found, 0.0), max(self.left, 0.0)
        return None if found == 0.0 and not self.structured else found / (found + left)

    @property
    def structured(self) -> bool:
        """Whether what is left is more than the scatter of the blocks explains."""
        return self.left > max(2.0 * self.left_std, 4.0)


def reach(
    white: FloatArray,
    measured: np.ndarray,
    blocks: np.ndarray,
    names: Sequence[Name],
    evidence: Evidence,
    calibration: FloatArray,
    model: FloatArray,
) -> Reach:
    """Compare three models on held-out blocks.

    `white` is (w, 9, 1 + p) with the columns `names` (later ones belong to the model alone), `measured`
    (w, 9), `blocks` (w,); `calibration` and `model` are designs (1 + p, k), the second holding the first.
    """
    flexible = np.array([k for k, name in enumerate(names) if name[0] not in _CALIBRATION])
    rolling, found, free = (np.zeros(white.shape[:2]) for _ in range(3))
    for fold in evidence.folds:
        inside = np.isin(blocks, fold)
        part = white[inside]
        for out, design in ((rolling, calibration), (found, model)):
            fit = evidence.fit(design, fold)
            out[inside] = part[:, :, 0] - part @ (design @ fit.values)
        free[inside] = part @ _flexible(evidence, model, flexible, fold)
    found_gain, left_gain = 0.5 * (rolling**2 - found**2), 0.5 * (found**2 - free**2)
    by_block = np.bincount(blocks, left_gain.sum(axis=1), evidence.blocks)
    return Reach(
        found=float(found_gain.sum()),
        left=float(left_gain.sum()),
        left_std=float(np.sqrt(evidence.blocks * by_block.var())),
        channels={
            name: _channel(name, measured, found_gain, left_gain, found)
            for name in dict.fromkeys(CHANNEL_NAMES)
            if measured[:, _columns(name)].any()
        },
    )


def _flexible(evidence: Evidence, model: FloatArray, columns: np.ndarray, left_out: np.ndarray) -> FloatArray:
    """(1 + p,) weights of the residual of model and shrunk columns, fitted without the blocks `left_out`.

    The shrinkage is the one under which the data are likeliest (MacKay, Neural Computation 4, 1992).
    """
    gram = evidence.total - evidence.by_block[left_out].sum(axis=0)
    width = gram.shape[0]
    scale = 1.0 / np.sqrt(np.maximum((model * (gram @ model)).sum(axis=0), 1e-300))
    base = model * scale
    A = scipy.linalg.cho_factor(base.T @ gram @ base + 1e-9 * np.eye(base.shape[1]))
    used = np.concatenate([[0], columns])
    cross = base.T @ gram[:, used]
    rest = gram[np.ix_(used, used)] - cross.T @ scipy.linalg.cho_solve(A, cross)
    told = np.diag(gram)[columns]
    # Columns that say nothing, or nothing that the model does not say already, stay out.
    new = (told > 1e-12 * max(told.max(), 1e-300)) & (np.diag(rest)[1:] > 1e-6 * told)
    columns, rest = columns[new], rest[np.ix_(np.append(True, new), np.append(True, new))]
    size = np.sqrt(told[new])
    G, b = rest[1:, 1:] / np.outer(size, size), rest[1:, 0] / size
    eigenvalues, vectors = np.linalg.eigh(G)
    eigenvalues, b = np.maximum(eigenvalues, 0.0), vectors.T @ b
    # Columns of unit size: information per column is 1, so a prior of n windows' worth starts at n.
    power = (_SHRINKAGE**2 * max(float(gram[0, 0]), 1.0))[:, None]
    likelihood = 0.5 * (power * b**2 / (1.0 + power * eigenvalues) - np.log1p(power * eigenvalues)).sum(
        axis=1
    )
    best = power[int(np.argmax(likelihood)), 0]
    values = vectors @ (best * b / (1.0 + best * eigenvalues)) / size
    weights = np.zeros(width)
    weights[0] = 1.0
    weights[columns] -= values
    kept = scipy.linalg.cho_solve(A, base.T @ (gram @ weights))
    return np.asarray(weights - base @ kept)


def _columns(name: str) -> np.ndarray:
    return np.array([channel == name for channel in CHANNEL_NAMES])


def _channel(
    name: str, measured: np.ndarray, found: FloatArray, left: FloatArray, residual: FloatArray
) -> ChannelReach:
    at = _columns(name)
    rows, here = np.where(measured[:, at], residual[:, at], np.nan), int(measured[:, at].sum())
    rows = rows - np.nanmean(rows)
    correlations = []
    for lag in range(1, LAGS + 1):
        products = rows[lag:] * rows[:-lag]
        correlations.append(float(np.nansum(products) / max(np.nansum(rows**2), 1e-300)))
    # Ljung and Box, Biometrika 65, 1978.
    portmanteau = here * (here + 2) * sum(r**2 / max(here - lag, 1) for lag, r in enumerate(correlations, 1))
    return ChannelReach(
        found=float(found[:, at].sum()),
        left=float(left[:, at].sum()),
        correlation=correlations[0],
        whiteness=float(chi2.sf(portmanteau, LAGS)),
    )
