"""What the data say for and against sets of hypotheses, all from sums over blocks of time.

In: whitened innovations (column 0 the data, the others responses) and the blocks they fall into. Out:
`Evidence`, which fits any linear combinations of columns, holds blocks out, and tells how far a block-
wise variance exceeds the assumed one. After whitening, all questions are about small Gram matrices, so
thousands of hypotheses cost milliseconds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from tpmsd.wheels import FloatArray

FOLDS = 5


@dataclass(frozen=True)
class Fit:
    """A least-squares fit of k combinations of columns."""

    design: FloatArray
    """(1 + p, k) the combinations."""
    values: FloatArray
    """(k,)"""
    covariance: FloatArray
    """(k, k), for unit noise."""
    gain: float
    """Log-likelihood over that of no columns at all."""


class Evidence:
    """Gram matrices of whitened columns by block."""

    def __init__(self, white: FloatArray, blocks: np.ndarray) -> None:
        """`white` is (w, 9, 1 + p); `blocks` (w,) numbers each window's block from 0."""
        count = int(blocks.max()) + 1 if len(blocks) else 0
        width = white.shape[2]
        self.by_block = np.zeros((count, width, width))
        for block in range(count):
            part = white[blocks == block].reshape(-1, width)
            self.by_block[block] = part.T @ part
        self.total = self.by_block.sum(axis=0)
        self.blocks = count
        self.folds = [np.flatnonzero(np.arange(count) % FOLDS == fold) for fold in range(min(FOLDS, count))]

    @property
    def width(self) -> int:
        """1 + p, the data included."""
        return int(self.total.shape[0])

    def unit(self, *columns: int) -> FloatArray:
        """(1 + p, k) design of single columns."""
        out = np.zeros((self.width, len(columns)))
        out[list(columns), np.arange(len(columns))] = 1.0
        return out

    def fit(self, design: FloatArray, left_out: np.ndarray | None = None) -> Fit:
        """Least squares of column 0 on the combinations `design`, without the blocks `left_out`."""
        rows, part = _support(design)
        gram = self.total[np.ix_(rows, rows)]
        scale = 1.0 / np.sqrt(np.maximum((part * (gram @ part)).sum(axis=0), 1e-300))
        if left_out is not None and len(left_out):
            gram = gram - self.by_block[np.ix_(left_out, rows, rows)].sum(axis=0)
        scaled = part * scale
        A = scaled.T @ gram @ scaled + 1e-9 * np.eye(part.shape[1])
        b = scaled.T @ gram[:, 0]
        factor = scipy.linalg.cho_factor(A, lower=True)
        values = scipy.linalg.cho_solve(factor, b)
        covariance = scipy.linalg.cho_solve(factor, np.eye(len(b)))
        return Fit(design, values * scale, covariance * np.outer(scale, scale), 0.5 * float(b @ values))

    def score(self, fitted: Fit, blocks: np.ndarray) -> FloatArray:
        """(len(blocks),) log-likelihood of each of these blocks under given values, up to a constant."""
        rows, vector = self._residual(fitted)
        parts = self.by_block[np.ix_(blocks, rows, rows)]
        return -0.5 * np.asarray((parts @ vector) @ vector)

    def heldout(self, design: FloatArray) -> FloatArray:
        """(blocks,) log-likelihood of each block with values fitted on the other folds' blocks."""
        out = np.zeros(self.blocks)
        for fold in self.folds:
            out[fold] = self.score(self.fit(design, fold), fold)
        return out

    def sandwich(self, fitted: Fit) -> FloatArray:
        """(k,) ratio of the block-wise variance of each value to the one assumed.

        Blocks whose scores scatter more than white noise would (slow errors that no state holds) make
        values less certain than the Gram matrix says (White, Econometrica 48, 1980; clustered by block).
        """
        rows, vector = self._residual(fitted)
        parts = self.by_block[:, rows[:, None], rows[None, :]]
        scores = (parts @ vector) @ fitted.design[rows]
        spread = fitted.covariance @ (scores.T @ scores) @ fitted.covariance
        spread = spread * self.blocks / max(self.blocks - fitted.design.shape[1], 1)
        return np.asarray(np.diag(spread) / np.maximum(np.diag(fitted.covariance), 1e-300))

    @staticmethod
    def _residual(fitted: Fit) -> tuple[np.ndarray, FloatArray]:
        """The columns that make up the residual, and their weights."""
        rows, part = _support(fitted.design)
        vector = -part @ fitted.values
        vector[0] += 1.0
        return rows, vector

    def projected(self, design: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gram matrix (p, p) and correlation with the data (p,) of all columns, `design` projected out."""
        gram = self.total
        if design.shape[1]:
            norm = np.sqrt(np.maximum((design * (gram @ design)).sum(axis=0), 1e-300))
            part = (design / norm).T @ gram
            A = part @ (design / norm) + 1e-9 * np.eye(design.shape[1])
            gram = gram - part.T @ scipy.linalg.cho_solve(scipy.linalg.cho_factor(A), part)
        return gram[1:, 1:], gram[1:, 0]


def _support(design: FloatArray) -> tuple[np.ndarray, FloatArray]:
    """Column 0 and the columns a design uses, and the design's rows for them."""
    used = np.any(design != 0.0, axis=1)
    used[0] = True
    rows = np.flatnonzero(used)
    return rows, design[rows]
