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
from tpmsd.car.physics.dynamics_effect import same_motion
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.arrays import IntArray
from tpmsd.offline.dynamics.noise import PathNoise
from tpmsd.offline.dynamics.path import Linear, Setup, Weighted, linear, subset_of_blocks
from tpmsd.offline.dynamics.settings import SETTINGS


@dataclass(frozen=True)
class Probe:
    """A change of the model, and what it is divided by to be a derivative."""

    theta: Theta
    """The whole model with the change."""
    size: float
    weights: FloatArray | None = None
    """(n,) where the change acts, for a basis function of a spline; probes of one model share its
    evaluation."""
    loosens: bool = False
    """True if the change leaves the path much more or less room: the likelihood's volume counts."""


@dataclass(frozen=True)
class BlockGram:
    """Sufficient statistics of B blocks for p parameters, about the values that the path was linearised
    at."""

    information: FloatArray
    """(B, p, p)"""
    gradient: FloatArray
    """(B, p)"""

    def only(self, columns: Sequence[int]) -> BlockGram:
        """Return the statistics of some of the parameters."""
        rows = np.asarray(columns, dtype=int)
        return BlockGram(self.information[:, rows[:, None], rows], self.gradient[:, rows])

    def recombined(self, matrix: FloatArray) -> BlockGram:
        """Return the statistics of q new parameters; the old ones are `matrix` (p, q) times them."""
        information = np.einsum("pi,bpq,qj->bij", matrix, self.information, matrix, optimize=True)
        return BlockGram(information, self.gradient @ matrix)


def model_derivatives(
    setup: Setup, theta: Theta, at: Linear, probes: Sequence[Probe]
) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives of rates (p, s, n) and readings (p, m, n) by the probes."""
    states = setup.states(theta)
    inputs = setup.inputs(theta)
    rolled = setup.baseline.evaluate_to_tyre_forces(at.path[:, : len(states)], inputs, theta, states)
    rates, outputs, earlier = setup.evaluate(at.path, inputs, theta, states, rolled)
    by_rate = np.empty((len(probes), *rates.shape))
    by_output = np.empty((len(probes), *outputs.shape))
    last: Theta | None = None
    moved, seen = rates, outputs
    for k, probe in enumerate(probes):
        if probe.theta is not last:
            last = probe.theta
            known = earlier if same_motion(theta, last) else None
            moved, seen, _ = setup.evaluate(at.path, setup.inputs(last), last, states, rolled, earlier=known)
            moved, seen = (moved - rates) / probe.size, (seen - outputs) / probe.size
        weights = 1.0 if probe.weights is None else probe.weights
        np.multiply(moved, weights, out=by_rate[k])
        np.multiply(seen, weights, out=by_output[k])
    by_output *= np.isfinite(at.reading_residual).T
    return by_rate, by_output


def gram(setup: Setup, theta: Theta, at: Linear, noise: PathNoise, probes: Sequence[Probe]) -> BlockGram:
    """Return the statistics of all blocks for these probes."""
    drive = setup.drive
    if not probes:
        blocks = len(drive.starts)
        return BlockGram(np.zeros((blocks, 0, 0)), np.zeros((blocks, 0)))
    merged, indices = _merge_disjoint_probes(probes, drive.starts)
    inner = _gram_of_columns(setup, theta, at, noise, merged)
    loosening = [k for k, probe in enumerate(merged) if probe.loosens]
    if loosening:
        rows = drive.ends - drive.starts
        inner.gradient[:, loosening] += rows[:, None] * _volume_gradient(
            setup, theta, at, noise, [merged[k] for k in loosening]
        )
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


def _volume_gradient(
    setup: Setup, theta: Theta, at: Linear, noise: PathNoise, probes: Sequence[Probe]
) -> FloatArray:
    """Return the derivatives of the log of the paths' volume by the probes, per row, (p,).

    A likelihood integrates over all paths: with their information H it has the factor 1 / sqrt(det H). A body
    that swings lets sudden forces show more in a reading; of two such models the likelihood at the
    likeliest path alone would prefer the looser one. Some blocks are enough.
    """
    few, part = subset_of_blocks(setup, at)
    path = part.path
    own = linear(few, theta, path).weighted(few, noise).factor.half_log_determinant()
    moved = [linear(few, one.theta, path).weighted(few, noise) for one in probes]
    loss = [one.factor.half_log_determinant() - own for one in moved]
    sizes = [probe.size for probe in probes]
    return np.asarray(-np.array(loss) / np.array(sizes) / len(path))


def _merge_disjoint_probes(probes: Sequence[Probe], starts: IntArray) -> tuple[list[Probe], IntArray]:
    """Return merged probes, and (p, B) the given probe that each stands for in a block; -1: none.

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


def _gram_of_columns(
    setup: Setup, theta: Theta, at: Linear, noise: PathNoise, probes: Sequence[Probe]
) -> BlockGram:
    """Return the statistics of all blocks, each probe a column of its own.

    With the path's information L L' and a column's right-hand side c for the path, the information of two
    columns is their product in whitened residuals less that of L^-1 c.
    """
    drive = setup.drive
    weighted = at.weighted(setup, noise)
    derivatives = model_derivatives(setup, theta, at, probes)
    count, states = len(probes), derivatives[0].shape[1]
    left = weighted.factor.half_solve_rows(weighted.gradient()[None])[0]
    step_pull = (np.sqrt(weighted.step_weight) * at.step_residual)[:, :states]
    reading = np.where(np.isfinite(at.reading_residual), at.reading_residual, 0.0)
    reading_pull = np.sqrt(weighted.reading_weight) * reading
    information, gradient = [], []
    for blocks in _groups_of_blocks(drive.starts, drive.ends, count):
        begin = int(drive.starts[blocks][0])
        step, read, asked = _whitened_columns(at, weighted, *derivatives, begin, drive.ends[blocks][-1])
        gone = weighted.factor.half_solve_rows(asked, begin)
        for first, last in zip(drive.starts[blocks], drive.ends[blocks], strict=True):
            own, between = slice(first - begin, last - begin), slice(first - begin, last - begin - 1)
            held, seen = step[between].reshape(-1, count), read[own].reshape(-1, count)
            lost = gone[:, own].reshape(count, -1)
            information.append(held.T @ held + seen.T @ seen - lost @ lost.T)
            pull = step_pull[first : last - 1].reshape(-1) @ held
            pull += reading_pull[first:last].reshape(-1) @ seen
            gradient.append(pull - lost @ left[first:last].reshape(-1))
    return BlockGram(np.array(information), np.array(gradient))


def _groups_of_blocks(starts: IntArray, ends: IntArray, columns: int) -> list[slice]:
    """Return slices of the blocks, so many in each that what is computed of these columns at once fits into a
    processor's cache."""
    rows = max(SETTINGS.values_at_once // columns, 1)
    edges = [0]
    for k in range(1, len(starts)):
        if ends[k] - starts[edges[-1]] > rows:
            edges.append(k)
    return [slice(first, last) for first, last in zip(edges, [*edges[1:], len(starts)], strict=True)]


def _whitened_columns(
    at: Linear,
    weighted: Weighted,
    by_rate: FloatArray,
    by_output: FloatArray,
    first: int,
    last: int,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the whitened columns of the n rows from `first` to `last`, those of steps (n - 1, s, p) and of
    readings (n, m, p), and their right-hand sides for the path, (p, n, t); nothing links these rows with
    others."""
    states = by_rate.shape[1]
    rows, links = slice(first, last), slice(first, last - 1)
    by_state = at.by_state[links, :states]
    root = np.sqrt(weighted.step_weight[links, :states, None])
    reading_root = np.sqrt(weighted.reading_weight[rows, :, None])
    rate, read = (np.ascontiguousarray(one[:, :, rows].transpose(2, 1, 0)) for one in (by_rate, by_output))
    step = at.by_rates[0, links] @ rate[:-1]
    step += at.by_rates[1, links] @ rate[1:]
    step *= root
    read *= reading_root
    pulled = root * step
    asked = np.swapaxes(reading_root * at.outputs_by_state[rows], 1, 2) @ read
    asked[:-1] += np.swapaxes(by_state, 1, 2) @ pulled
    asked[1:, :states] -= pulled
    return step, read, np.moveaxis(asked, 2, 0)


def step_derivative(by_rates: FloatArray, by_rate: FloatArray) -> FloatArray:
    """Return the derivative of the steps, (s, n - 1), by a change of the rates, (s, n), linear over each."""
    rate = by_rate.T[:, :, None]
    return np.asarray((by_rates[0] @ rate[:-1] + by_rates[1] @ rate[1:])[:, :, 0].T)
