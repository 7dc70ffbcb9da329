"""A cheap look at what places may hold: scores row by row, without the path eliminated.

In: a selection. Out: numbers by which a term over time or over a covariate is worth a proper look. At the
likeliest path the gradient of the log-likelihood by a term is the sum of its rows' scores.
"""

from __future__ import annotations

import numpy as np
from scipy.special import fdtrc

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.columns import Probe, model_derivatives, step_derivative
from tpmsd.offline.dynamics.search import Search

PIECE_S = 2.0
"""Pieces of a drive whose scores count as independent: ten correlation times of the disturbances."""


def row_scores(search: Search, probe: Probe) -> FloatArray:
    """Return the scores of a term at the rows, (n,); the term acts at all of them alike."""
    at, setup, noise = search.at, search.setup, search.noise
    by_rate, by_output = model_derivatives(setup, search.theta, at, [probe])
    count = by_rate.shape[1]
    dt = np.diff(setup.drive.time_s)
    linked = setup.drive.linked
    step = step_derivative(at.by_rates, by_rate[0])
    pull = np.where(linked[:, None], at.step_residual / noise.step_variance(dt), 0.0)[:, :count]
    out = np.zeros(len(at.path))
    out[:-1] += np.sum(pull * step.T, axis=1)
    residual = np.where(np.isfinite(at.reading_residual), at.reading_residual, 0.0)
    out += np.sum(residual / noise.outputs**2 * by_output[0].T, axis=1)
    return out


def slow_share(search: Search, scores: FloatArray, long_s: float) -> float:
    """Return the variance of sums over `long_s` over that of white scores: 1 where nothing acts slowly."""
    time = search.setup.drive.time_s
    short = max(long_s / 10.0, 0.5)
    first = np.bincount(((time - time[0]) // short).astype(int), scores)
    second = np.bincount(((time - time[0]) // long_s).astype(int), scores)
    if len(second) < 3:
        return np.inf
    expected = len(first) / len(second) * float(np.mean(first**2))
    return float(np.mean(second**2)) / max(expected, 1e-300)


def largest_span(search: Search, scores: FloatArray, box_s: float, boxes: int = 6) -> float:
    """Return the largest standardised sum over spans of up to so many boxes."""
    time = search.setup.drive.time_s
    sums = np.bincount(((time - time[0]) // box_s).astype(int), scores)
    size = np.median(np.abs(sums)) / 0.6745
    total = np.concatenate([[0.0], np.cumsum(sums)])
    best = 0.0
    for length in range(1, min(boxes, len(sums)) + 1):
        best = max(best, float(np.abs(total[length:] - total[:-length]).max()) / np.sqrt(length))
    return best / max(float(size), 1e-300)


def block_test(search: Search, scores: FloatArray, basis: list[FloatArray]) -> tuple[float, float]:
    """Return the p-value of a term's mean score over pieces (Hotelling), for basis functions (n,), and the
    log-likelihood ratio, which orders p-values that are too small for a number."""
    time = search.setup.drive.time_s
    piece = ((time - time[0]) // PIECE_S).astype(int)
    table = np.stack([np.bincount(piece, scores * one) for one in basis], axis=1)
    count, size = table.shape
    if count <= size + 2:
        return 0.0, 0.0
    mean = table.mean(axis=0)
    spread = np.cov(table.T) + 1e-12 * np.eye(size) * max(float(np.trace(np.cov(table.T))), 1e-300)
    squared = count * mean @ np.linalg.solve(spread, mean)
    p_value = float(fdtrc(size, count - size, squared * (count - size) / (size * (count - 1))))
    return p_value, 0.5 * count * float(np.log1p(max(squared, 0.0) / (count - 1)))
