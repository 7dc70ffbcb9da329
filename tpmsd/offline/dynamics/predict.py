"""Prediction by the inputs alone: states and outputs of a baseline with effects, no reading used.

In: a setup, effects, states at the first row of each block. Out: outputs over time. All steps of all blocks
are solved at once by Newton's method: the linearised steps are a lower triangular banded system. Blocks leave
it as they converge: in a bend at the limit the rows do one after the other. In those that do not, the steps
are taken one by one, all these blocks abreast.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import lapack

from tpmsd.car.physics.baselines.base import Theta
from tpmsd.car.physics.baselines.inputs import Inputs, Span
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.path import Setup, drive_of_blocks, linear

ROUNDS = 40
"""A round of a few blocks costs a hundredth of their steps one by one."""
TOLERANCE = 1e-6
LARGEST = 1e3
"""Step of Newton's method, in m/s or rad/s, beyond which it has run away."""


def free_run(
    setup: Setup,
    theta: Theta,
    path: FloatArray,
    disturbances: FloatArray | None = None,
    kicks: FloatArray | None = None,
) -> FloatArray:
    """Return simulated states (n, s); each block starts in the states of `path`.

    `disturbances` (n, d) act on them, and `kicks` (n - 1, s) are added at the end of each step; none unless
    given. Kicks and disturbances are left out where the steps have to be taken one after the other.
    """
    count = len(setup.states(theta))
    free = np.zeros((len(path), len(setup.disturbances))) if disturbances is None else disturbances
    pushed = np.zeros((len(path) - 1, count)) if kicks is None else kicks
    extended = np.concatenate([path[:, :count], free], axis=1)
    inputs = setup.inputs(theta)
    left = np.ones(len(setup.drive.starts), dtype=bool)
    away = ~left
    for _ in range(ROUNDS):
        drive, rows = drive_of_blocks(setup.drive, left)
        steps, acting = Setup(setup.baseline, drive, ()), inputs.take(rows)
        at = linear(steps, theta, extended[rows], driven=False, inputs=acting)
        wanted = pushed[rows[:-1]] - at.step_residual[:, :count]
        move = _solve_recursion(steps, at.by_state[:, :count, :count], wanted)
        size = np.maximum.reduceat(np.abs(move).max(axis=1), drive.starts)
        runs = size <= LARGEST
        kept = np.repeat(runs, drive.ends - drive.starts)
        extended[rows[kept], :count] += move[kept]
        away[left] = ~runs
        left[left] = runs & (size >= TOLERANCE)
        if not left.any():
            break
    away |= left
    if away.any():
        drive, rows = drive_of_blocks(setup.drive, away)
        steps = Setup(setup.baseline, drive, ())
        extended[rows, :count] = _step_all_blocks(steps, theta, path[rows, :count], inputs.take(rows))
    return extended[:, :count]


def _solve_recursion(setup: Setup, by_state: FloatArray, right: FloatArray) -> FloatArray:
    """Return x with x[k + 1] - A[k] x[k] = right[k] within blocks and x = 0 at their first rows."""
    n, s = len(setup.drive.time_s), right.shape[1]
    by_state = np.where(setup.drive.linked[:, None, None], by_state, 0.0)
    band = np.zeros((2 * s, n * s), order="F")
    band[0] = 1.0
    for j in range(s):
        for i in range(s):
            band[s + i - j, j : (n - 1) * s : s] = -by_state[:, i, j]
    values = np.zeros((n, s))
    values[1:] = np.where(setup.drive.linked[:, None], right, 0.0)
    out, _ = lapack.dtbtrs(band, np.asfortranarray(values.reshape(-1, 1)), uplo="L")
    return np.ascontiguousarray(out).reshape(n, s)


def _step_all_blocks(setup: Setup, theta: Theta, path: FloatArray, inputs: Inputs) -> FloatArray:
    """Return states (n, s) by stepping all blocks side by side, one row after the other."""
    drive = setup.drive
    starts, ends = drive.starts, drive.ends
    out = path.copy()
    for k in range(int((ends - starts).max()) - 1):
        rows = starts[starts + k + 1 < ends] + k
        dt = drive.time_s[rows + 1] - drive.time_s[rows]
        span = Span(inputs.take(rows), inputs.take(rows + 1))
        out[rows + 1] = setup.baseline.step(out[rows], span, theta, dt)
    return out


def outputs_along(
    setup: Setup,
    theta: Theta,
    states: FloatArray,
    names: Sequence[str],
    disturbances: FloatArray | None = None,
) -> FloatArray:
    """Return outputs at states (n, s), (n, m), with disturbances (n, d) where they are given."""
    whole = theta
    if disturbances is not None:
        _, free = setup.split_path(np.concatenate([states, disturbances], axis=1), states.shape[1])
        whole = (*theta, free)
    frame = setup.baseline.frame(states, setup.inputs(theta), whole)
    return np.stack([np.broadcast_to(frame.outputs[name], states.shape[:1]) for name in names], axis=1)


def predicted(setup: Setup, theta: Theta, path: FloatArray) -> FloatArray:
    """Return the outputs of the channels that the inputs give from each block's first state, (n, m)."""
    return outputs_along(setup, theta, free_run(setup, theta, path), setup.channels)
