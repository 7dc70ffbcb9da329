"""Columns of the diagnosis: how steps and readings change with a parameter, and what is left of them once the
path is eliminated.

In: a path with its derivatives, probes. Out: `Gram`: per block the information matrix of the parameters and
the gradient of the log-likelihood, the path eliminated. This is what innovations whitened by the Kalman
filter and their differences give, summed over each block.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.baselines.base import Theta
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.noise import Noise
from tpmsd.offline.dynamics.path import Linear, Setup, Weighted


@dataclass(frozen=True)
class Probe:
    """A change of the model, and what it is divided by to be a derivative."""

    theta: Theta
    """The whole model with the change."""
    size: float
    weights: FloatArray | None = None
    """(n,) where the change acts, for a basis function of a spline; probes of one model share its
    evaluation."""


@dataclass(frozen=True)
class Gram:
    """Sufficient statistics of B blocks for p parameters, about the values that the path was linearised
    at."""

    information: FloatArray
    """(B, p, p)"""
    gradient: FloatArray
    """(B, p)"""

    def only(self, columns: Sequence[int]) -> Gram:
        """Return some of the parameters."""
        rows = np.asarray(columns, dtype=int)
        return Gram(self.information[:, rows[:, None], rows], self.gradient[:, rows])

    def combined(self, matrix: FloatArray) -> Gram:
        """Return new parameters of which the old ones are `matrix` (p, q) times these."""
        information = np.einsum("pi,bpq,qj->bij", matrix, self.information, matrix, optimize=True)
        return Gram(information, self.gradient @ matrix)


def changes(setup: Setup, theta: Theta, at: Linear, probes: Sequence[Probe]) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives of rates (p, n, s) and readings (p, n, m) by the probes."""
    states = setup.states(theta)
    count = len(states)
    rates, outputs = setup.evaluate(at.path, setup.inputs(theta), theta)
    n, m = outputs.shape
    by_rate, by_output = np.empty((len(probes), n, count)), np.empty((len(probes), n, m))
    last: Theta | None = None
    moved, seen = rates, outputs
    for k, probe in enumerate(probes):
        if probe.theta is not last:
            last = probe.theta
            moved, seen = setup.evaluate(at.path, setup.inputs(last), last, states)
            moved, seen = (moved[:, :count] - rates) / probe.size, (seen - outputs) / probe.size
        if probe.weights is None:
            by_rate[k], by_output[k] = moved, seen
        else:
            np.multiply(moved, probe.weights[:, None], out=by_rate[k])
            np.multiply(seen, probe.weights[:, None], out=by_output[k])
    return by_rate, by_output


def step_changes(setup: Setup, at: Linear, by_rate: FloatArray) -> FloatArray:
    """Return the derivatives of the steps, (p, n - 1, s): the trapezium rule over each."""
    count = by_rate.shape[2]
    dt = np.where(setup.drive.linked, np.diff(setup.drive.time_s), 0.0)
    half = 0.5 * dt[:, None]
    out = by_rate[:, 1:] * half
    for i in range(count):
        for j in range(count):
            out[:, :, i] += (at.by_state[:, i, j] * half[:, 0]) * by_rate[:, :-1, j]
    return out


def gram(setup: Setup, theta: Theta, at: Linear, noise: Noise, probes: Sequence[Probe]) -> Gram:
    """Return the statistics of all blocks for these probes."""
    drive = setup.drive
    if not probes:
        blocks = len(drive.starts)
        return Gram(np.zeros((blocks, 0, 0)), np.zeros((blocks, 0)))
    by_rate, by_output = changes(setup, theta, at, probes)
    count, total = by_rate.shape[2], at.path.shape[1]
    step = step_changes(setup, at, by_rate)
    weighted = Weighted(setup, at, noise)
    by_output *= np.isfinite(at.reading_residual)
    cross = np.zeros((len(probes), len(at.path), total))
    pulled = weighted.step_weight[:, :count] * step
    cross[:, 1:, :count] -= pulled
    trusted = weighted.reading_weight * by_output
    for j in range(total):
        for i in range(count):
            cross[:, :-1, j] += at.by_state[:, i, j] * pulled[:, :, i]
        for i in range(by_output.shape[2]):
            cross[:, :, j] += at.outputs_by_state[:, i, j] * trusted[:, :, i]
    eliminated = weighted.factor.solve_rows(cross)
    left = weighted.gradient()
    residual = np.where(np.isfinite(at.reading_residual), at.reading_residual, 0.0)
    information, gradient = [], []
    for first, last in zip(drive.starts, drive.ends, strict=True):
        rows, steps = slice(first, last), slice(first, max(last - 1, first))
        own = _product(step[:, steps], pulled[:, steps]) + _product(by_output[:, rows], trusted[:, rows])
        gone = _flat(eliminated[:, rows])
        information.append(own - _flat(cross[:, rows]) @ gone.T)
        pull = _flat(pulled[:, steps]) @ at.step_residual[steps, :count].reshape(-1)
        pull += _flat(trusted[:, rows]) @ residual[rows].reshape(-1)
        gradient.append(pull - gone @ left[rows].reshape(-1))
    return Gram(np.array(information), np.array(gradient))


def _flat(values: FloatArray) -> FloatArray:
    return values.reshape(len(values), -1)


def _product(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the sum over rows and components, (p, p)."""
    return _flat(left) @ _flat(right).T
