"""The gains of the whitening filter, by NumPy arrays or, where it was built, by compiled code.

In: the matrices of all windows. Out: `Gains`. `array_gains` is the reference; `compiled_gains` calls
`_gains.c`. Both give the same within rounding (tests/inference/test_gains.py), so nothing but time depends on
which runs.
"""

from __future__ import annotations

from types import ModuleType
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtri

from tpmsd.wheels import FloatArray

try:
    from tpmsd.inference import _gains as compiled
except ImportError:  # not built: there was no compiler, or it was left out
    compiled: ModuleType | None = None  # type: ignore[no-redef]

MOST_COMPILED = 48
"""Carried states up to which the compiled code has room."""


class Gains(NamedTuple):
    """Of w windows with c carried states and 9 channels."""

    inverse: FloatArray
    """(w, 9, 9) inverse of the lower Cholesky factor of the innovations' covariance."""
    gain: FloatArray
    """(w, 9, c) B = Linv C', so that the Kalman gain is B' Linv."""
    spread: FloatArray
    """(w, c + 9, c) M P of each window, if they are kept; else (1, c + 9, c)."""


def gains(moved: FloatArray, fresh: FloatArray, start: FloatArray, keep: bool) -> Gains:
    """Run the covariances through a drive.

    `moved` (w, c + 9, c): M; `fresh` (w, c + 9, c + 9): what a window adds to the covariance of states and
    channels; `start` (c,): variances before the first; `keep`: keep M P of every window. ValueError if a
    covariance is not positive definite.
    """
    fits = compiled is not None and len(start) <= MOST_COMPILED
    return (compiled_gains if fits else array_gains)(moved, fresh, start, keep)


def array_gains(moved: FloatArray, fresh: FloatArray, start: FloatArray, keep: bool) -> Gains:
    """By NumPy."""
    out = _empty(moved, keep)
    count, rows, carry = moved.shape
    joint = np.empty((rows, rows))
    P = np.diag(start)
    for k in range(count):
        MP = out.spread[k if keep else 0]
        np.matmul(moved[k], P, out=MP)
        np.matmul(MP, moved[k].T, out=joint)
        np.add(joint, fresh[k], out=joint)
        factor, failed = dpotrf(joint[carry:, carry:], lower=1)
        if failed:
            raise ValueError("the noise model is not positive definite")
        inverse, _ = dtrtri(factor, lower=1, overwrite_c=1)
        out.inverse[k] = inverse
        B = np.matmul(inverse, joint[carry:, :carry], out=out.gain[k])
        P = joint[:carry, :carry] - np.matmul(B.T, B)
    return out


def compiled_gains(moved: FloatArray, fresh: FloatArray, start: FloatArray, keep: bool) -> Gains:
    """By compiled code, for `MOST_COMPILED` states at most."""
    assert compiled is not None
    out = _empty(moved, keep)
    contiguous = (np.ascontiguousarray(array) for array in (moved, fresh, start))
    if not compiled.recursion(*out, *contiguous):
        raise ValueError("the noise model is not positive definite")
    return out


def _empty(moved: FloatArray, keep: bool) -> Gains:
    count, rows, carry = moved.shape
    channels = rows - carry
    return Gains(
        np.empty((count, channels, channels)),
        np.empty((count, channels, carry)),
        np.empty((count if keep else 1, rows, carry)),
    )
