"""Evidence of the data for and against sets of hypotheses, from sums over blocks of time.

In: whitened innovations of each drive (column 0 the data, the others responses) and the blocks they fall
into. Out: `Evidence`, which fits any linear combinations of columns over all drives at once, holds blocks
or whole drives out, and tells how far a block-wise variance exceeds the assumed one. After whitening, all
questions are about small Gram matrices, so thousands of hypotheses cost milliseconds. Each drive has
columns of its own; which of them are one and the same number is said by a common index.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.gram import Grams

FOLDS = 5
DRIVES = 3
"""From so many drives on, whole drives are held out."""
_RIDGE = 1e-9


@dataclass(frozen=True)
class LeastSquaresFit:
    """A least-squares fit of k combinations of columns."""

    design: FloatArray
    """(1 + p, k) the combinations."""
    values: FloatArray
    """(k,)"""
    covariance: FloatArray
    """(k, k), for unit noise."""
    gain: float
    """Log-likelihood over that of no columns at all."""

    def known(self, column: int, std: float) -> LeastSquaresFit:
        """Return the fit with one value known to be zero within `std`; the gain remains that of the data."""
        across = self.covariance[:, column]
        total = std**2 + across[column]
        return replace(
            self,
            values=self.values - across * (self.values[column] / total),
            covariance=self.covariance - np.outer(across, across) / total,
        )


@dataclass(frozen=True)
class DriveGrams:
    """One drive's Gram matrices, and where its columns stand in the common index."""

    grams: Grams
    """Gram matrices of the drive's own n columns, the data first."""
    here: np.ndarray
    """(m,) places in the common index, each once."""
    local: np.ndarray
    """(m,) which own column stands at each; one column may stand at several places."""
    data: FloatArray | None = None
    """(n,) what is taken for the data: a combination of own columns; None for the first of them."""

    @property
    def blocks(self) -> int:
        """Return the number of blocks of the drive."""
        return self.grams.blocks

    def own(self, design: FloatArray) -> FloatArray:
        """Return a common design as (n, k) in the drive's own columns."""
        out = np.zeros((self.grams.width, design.shape[1]))
        np.add.at(out, self.local, design[self.here])
        return out

    @property
    def total(self) -> FloatArray:
        """Return the (n, n) Gram matrix of the data and the columns."""
        total = self.grams.total
        if self.data is None:
            return total
        out, cross = total.copy(), total @ self.data
        out[0] = out[:, 0] = cross
        out[0, 0] = cross @ self.data
        return out

    def small(self, design: FloatArray) -> FloatArray:
        """Return the (blocks, 1 + k, 1 + k) Gram matrices of the data and a common design's columns."""
        data = np.eye(self.grams.width, 1) if self.data is None else self.data[:, None]
        own = np.concatenate([data, self.own(design)], axis=1)
        rows = np.flatnonzero(np.any(own != 0.0, axis=1))
        into = own[rows]
        return np.asarray(into.T @ (self.grams.by_block(rows) @ into))


def part(
    white: FloatArray, blocks: np.ndarray, here: np.ndarray | None = None, local: np.ndarray | None = None
) -> DriveGrams:
    """Return the `DriveGrams` of a drive's rows `white` (w, 9, n); `blocks` (w,) numbers each window's block
    from 0.
    """
    every = np.arange(white.shape[2])
    return DriveGrams(
        Grams(white, blocks), every if here is None else here, every if local is None else local
    )


class Evidence:
    """Gram matrices of whitened columns by drive and block."""

    def __init__(self, parts: Sequence[DriveGrams], width: int) -> None:
        """`width` is 1 + p, the length of the common index."""
        self.parts = list(parts)
        self.total = _common_total(self.parts, width)
        count = sum(one.blocks for one in self.parts)
        self.blocks = count
        self.folds = [np.flatnonzero(np.arange(count) % FOLDS == fold) for fold in range(min(FOLDS, count))]

    def less(self, weights: FloatArray) -> Evidence:
        """Return the evidence with a combination (1 + p,) of the columns subtracted from the data."""
        taken = -weights
        taken[0] += 1.0
        parts = []
        for one in self.parts:
            own = one.own(taken[:, None])[:, 0]
            if one.data is not None:
                own = own + own[0] * (one.data - np.eye(len(own))[0])
            parts.append(replace(one, data=own))
        return Evidence(parts, self.width)

    @property
    def width(self) -> int:
        """Return the number of columns, 1 + p, the data included."""
        return int(self.total.shape[0])

    def unit(self, *columns: int) -> FloatArray:
        """Return the (1 + p, k) design of single columns."""
        out = np.zeros((self.width, len(columns)))
        out[list(columns), np.arange(len(columns))] = 1.0
        return out

    def fit(self, design: FloatArray) -> LeastSquaresFit:
        """Return the least-squares fit of column 0 on the combinations `design`."""
        used = np.any(design != 0.0, axis=1)
        used[0] = True
        rows = np.flatnonzero(used)
        into = np.concatenate([(rows == 0).astype(np.float64)[:, None], design[rows]], axis=1)
        gram = into.T @ self.total[np.ix_(rows, rows)] @ into
        scale = _scale(gram)
        values, inverse, gain = _solved(gram, scale)
        return LeastSquaresFit(design, values * scale, inverse * np.outer(scale, scale), gain)

    def heldout(self, design: FloatArray) -> FloatArray:
        """Return the (blocks,) log-likelihood of each block with values fitted elsewhere, up to a constant.

        Elsewhere are the other folds' blocks; of three drives or more, the other drives.
        """
        small = [one.small(design) for one in self.parts]
        if len(small) >= DRIVES:
            return np.concatenate(_predicted_by_other_drives(small))
        by_block = np.concatenate(small)
        total = by_block.sum(axis=0)
        scale = _scale(total)
        out = np.zeros(self.blocks)
        for fold in self.folds:
            values, _, _ = _solved(total - by_block[fold].sum(axis=0), scale)
            vector = np.concatenate([[1.0], -values * scale])
            out[fold] = -0.5 * ((by_block[fold] @ vector) @ vector)
        return out

    def sandwich(self, fitted: LeastSquaresFit) -> FloatArray:
        """Return the (k,) ratio of the block-wise variance of each value to the one assumed.

        Blocks whose scores scatter more than white noise would (slow errors that no state holds) make
        values less certain than the Gram matrix says (White, Econometrica 48, 1980; clustered by block).
        """
        vector = np.concatenate([[1.0], -fitted.values])
        scores = np.concatenate([(one.small(fitted.design) @ vector)[:, 1:] for one in self.parts])
        spread = fitted.covariance @ (scores.T @ scores) @ fitted.covariance
        spread = spread * self.blocks / max(self.blocks - fitted.design.shape[1], 1)
        return np.asarray(np.diag(spread) / np.maximum(np.diag(fitted.covariance), 1e-300))

    def projected(self, design: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return Gram matrix (p, p) and correlation with the data (p,) of all columns, `design` projected
        out."""
        gram = self.total
        if design.shape[1]:
            rows = np.flatnonzero(np.any(design != 0.0, axis=1))
            into = design[rows]
            part = into.T @ gram[rows]
            norm = np.sqrt(np.maximum((into.T * part[:, rows]).sum(axis=1), 1e-300))
            part /= norm[:, None]
            A = part[:, rows] @ (into / norm) + _RIDGE * np.eye(len(norm))
            taken = part.T @ _solve_with_factor(_cholesky_factor(A), part)
            gram = np.subtract(gram, taken, out=taken)
        return gram[1:, 1:], gram[1:, 0]


def gain_of(gram: FloatArray) -> float:
    """Return the log-likelihood gain of the columns of a small Gram matrix (1 + k, 1 + k), the data first."""
    return _solved(gram, _scale(gram))[2]


def fitted(gram: FloatArray) -> tuple[FloatArray, float]:
    """Return the (k,) fitted values of a small Gram matrix's columns, the data first, and the gain."""
    scale = _scale(gram)
    values, _, gain = _solved(gram, scale)
    return values * scale, gain


def _scale(gram: FloatArray) -> FloatArray:
    """Return the (k,) factors that make the columns of a small Gram matrix of unit length."""
    return np.asarray(1.0 / np.sqrt(np.maximum(np.diag(gram)[1:], 1e-100)))


def _solved(gram: FloatArray, scale: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return values and covariance in units of the scale, and the gain, of a small Gram matrix."""
    A = gram[1:, 1:] * np.outer(scale, scale) + _RIDGE * np.eye(len(scale))
    b = gram[1:, 0] * scale
    factor = _cholesky_factor(A)
    values = _solve_with_factor(factor, b)
    return values, _solve_with_factor(factor, np.eye(len(b))), 0.5 * float(b @ values)


def _cholesky_factor(matrix: FloatArray) -> FloatArray:
    """Return the lower Cholesky factor of a positive definite matrix, as LAPACK leaves it; LinAlgError where
    it is none.

    SciPy's functions for it look at small arrays for longer than they compute.
    """
    factor, failed = dpotrf(matrix, lower=1, clean=0)
    if failed:
        raise np.linalg.LinAlgError("the Gram matrix is not positive definite")
    return np.asarray(factor)


def _solve_with_factor(factor: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solution for right-hand sides (k,) or (k, n) by a factor of `_cholesky_factor`."""
    return np.asarray(dpotrs(factor, right, lower=1)[0]) if len(factor) else np.zeros(right.shape)


def _common_total(parts: Sequence[DriveGrams], width: int) -> FloatArray:
    """Return the sum of the drives' Gram matrices in the common index, of a single drive that has all columns
    in order its own."""
    every = np.arange(width)
    if len(parts) == 1 and np.array_equal(parts[0].here, every) and np.array_equal(parts[0].local, every):
        return parts[0].total
    total = np.zeros((width, width))
    for one in parts:
        total[np.ix_(one.here, one.here)] += one.total[np.ix_(one.local, one.local)]
    return total


def _predicted_by_other_drives(small: list[FloatArray]) -> list[FloatArray]:
    """Return the cross-validated log-likelihood of each drive, predicted by the others, as equal shares of
    its blocks.

    Values that the drive shares with others come from the others, with their uncertainty (a drive that
    alone can tell an effect must not be judged by the noise of those that cannot; where nobody knows
    anything, a value is as uncertain as one window in the mean would leave it). Values that are the
    drive's own, such as its calibration, come from its other blocks.
    """
    total = np.sum([one.sum(axis=0) for one in small], axis=0)
    whole = np.concatenate([[1.0], _scale(total)])
    scaled = [one * np.outer(whole, whole) for one in small]
    total = total * np.outer(whole, whole)
    windows = 30.0 * sum(len(one) for one in small)
    out = []
    for one in scaled:
        mine = one.sum(axis=0)
        rest = total - mine
        acts = 1 + np.flatnonzero(np.diag(mine)[1:] > _RIDGE)
        known = np.diag(rest)[acts] > _RIDGE
        shared, own = acts[known], acts[~known]
        value, information = _shared_from_others(rest, shared, windows)
        constant, slope, curvature = _heldout_quadratic(one, mine, shared, own)
        score = constant
        if len(shared):
            pull = information @ value + slope
            joint = information + curvature
            score += 0.5 * float(pull @ np.linalg.solve(joint, pull) - value @ information @ value)
            score += 0.5 * float(np.linalg.slogdet(information)[1] - np.linalg.slogdet(joint)[1])
        out.append(np.full(len(one), score / len(one)))
    return out


def _shared_from_others(
    rest: FloatArray, shared: np.ndarray, windows: float
) -> tuple[FloatArray, FloatArray]:
    """Return mean and information of the shared values by the other drives, whose own values are integrated
    out."""
    if not len(shared):
        return np.zeros(0), np.zeros((0, 0))
    used = 1 + np.flatnonzero(np.diag(rest)[1:] > _RIDGE)
    at = np.searchsorted(used, shared)
    A = rest[np.ix_(used, used)] + _RIDGE * np.eye(len(used))
    A[at, at] += 1.0 / windows
    inverse = np.linalg.inv(A)
    values = inverse @ rest[used, 0]
    return values[at], np.linalg.inv(inverse[np.ix_(at, at)])


def _heldout_quadratic(
    by_block: FloatArray, mine: FloatArray, shared: np.ndarray, own: np.ndarray
) -> tuple[float, FloatArray, FloatArray]:
    """Return the drive's held-out log-likelihood as a quadratic function of the shared values: constant,
    slope and curvature. In each fold the drive's own values are fitted on its other blocks, given the shared
    ones."""
    s, o = len(shared), len(own)
    rows = np.concatenate([[0], shared, own]).astype(int)
    constant, slope, curvature = 0.0, np.zeros(s), np.zeros((s, s))
    numbers = np.arange(len(by_block)) % FOLDS
    for fold in range(min(FOLDS, len(by_block))):
        out = by_block[numbers == fold].sum(axis=0)
        trained = mine - out
        start, by_value = np.zeros(1 + s + o), np.zeros((1 + s + o, s))
        start[0] = 1.0
        by_value[1 : 1 + s] = -np.eye(s)
        if o:
            A = trained[np.ix_(own, own)] + _RIDGE * np.eye(o)
            both = np.linalg.solve(A, trained[np.ix_(own, rows[: 1 + s])])
            start[1 + s :] = -both[:, 0]
            by_value[1 + s :] = both[:, 1:]
        gram = out[np.ix_(rows, rows)]
        constant -= 0.5 * float(start @ gram @ start)
        slope -= by_value.T @ gram @ start
        curvature += by_value.T @ gram @ by_value
    return constant, slope, curvature
