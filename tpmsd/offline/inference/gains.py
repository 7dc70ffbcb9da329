"""The recursions of the whitening filter, by NumPy arrays or, where it was built, by compiled code.

In: the matrices of all windows. Out: `Gains`, columns whitened by them, states of a linear recursion. The
functions that begin with `array_` are the reference; those that begin with `compiled_` call `_gains.c`.
Both give the same within rounding (tests/offline/inference/test_gains.py), so nothing but time depends on
which runs.
"""

from __future__ import annotations

from collections.abc import Iterable
from types import ModuleType
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtri

from tpmsd.foundation.kernels import loaded
from tpmsd.foundation.wheels import FloatArray

compiled = loaded("gains")

MAX_COMPILED = 48
"""Carried states up to which the compiled code has room."""


NARROW = 32
"""Columns up to which it is faster than BLAS."""


class Gains(NamedTuple):
    """Gains of w windows with c carried states and 9 channels."""

    inverse: FloatArray
    """(w, 9, 9) inverse of the lower Cholesky factor of the innovations' covariance."""
    gain: FloatArray
    """(w, 9, c) B = Linv C', so that the Kalman gain is B' Linv."""
    spread: FloatArray
    """(w, c + 9, c) M P of each window, if they are kept; else (1, c + 9, c)."""


def gains(moved: FloatArray, fresh: FloatArray, start: FloatArray, keep: bool) -> Gains:
    """Return the Kalman gains of every window: the covariance recursion (Riccati) over one drive.

    `moved` (w, c + 9, c): M; `fresh` (w, c + 9, c + 9): what a window adds to the covariance of states and
    channels; `start` (c,): variances before the first; `keep`: keep M P of every window. ValueError if a
    covariance is not positive definite.
    """
    return (compiled_gains if is_compiled(len(start), 0) else array_gains)(moved, fresh, start, keep)


def array_gains(moved: FloatArray, fresh: FloatArray, start: FloatArray, keep: bool) -> Gains:
    """Return `gains` computed by NumPy, the reference."""
    out = _empty_gains(moved, keep)
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
    """Return `gains` computed by compiled code, for `MAX_COMPILED` states at most."""
    assert compiled is not None
    out = _empty_gains(moved, keep)
    contiguous = (np.ascontiguousarray(array) for array in (moved, fresh, start))
    if not compiled.recursion(*out, *contiguous):
        raise ValueError("the noise model is not positive definite")
    return out


def steps(moved: FloatArray, by: Gains) -> FloatArray:
    """Return the (w, c + 9, c + 9) matrices from carried states before and data to carried states after and
    innovations."""
    carry, back = moved.shape[2], by.gain.transpose(0, 2, 1)
    seen = by.inverse @ moved[:, carry:]
    states = np.concatenate([moved[:, :carry] - back @ seen, back @ by.inverse], axis=2)
    return np.concatenate([states, np.concatenate([-seen, by.inverse], axis=2)], axis=1)


def array_whitened(columns: FloatArray, here: np.ndarray, step: FloatArray) -> FloatArray:
    """Return the columns (w, 9, p) whitened by `steps`, one product per window; where `here` (w, 9) is False
    they count as zero."""
    return whitened_parts([columns], columns.shape, here, step)


def whitened_parts(
    parts: Iterable[FloatArray], shape: tuple[int, ...], here: np.ndarray, step: FloatArray
) -> FloatArray:
    """Return `array_whitened` of columns that come in parts, each (some windows, 9, p), together of
    `shape`."""
    width, carry = shape[2], step.shape[1] - shape[1]
    out = np.empty(shape)
    both, after = np.zeros((step.shape[1], width)), np.empty((step.shape[1], width))
    whole = np.asarray(here.all(axis=1))
    for k, columns in enumerate(window for part in parts for window in part):
        both[carry:] = columns
        if not whole[k]:
            both[carry:][~here[k]] = 0.0
        np.matmul(step[k], both, out=after)
        out[k] = after[carry:]
        both[:carry] = after[:carry]
    return out


def kernel() -> ModuleType:
    """Return the compiled module; AssertionError where it was not built."""
    assert compiled is not None
    return compiled


def is_compiled(states: int, columns: int) -> bool:
    """Return whether compiled code is available, has room for these states and columns, and is faster than
    NumPy."""
    return compiled is not None and states <= MAX_COMPILED and columns <= NARROW


def compiled_whitened(columns: FloatArray, here: np.ndarray, moved: FloatArray, by: Gains) -> FloatArray:
    """Return `array_whitened` computed by compiled code, without `steps`, for `MAX_COMPILED` states at
    most."""
    assert compiled is not None
    out = np.empty(columns.shape)
    compiled.apply(
        out, np.ascontiguousarray(columns), np.ascontiguousarray(moved), by.inverse, by.gain, 1.0 * here
    )
    return out


def chained(step: FloatArray, added: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (w, c, p) states x of x_(k + 1) = step_k x_k + added_k, starting at zero, and the last one (c,
    p).

    `step` (w, c, c), mostly zeros, and `added` (w, c, p).
    """
    return (array_chained if compiled is None else compiled_chained)(step, added)


def array_chained(step: FloatArray, added: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return `chained` computed by NumPy, the reference."""
    out, state = np.empty_like(added), np.zeros(added.shape[1:])
    for k in range(len(added)):
        out[k] = state
        state = step[k] @ state
        state += added[k]
    return out, state


def compiled_chained(step: FloatArray, added: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return `chained` computed by compiled code."""
    assert compiled is not None
    out, last = np.empty(added.shape), np.empty(added.shape[1:])
    compiled.chain(out, last, np.ascontiguousarray(step), np.ascontiguousarray(added))
    return out, last


def _empty_gains(moved: FloatArray, keep: bool) -> Gains:
    count, rows, carry = moved.shape
    channels = rows - carry
    return Gains(
        np.empty((count, channels, channels)),
        np.empty((count, channels, carry)),
        np.empty((count if keep else 1, rows, carry)),
    )
