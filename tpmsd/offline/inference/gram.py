"""Gram matrices of one drive's whitened columns, each made when it is asked for.

In: whitened columns and the block of each window. Out: `Grams`: of all windows together, by block for the few
columns that a model holds, and by fold. All columns by block would take tens of times the memory of the
columns themselves, and nobody asks for more than some dozens of them.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise

import numpy as np

from tpmsd.foundation.wheels import FloatArray


class Grams:
    """Gram matrices of columns: immutable, with what was computed kept."""

    def __init__(self, white: FloatArray, blocks: np.ndarray) -> None:
        """`white` (w, 9, n); `blocks` (w,) numbers each window's block from 0, never falling."""
        self.white = white
        self._of_window = blocks
        rows = white.shape[1]
        ends = np.flatnonzero(np.diff(blocks)) + 1
        bounds = [0, *ends.tolist(), len(blocks)] if len(blocks) else [0]
        self._spans = [(rows * first, rows * last) for first, last in pairwise(bounds)]
        self._index: dict[int, int] = {}
        """Indices of the columns that are known by block, in `_compact` and `_by_block`."""
        self._compact: FloatArray = np.empty((white.shape[0] * rows, 0))
        self._by_block: FloatArray = np.empty((self.blocks, 0, 0))

    @property
    def width(self) -> int:
        """Return the number of columns, n."""
        return int(self.white.shape[2])

    @property
    def blocks(self) -> int:
        """Return the number of blocks."""
        return len(self._spans)

    @cached_property
    def total(self) -> FloatArray:
        """Return the (n, n) Gram matrix of all windows."""
        flat = self.white.reshape(-1, self.width)
        return np.asarray(flat.T @ flat)

    def by_block(self, columns: np.ndarray) -> FloatArray:
        """Return the (blocks, k, k) Gram matrices of some columns (k,)."""
        missing = [int(k) for k in dict.fromkeys(columns.tolist()) if k not in self._index]
        if missing:
            self._add_by_block(missing)
        at = np.array([self._index[int(k)] for k in columns], dtype=np.intp)
        return np.asarray(self._by_block[:, at[:, None], at[None, :]])

    def by_fold(self, folds: int) -> FloatArray:
        """Return the (folds, n, n) Gram matrices of the folds: fold f has the blocks f, f + folds, ..."""
        flat = self.white.reshape(-1, self.width)
        out = np.zeros((folds, self.width, self.width))
        for fold in range(min(folds, self.blocks)):
            rows = np.concatenate([flat[first:last] for first, last in self._spans[fold::folds]])
            np.matmul(rows.T, rows, out=out[fold])
        return out

    def extended(self, columns: FloatArray) -> Grams:
        """Return the Gram matrices with further whitened columns (w, 9, k) at the end."""
        out = Grams(np.concatenate([self.white, columns], axis=2), self._of_window)
        flat, more = out.white.reshape(-1, out.width), columns.reshape(-1, columns.shape[2])
        total = np.empty((out.width, out.width))
        total[: self.width, : self.width] = self.total
        total[:, self.width :] = flat.T @ more
        total[self.width :] = total[:, self.width :].T
        out.__dict__["total"] = total
        out._index, out._compact, out._by_block = dict(self._index), self._compact, self._by_block
        return out

    def _add_by_block(self, columns: list[int]) -> None:
        """Compute the Gram matrices by block of some more columns, and keep them."""
        known = len(self._index)
        more = self.white[:, :, columns].reshape(-1, len(columns))
        both = np.concatenate([self._compact, more], axis=1)
        by_block = np.empty((self.blocks, both.shape[1], both.shape[1]))
        by_block[:, :known, :known] = self._by_block
        for block, (first, last) in enumerate(self._spans):
            cross = both[first:last].T @ more[first:last]
            by_block[block, :, known:] = cross
            by_block[block, known:] = cross.T
        self._index |= {column: known + k for k, column in enumerate(columns)}
        self._compact, self._by_block = both, by_block
