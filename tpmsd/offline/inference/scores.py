"""The derivatives of a whitened likelihood by everything that a noise decides.

In: the matrices and gains of all windows, whitened columns. Out: `Derivatives` of -1/2 (log-determinant +
sum of squares) by the adjoint recursions of the filter (Koopman and Shephard, Biometrika 79, 1992).
`array_scores` is the reference by NumPy arrays; `compiled_scores` calls `_gains.c` and gives the same within
rounding (tests/offline/inference/test_scores.py).

With zeta the scores of a window's carried states and channels, Z what the data tell of these, and S =
zeta zeta' - Z, the derivatives are quadratic forms: by a variance that comes in through the column j of J,
1/2 j' S j; by the fading of a state, j' S (M P) j plus zeta' j times the state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.gains import Gains, chained, is_compiled, kernel

MAX_STATES = 64
"""States of a window up to which the compiled code has room."""


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of a log-likelihood by what a noise decides; shapes as in `Diagonals`."""

    variance: FloatArray
    decay: FloatArray
    fresh: FloatArray
    start: FloatArray


@dataclass(frozen=True)
class System:
    """A filter of w windows, c carried states of s, and 9 channels."""

    moved: FloatArray
    """(w, c + 9, c) M: carried states and channels as functions of the carried states before."""
    joint: FloatArray
    """(w, c + 9, s) J: the same as functions of all states, faded and with what is new."""
    carried: np.ndarray
    """(c,) numbers of the carried states."""
    by: Gains
    """With the covariances of all windows."""

    @property
    def seen(self) -> FloatArray:
        """Return (w, 9, c) G: innovations by the carried states before."""
        return np.asarray(self.by.inverse @ self.moved[:, len(self.carried) :])

    @property
    def phi(self) -> FloatArray:
        """Return (w, c, c): errors of the carried states by those before."""
        return np.asarray(self.moved[:, : len(self.carried)] - self.by.gain.transpose(0, 2, 1) @ self.seen)


def scores(system: System, white: FloatArray) -> Derivatives:
    """Return the derivatives of -1/2 (logdet + sum of squares of white (w, 9, k)); `variance` also of what
    was not measured.
    """
    room = system.joint.shape[2] <= MAX_STATES and is_compiled(len(system.carried), 0)
    return (compiled_scores if room else array_scores)(system, white)


def array_scores(system: System, white: FloatArray) -> Derivatives:
    """Return `scores` computed by NumPy, the reference."""
    carried, joint, (inverse, gain, MP) = system.carried, system.joint, system.by
    carry = len(carried)
    seen, phi = system.seen, system.phi
    states = chained(system.moved[:, :carry], gain.transpose(0, 2, 1) @ white)[0]
    adjoint, before = adjoints(phi, seen.transpose(0, 2, 1) @ white)
    error = inverse.transpose(0, 2, 1) @ (white - gain @ adjoint)
    zeta = np.concatenate([adjoint, error], axis=1)
    pull = joint.transpose(0, 2, 1) @ zeta
    information_after, N = information_of_later_windows(phi, seen)
    white_rows = inverse @ joint[:, carry:]
    into = joint[:, :carry] - gain.transpose(0, 2, 1) @ white_rows
    onward = information_after @ into
    of_fresh = 0.5 * (
        np.einsum("wsp,wsp->ws", pull, pull)
        - np.einsum("wcs,wcs->ws", into, onward)
        - np.einsum("wcs,wcs->ws", white_rows, white_rows)
    )
    K = gain.transpose(0, 2, 1) @ inverse
    information = (inverse**2).sum(axis=1) + (K * (information_after @ K)).sum(axis=1)
    of_variance = 0.5 * ((error**2).sum(2) - information)
    # By the fading of each carried state: pull x' + (zeta zeta' - N) M P, the state's own row and column.
    of_decay = np.zeros(pull.shape[:2])
    through = zeta.transpose(0, 2, 1) @ MP
    # T M P = (M_states - K M_channels) P
    carried_spread = MP[:, :carry] - K @ MP[:, carry:]
    expected = (
        onward.transpose(0, 2, 1) @ carried_spread + white_rows.transpose(0, 2, 1) @ inverse @ MP[:, carry:]
    )
    of_decay[:, carried] = (
        np.einsum("wcp,wcp->wc", pull[:, carried], states + through.transpose(0, 2, 1))
        - expected[:, carried, np.arange(carry)]
    )
    of_start = np.zeros(pull.shape[1])
    of_start[carried] = 0.5 * ((before**2).sum(1) - np.diag(N))
    return Derivatives(of_variance, of_decay, of_fresh, of_start)


def compiled_scores(system: System, white: FloatArray) -> Derivatives:
    """Return `scores` computed by compiled code, for `MAX_STATES` states at most."""
    (count, channels, width), (rows, every) = white.shape, system.joint.shape[1:]
    carry = len(system.carried)
    variance, start = np.empty((count, channels)), np.empty(carry)
    decay, fresh = np.empty((count, every)), np.empty((count, every))
    room = np.empty((count, carry, width)), np.empty((2 * rows, width))
    given = (system.moved, system.joint, *system.by, white, system.carried.astype(np.float64))
    kernel().scores(variance, decay, fresh, start, *room, *(np.ascontiguousarray(array) for array in given))
    of_start = np.zeros(every)
    of_start[system.carried] = start
    return Derivatives(variance, decay, fresh, of_start)


def information_of_later_windows(phi: FloatArray, seen: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the (w, c, c) information of all later windows on the carried states after each, and before the
    first."""
    out = np.empty(phi.shape)
    N = np.zeros(phi.shape[1:])
    information = seen.transpose(0, 2, 1) @ seen
    for k in range(len(out) - 1, -1, -1):
        out[k] = N
        N = phi[k].T @ (N @ phi[k])
        N += information[k]
    return out, N


def adjoints(phi: FloatArray, pushed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the likelihood's derivative by the carried states after each window (w, c, p), and before the
    first (c, p), from the derivatives `pushed` by those of single windows (w, c, p)."""
    out = np.empty_like(pushed)
    adjoint = np.zeros(pushed.shape[1:])
    for k in range(len(pushed) - 1, -1, -1):
        out[k] = adjoint
        adjoint = phi[k].T @ adjoint
        adjoint += pushed[k]
    return out, adjoint
