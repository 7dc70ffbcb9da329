"""Block tridiagonal least squares over time by a banded Cholesky factor.

In: diagonal blocks (n, s, s), blocks below the diagonal (n - 1, s, s), right-hand sides. Out: solutions.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from tpmsd.foundation.wheels import FloatArray


class BandedFactor:
    """The Cholesky factor of a symmetric positive definite block tridiagonal matrix."""

    def __init__(self, diagonal: FloatArray, below: FloatArray) -> None:
        n, s, _ = diagonal.shape
        band = np.zeros((2 * s, n * s), order="F")
        for j in range(s):
            for i in range(j, s):
                band[i - j, j::s] = diagonal[:, i, j]
            for i in range(s):
                band[s + i - j, j : (n - 1) * s : s] = below[:, i, j]
        factor, info = lapack.dpbtrf(band, lower=1, overwrite_ab=1)
        if info != 0:
            raise np.linalg.LinAlgError(f"the path's information matrix is not positive definite ({info})")
        self._factor = factor
        self._shape = (n, s)

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the solution for right-hand sides (n, s) or (n, s, p)."""
        n, s = self._shape
        columns = np.asfortranarray(right.reshape(n * s, -1))
        out, _ = lapack.dpbtrs(self._factor, columns, lower=1)
        return np.ascontiguousarray(out).reshape(right.shape)

    def half_solve_rows(self, right: FloatArray) -> FloatArray:
        """Return x of L x = right for right-hand sides (p, n, s), with the matrix L L'."""
        columns = np.ascontiguousarray(right).reshape(len(right), -1).T
        out, _ = lapack.dtbtrs(self._factor, columns, uplo="L", overwrite_b=1)
        return np.asarray(out.T.reshape(right.shape))
