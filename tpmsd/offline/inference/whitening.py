"""Takes the unknown motion and the correlated noise out of residuals, by a Kalman filter.

In: `Linearised`, a `Noise`. Out: a `Whitener`, which turns residual columns (recording minus prediction,
responses of effects) into whitened innovations: independent, of unit variance where the noise is as said.
Least squares on them is generalised least squares with the car's true speed, yaw rate, heading and position
eliminated, which is what lets one channel be judged by all others with none trusted alone (de Jong, Annals of
Statistics 19, 1991, "The diffuse Kalman filter": regressors are filtered alongside the data).

The gains depend on noise, mask and motion alone. They are computed once; a column then costs one small
product per window. With x the carried states (c of them) after a window, d the window's data, and a window's
states and channels predicted jointly as M x, the innovations are

    white_k = Linv_k d_k - G_k x_(k-1),     x_k = Phi_k x_(k-1) + U_k d_k,

where L L' is the innovations' covariance, K the gain, G = Linv M_channels, U = K and Phi = M_states - K
M_channels. The adjoint recursion of the same matrices gives smoothed states (Bierman, Automatica 9, 1973) and
the derivatives of the likelihood by every entry of the system (Koopman and Shephard, Biometrika 79, 1992).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.blocks import PN, PSI, QOLD, Layout, Q, V, W
from tpmsd.offline.inference.gains import (
    array_whitened,
    compiled_whitened,
    gains,
    is_compiled,
    steps,
    whitened_parts,
)
from tpmsd.offline.inference.layouts import DRIFTING_RADII
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.scores import Derivatives, System, adjoints, information_of_later_windows, scores
from tpmsd.offline.inference.stack import ColumnStack
from tpmsd.offline.inference.state_space import Diagonals, Geometry, diagonals, geometry
from tpmsd.offline.inference.windows import CHANNELS, Linearised


class Whitener:
    """The gains of a drive under one noise; nothing changes after it was made."""

    def __init__(self, space: Geometry, diagonal: Diagonals, for_derivatives: bool = False) -> None:
        """With `for_derivatives` covariances are kept. ValueError if the noise is not positive definite."""
        self._space, self._diagonal = space, diagonal
        self._carried = space.layout.carried
        self._carry = len(self._carried)
        self._joint = space.joint
        moved = _carried_response(space, diagonal)
        fresh = _window_covariance(space, diagonal)
        found = gains(moved, fresh, diagonal.start[self._carried], for_derivatives)
        self._inverse, self._gain = found.inverse, found.gain
        self._carried_response, self._found = moved, found
        self.logdet = -2.0 * float(np.log(self._inverse[:, range(CHANNELS), range(CHANNELS)]).sum())
        for array in (self._carried_response, *found):
            array.flags.writeable = False

    @cached_property
    def _seen(self) -> FloatArray:
        """Return (w, 9, c) G: innovations by the carried states before."""
        return self._system.seen

    @cached_property
    def _phi(self) -> FloatArray:
        """Return (w, c, c): errors of the carried states by those before."""
        return self._system.phi

    @cached_property
    def _step(self) -> FloatArray:
        """Return the (w, c + 9, c + 9) matrices of `gains.steps`."""
        return steps(self._carried_response, self._found)

    @classmethod
    def of(
        cls,
        windows: Linearised,
        noise: Noise,
        here: np.ndarray,
        inflate: FloatArray | None = None,
        layout: Layout = DRIFTING_RADII,
    ) -> Whitener:
        """Return the whitener of a drive; `here` (w, 9) says what was measured, `inflate` (w, 9) multiplies
        the variances of single readings that were found to be outliers."""
        space = geometry(windows, here, layout)
        return cls(space, diagonals(space, noise, inflate))

    def apply(self, columns: FloatArray) -> FloatArray:
        """Return the columns (w, 9, p) whitened; zero where nothing was measured."""
        if is_compiled(self._carry, columns.shape[2]):
            return compiled_whitened(columns, self._space.here, self._carried_response, self._found)
        return array_whitened(columns, self._space.here, self._step)

    def apply_all(self, columns: ColumnStack, first: int = 0) -> FloatArray:
        """Return the whitened columns of a stack from the first on, (w, 9, p - first)."""
        windows, channels, every = columns.shape
        width = every - first
        if is_compiled(self._carry, width):
            return self.apply(np.concatenate(list(columns.parts(first))))
        return whitened_parts(columns.parts(first), (windows, channels, width), self._space.here, self._step)

    def smooth(self, white: FloatArray) -> FloatArray:
        """Return (w, 3) corrections of the reference's speed (m/s), yaw rate (rad/s) and heading (rad, at the
        end of each window), given whitened residuals (w, 9) of the whole drive."""
        adjoint, before = self._adjoint(white[:, :, None])
        pull = self._score_of_states(white[:, :, None], adjoint)
        fresh = self._diagonal.fresh[:, :, None] * pull
        fresh[:, V : PN + 1] += self._space.motion @ pull[:, V : PN + 1]
        start = self._diagonal.start[PSI] * before[self._carried == PSI, 0]
        heading = start + np.cumsum(fresh[:, PSI, 0])
        return np.asarray(np.stack([fresh[:, V, 0], fresh[:, W, 0], heading], axis=1))

    def motion_stds(self) -> FloatArray:
        """Return (w, 2) standard deviations of the smoothed errors of speed (m/s) and yaw rate (rad/s)."""
        information, _ = information_of_later_windows(self._phi, self._seen)
        into = self._space.motion[:, :, : W - V + 1]
        joint = self._space.joint[:, :, V : PN + 1] @ into
        white = self._inverse @ joint[:, self._carry :]
        carried = joint[:, : self._carry] - self._gain.transpose(0, 2, 1) @ white
        explained = (carried * (information @ carried)).sum(axis=1) + (white**2).sum(axis=1)
        before = into[:, [V - V, W - V], [V - V, W - V]]
        return np.asarray(np.sqrt(np.maximum(before - explained, 0.0)))

    def simulate(self, rng: np.random.Generator, replicates: int) -> FloatArray:
        """Return (w, 9, replicates) residuals drawn from the noise; zero where nothing was measured."""
        count = len(self._phi)
        white = rng.standard_normal((count, CHANNELS, replicates)) * self._space.here[:, :, None]
        state = np.zeros((self._carry, replicates))  # the filter's mean, not the truth
        out = np.empty(white.shape)
        for k in range(count):
            seen = white[k] + self._seen[k] @ state
            out[k] = np.linalg.solve(self._inverse[k], seen)
            state = self._phi[k] @ state + self._gain[k].T @ seen
        return out

    def derivatives(self, white: FloatArray) -> Derivatives:
        """Return the derivatives of -1/2 (logdet + sum of squares of white (w, 9, k)): of the restricted
        likelihood, if white are the residual and columns that are orthonormal. Only of a whitener made for
        derivatives.
        """
        found = scores(self._system, white)
        return replace(found, variance=found.variance * self._space.here)

    @property
    def _system(self) -> System:
        return System(self._carried_response, self._joint, self._carried, self._found)

    def _adjoint(self, white: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the likelihood's derivative by the carried states after each window (w, c, p), and before
        the first (c, p)."""
        return adjoints(self._phi, self._seen.transpose(0, 2, 1) @ white)

    def _score_of_states(self, white: FloatArray, adjoint: FloatArray) -> FloatArray:
        """Return the (w, s, p) derivative of the likelihood by what is added to each state in each window."""
        error = self._inverse.transpose(0, 2, 1) @ (white - self._gain @ adjoint)
        return np.asarray(self._joint.transpose(0, 2, 1) @ np.concatenate([adjoint, error], axis=1))


def whiten(
    windows: Linearised, noise: Noise, columns: FloatArray, inflate: FloatArray | None = None
) -> tuple[FloatArray, float]:
    """Return `columns` (w, 9, p) whitened, zero where not measured, and the sum of log variances.

    A channel is missing where column 0 is NaN.
    """
    made = Whitener.of(windows, noise, np.isfinite(columns[:, :, 0]), inflate)
    return made.apply(columns), made.logdet


def _carried_response(space: Geometry, diagonal: Diagonals) -> FloatArray:
    """Return (w, c + 9, c) M: a window's carried states and channels by the carried states before."""
    decay = diagonal.decay[:, space.layout.carried]
    decay[:, Q : Q + 4] = diagonal.decay[:, QOLD : QOLD + 4]
    return np.asarray(space.joint_of_carried * decay[:, None])


def _window_covariance(space: Geometry, diagonal: Diagonals) -> FloatArray:
    """Return the (w, c + 9, c + 9) covariance of process and measurement noise that a window adds."""
    joint, carry = space.joint, len(space.layout.carried)
    out = (joint * diagonal.fresh[:, None]) @ joint.transpose(0, 2, 1)
    out += space.motion_covariance
    at = np.arange(carry, carry + CHANNELS)
    out[:, at, at] += np.where(space.here, diagonal.variance, 1.0)
    return np.asarray(out)
