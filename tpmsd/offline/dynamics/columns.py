"""Columns of the diagnosis: how steps and readings change with a parameter, and what is left of them once the
path is eliminated.

In: a path with its derivatives, probes. Out: `BlockGram`: per block the information of the parameters and
the gradient of the log-likelihood, the path eliminated. This is what innovations whitened by the Kalman
filter and their differences give, summed over each block.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.baselines.base import Theta
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.arrays import IntArray
from tpmsd.offline.dynamics.noise import PathNoise
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
class BlockGram:
    """Sufficient statistics of B blocks for p parameters, about the values that the path was linearised
    at."""

    information: FloatArray
    """(B, p, p)"""
    gradient: FloatArray
    """(B, p)"""

    def only(self, columns: Sequence[int]) -> BlockGram:
        """Return some of the parameters."""
        rows = np.asarray(columns, dtype=int)
        return BlockGram(self.information[:, rows[:, None], rows], self.gradient[:, rows])

    def combined(self, matrix: FloatArray) -> BlockGram:
        """Return new parameters of which the old ones are `matrix` (p, q) times these."""
        information = np.einsum("pi,bpq,qj->bij", matrix, self.information, matrix, optimize=True)
        return BlockGram(information, self.gradient @ matrix)


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


def gram(setup: Setup, theta: Theta, at: Linear, noise: PathNoise, probes: Sequence[Probe]) -> BlockGram:
    """Return the statistics of all blocks for these probes."""
    drive = setup.drive
    if not probes:
        blocks = len(drive.starts)
        return BlockGram(np.zeros((blocks, 0, 0)), np.zeros((blocks, 0)))
    merged, indices = _merged(probes, drive.starts)
    inner = _gram(setup, theta, at, noise, merged)
    if len(merged) == len(probes):
        return inner
    information = np.zeros((len(drive.starts), len(probes), len(probes)))
    gradient = np.zeros((len(drive.starts), len(probes)))
    for block, index in enumerate(indices.T):
        used = np.flatnonzero(index >= 0)
        own = index[used]
        information[block][np.ix_(own, own)] = inner.information[block][np.ix_(used, used)]
        gradient[block, own] = inner.gradient[block, used]
    return BlockGram(information, gradient)


def _merged(probes: Sequence[Probe], starts: IntArray) -> tuple[list[Probe], IntArray]:
    """Return fewer probes, and (p, B) which of the given ones each of them is in each block; -1: none.

    Basis functions of one model that act in different blocks share a column: nothing links blocks.
    """
    blocks = len(starts)
    out: list[Probe] = []
    indices: list[IntArray] = []
    for k, probe in enumerate(probes):
        if probe.weights is None:
            out.append(probe)
            indices.append(np.full(blocks, k))
            continue
        acts = np.logical_or.reduceat(probe.weights != 0.0, starts)
        for j in range(len(out) - 1, -1, -1):
            other, weights = out[j], out[j].weights
            if other.theta is not probe.theta or weights is None:
                continue
            if not np.any(acts & (indices[j] >= 0)):
                out[j] = Probe(probe.theta, probe.size, weights + probe.weights)
                indices[j] = np.where(acts, k, indices[j])
                break
        else:
            out.append(probe)
            indices.append(np.where(acts, k, -1))
    return out, np.array(indices)


def _gram(setup: Setup, theta: Theta, at: Linear, noise: PathNoise, probes: Sequence[Probe]) -> BlockGram:
    """Return the statistics of all blocks, each probe a column of its own; arrays are (n, p, ...)."""
    drive = setup.drive
    by_rate, by_output = (
        np.ascontiguousarray(np.moveaxis(one, 0, 1)) for one in changes(setup, theta, at, probes)
    )
    count = by_rate.shape[2]
    dt = np.where(drive.linked, np.diff(drive.time_s), 0.0)[:, None, None]
    own_states = np.swapaxes(at.by_state[:, :count, :count], 1, 2)
    step = 0.5 * dt * (by_rate[1:] + by_rate[:-1] @ own_states)
    weighted = Weighted(setup, at, noise)
    by_output *= np.isfinite(at.reading_residual)[:, None, :]
    pulled = weighted.step_weight[:, None, :count] * step
    trusted = weighted.reading_weight[:, None, :] * by_output
    cross = trusted @ at.outputs_by_state
    cross[:-1] += pulled @ at.by_state[:, :count, :]
    cross[1:, :, :count] -= pulled
    cross = np.ascontiguousarray(np.swapaxes(cross, 0, 1))
    eliminated = weighted.factor.solve_rows(cross)
    left = weighted.gradient()
    residual = np.where(np.isfinite(at.reading_residual), at.reading_residual, 0.0)
    information, gradient = [], []
    for first, last in zip(drive.starts, drive.ends, strict=True):
        rows, steps = slice(first, last), slice(first, max(last - 1, first))
        pulls, trusts = _by_probe(pulled[steps]), _by_probe(trusted[rows])
        own = _by_probe(step[steps]) @ pulls.T + _by_probe(by_output[rows]) @ trusts.T
        gone = eliminated[:, rows].reshape(len(probes), -1)
        information.append(own - cross[:, rows].reshape(len(probes), -1) @ gone.T)
        pull = pulls @ at.step_residual[steps, :count].reshape(-1) + trusts @ residual[rows].reshape(-1)
        gradient.append(pull - gone @ left[rows].reshape(-1))
    return BlockGram(np.array(information), np.array(gradient))


def _by_probe(values: FloatArray) -> FloatArray:
    """Return values (n, p, s) as (p, n s)."""
    return np.swapaxes(values, 0, 1).reshape(values.shape[1], -1)
