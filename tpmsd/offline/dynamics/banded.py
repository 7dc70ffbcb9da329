"""Block tridiagonal least squares over time by a banded Cholesky factor.

In: diagonal blocks (n, s, s), blocks below the diagonal (n - 1, s, s), right-hand sides. Out: solutions.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import as_strided
from scipy.linalg import lapack

from tpmsd.foundation.wheels import FloatArray


class BandedFactor:
    """The Cholesky factor of a symmetric positive definite block tridiagonal matrix."""

    def __init__(self, diagonal: FloatArray, below: FloatArray) -> None:
        n, s, _ = diagonal.shape
        # Rows of a column lie side by side: the columns of a block are (s, 2 s) numbers, each column of which
        # begins one number later than the one before.
        memory = np.zeros(n * s * 2 * s)
        band = memory.reshape(n * s, 2 * s).T
        size = memory.itemsize
        strides = (2 * s * s * size, (2 * s - 1) * size, size)
        blocks = as_strided(memory, (n, s, s), strides)
        for j in range(s):
            blocks[:, j, j:] = diagonal[:, j:, j]
        as_strided(memory[s:], (n - 1, s, s), strides)[:] = np.swapaxes(below, 1, 2)
        factor, info = lapack.dpbtrf(band, lower=1, overwrite_ab=1)
        if info != 0:
            raise np.linalg.LinAlgError(f"the path's information matrix is not positive definite ({info})")
        self._factor = factor
        self._shape = (n, s)

    def half_log_determinant(self) -> float:
        """Return half the logarithm of the matrix's determinant."""
        return float(np.sum(np.log(self._factor[0])))

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the solution for right-hand sides (n, s) or (n, s, p)."""
        n, s = self._shape
        columns = np.asfortranarray(right.reshape(n * s, -1))
        out, _ = lapack.dpbtrs(self._factor, columns, lower=1)
        return np.ascontiguousarray(out).reshape(right.shape)

    def half_solve_rows(self, right: FloatArray, first: int = 0) -> FloatArray:
        """Return x of L x = right for right-hand sides (p, n, s), with the matrix L L' of the n rows from
        `first` on, which are not linked with those before."""
        columns = np.ascontiguousarray(right).reshape(len(right), -1).T
        begin = first * self._shape[1]
        factor = self._factor[:, begin : begin + len(columns)]
        out, _ = lapack.dtbtrs(factor, columns, uplo="L", overwrite_b=1)
        return np.asarray(out.T.reshape(right.shape))
