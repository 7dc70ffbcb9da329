"""The reference motion's own errors, as a model and all channels together tell them.

In: `Windows`, a `Noise`, and what a fitted model leaves of the channels. Out: the errors of speed, yaw rate
and heading in every window, given the whole drive. The reference motion is made of noisy readings, without a
gyro of the very wheels that a load transfer changes; what multiplies it (every response of an effect) is
only as right as it is. Moved by these errors it is the motion that all channels agree on.

The filter is that of `whitening`, followed by the fixed-interval smoother of Bryson and Frazier in its
modified form (Bierman, Automatica 9, 1973), which needs no inverse of a covariance.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from tpmsd.inference.whitening import PSI, STATES, Noise, V, W, system
from tpmsd.inference.windows import Windows
from tpmsd.wheels import FloatArray


def motion_errors(
    windows: Windows, noise: Noise, residual: FloatArray, inflate: FloatArray | None = None
) -> FloatArray:
    """(w, 3) what is to be added to the reference's speed (m/s), yaw rate (rad/s) and heading (rad), the last
    at the end of each window; `residual` (w, 9) is NaN where nothing was measured.
    """
    count = len(residual)
    made = system(windows, noise, np.isfinite(residual), inflate)
    predicted = np.zeros((count, STATES))
    spread = np.zeros((count, STATES, STATES))
    told = np.zeros((count, STATES))
    forgets = np.zeros((count, STATES, STATES))
    x, P = np.zeros(STATES), np.diag(made.start)
    for k in range(count):
        x = made.transition[k] @ x
        P = made.transition[k] @ P @ made.transition[k].T + made.fresh[k]
        predicted[k], spread[k] = x, P
        use = made.here[k]
        if not use.any():
            forgets[k] = np.eye(STATES)
            continue
        H = made.rows[k][use]
        HP = H @ P
        S = HP @ H.T
        S.flat[:: len(S) + 1] += made.variance[k][use]
        factor = scipy.linalg.cho_factor(S, lower=True)
        innovation = scipy.linalg.cho_solve(factor, residual[k][use] - H @ x)
        gain = scipy.linalg.cho_solve(factor, HP).T
        told[k] = H.T @ innovation
        forgets[k] = np.eye(STATES) - gain @ H
        x = x + HP.T @ innovation
        P = P - HP.T @ gain.T
        P = 0.5 * (P + P.T)
    out = np.zeros((count, 3))
    later = np.zeros(STATES)
    for k in range(count - 1, -1, -1):
        adjoint = told[k] + forgets[k].T @ later
        out[k] = (predicted[k] + spread[k] @ adjoint)[[V, W, PSI]]
        later = made.transition[k].T @ adjoint
    return out
