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
    """(n,) where the change acts, for a basis function of a spline; probes of one model share its evaluation."""


@dataclass(frozen=True)
class Gram:
    """Sufficient statistics of B blocks for p parameters, about the values that the path was linearised at."""

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
    """Return the derivatives of rates (n, s, p) and readings (n, m, p) by the probes."""
    states = setup.states(theta)
    count = len(states)
    rates, outputs = setup.evaluate(at.path, setup.inputs(theta), theta)
    n, m = outputs.shape
    by_rate, by_output = np.empty((n, count, len(probes))), np.empty((n, m, len(probes)))
    last: Theta | None = None
    moved, seen = rates, outputs
    for k, probe in enumerate(probes):
        if probe.theta is not last:
            last = probe.theta
            moved, seen = setup.evaluate(at.path, setup.inputs(last), last, states)
        by_rate[:, :, k] = (moved[:, :count] - rates) / probe.size
        by_output[:, :, k] = (seen - outputs) / probe.size
        if probe.weights is not None:
            by_rate[:, :, k] *= probe.weights[:, None]
            by_output[:, :, k] *= probe.weights[:, None]
    return by_rate, by_output


def gram(setup: Setup, theta: Theta, at: Linear, noise: Noise, probes: Sequence[Probe]) -> Gram:
    """Return the statistics of all blocks for these probes."""
    drive = setup.drive
    if not probes:
        blocks = len(drive.starts)
        return Gram(np.zeros((blocks, 0, 0)), np.zeros((blocks, 0)))
    by_rate, by_output = changes(setup, theta, at, probes)
    count, total = by_rate.shape[1], at.path.shape[1]
    dt = np.where(drive.linked, np.diff(drive.time_s), 0.0)
    # trapezium over the step, the first half carried on by the step itself
    step = np.einsum("nij,njp->nip", at.by_state[:, :count, :count], by_rate[:-1], optimize=True)
    step += by_rate[1:]
    step *= 0.5 * dt[:, None, None]
    weighted = Weighted(setup, at, noise)
    reading = np.where(np.isfinite(at.reading_residual)[:, :, None], by_output, 0.0)
    cross = np.zeros((len(at.path), total, by_rate.shape[2]))
    pulled = weighted.step_weight[:, :count, None] * step
    cross[1:, :count] -= pulled
    cross[:-1] += np.einsum("nij,nip->njp", at.by_state[:, :count], pulled, optimize=True)
    trusted = weighted.reading_weight[:, :, None] * reading
    cross += np.einsum("nmi,nmp->nip", at.outputs_by_state, trusted, optimize=True)
    eliminated = weighted.factor.solve(cross)
    left = weighted.gradient()
    residual = np.where(np.isfinite(at.reading_residual), at.reading_residual, 0.0)
    information, gradient = [], []
    for first, last in zip(drive.starts, drive.ends, strict=True):
        rows, steps = slice(first, last), slice(first, max(last - 1, first))
        own = _product(step[steps], pulled[steps]) + _product(reading[rows], trusted[rows])
        information.append(own - _product(cross[rows], eliminated[rows]))
        pull = np.einsum("nip,ni->p", pulled[steps], at.step_residual[steps, :count])
        pull = np.einsum("nmp,nm->p", trusted[rows], residual[rows]) + pull
        gradient.append(pull - np.einsum("nip,ni->p", eliminated[rows], left[rows]))
    return Gram(np.array(information), np.array(gradient))


def _product(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the sum over rows and components, (p, p)."""
    p = left.shape[-1]
    return left.reshape(-1, p).T @ right.reshape(-1, p)
