"""Evidence of sets of terms from sufficient statistics: Bayes factors with priors, overdispersion, held-out
log-likelihood.

In: `BlockGram`, sets of columns with priors, columns held at a value. Out: numbers. The log-likelihood is
g d - d'G d / 2 for differences d of the parameters from the values of the linearisation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.arrays import IntArray
from tpmsd.offline.dynamics.columns import BlockGram

PRIOR_BLOCKS = 10.0
"""Blocks that an overdispersion of 1 counts for beside those of the drive."""


@dataclass(frozen=True)
class PriorColumns:
    """Free columns with priors."""

    index: tuple[int, ...]
    offset: FloatArray
    """Mean of the prior minus the value of the linearisation."""
    precision: FloatArray


def join_columns(parts: Sequence[PriorColumns]) -> PriorColumns:
    """Return several sets of columns as one."""
    index = tuple(k for part in parts for k in part.index)
    if not parts:
        return PriorColumns((), np.zeros(0), np.zeros(0))
    return PriorColumns(
        index,
        np.concatenate([part.offset for part in parts]),
        np.concatenate([part.precision for part in parts]),
    )


class Statistics:
    """Sums of a Gram over blocks, and over all but some."""

    def __init__(self, gram: BlockGram) -> None:
        self.blocks = gram
        self.information = gram.information.sum(axis=0)
        self.gradient = gram.gradient.sum(axis=0)

    def fit(
        self,
        free: PriorColumns,
        held: Sequence[int] = (),
        values: Sequence[float] = (),
        left_out: IntArray | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Return estimate and covariance of the free columns, some others held at values.

        `left_out` are blocks that do not take part.
        """
        information, gradient = self.information, self.gradient
        if left_out is not None:
            information = information - self.blocks.information[left_out].sum(axis=0)
            gradient = gradient - self.blocks.gradient[left_out].sum(axis=0)
        rows = np.array(free.index, dtype=int)
        right = gradient[rows] + free.precision * free.offset
        if len(held):
            right = right - information[np.ix_(rows, np.array(held))] @ np.array(values)
        matrix = information[np.ix_(rows, rows)] + np.diag(free.precision)
        covariance = np.linalg.inv(matrix)
        return covariance @ right, covariance

    def log_likelihood(
        self, columns: Sequence[int], values: FloatArray, blocks: IntArray | None = None
    ) -> float:
        """Return the log-likelihood of values beyond that of the linearisation, of all or of some blocks."""
        rows = np.array(columns, dtype=int)
        if not len(rows):
            return 0.0
        if blocks is None:
            information, gradient = self.information, self.gradient
        else:
            information = self.blocks.information[blocks].sum(axis=0)
            gradient = self.blocks.gradient[blocks].sum(axis=0)
        return float(gradient[rows] @ values - 0.5 * values @ information[np.ix_(rows, rows)] @ values)

    def addition(
        self, given: PriorColumns, added: PriorColumns, held: Sequence[int] = (), values: Sequence[float] = ()
    ) -> Addition:
        """Return gain statistics of added columns jointly with the given ones (Schur complement)."""
        a, s = np.array(added.index, dtype=int), np.array(given.index, dtype=int)
        information, gradient = self.information, self.gradient
        blocks = self.blocks.gradient
        if len(held):
            h, v = np.array(held), np.array(values)
            gradient = gradient - information[:, h] @ v
            blocks = blocks - self.blocks.information[:, :, h] @ v
        if len(s):
            inner = information[np.ix_(s, s)] + np.diag(given.precision)
            mix = np.linalg.solve(inner, information[np.ix_(s, a)])
            reduced = information[np.ix_(a, a)] - information[np.ix_(a, s)] @ mix
            pull = gradient[a] - mix.T @ (gradient[s] + given.precision * given.offset)
        else:
            mix = np.zeros((0, len(a)))
            reduced, pull = information[np.ix_(a, a)], gradient[a]
        reduced = 0.5 * (reduced + reduced.T)
        joint = join_columns([given, added])
        estimate, _ = self.fit(joint, held, values)
        rows = np.array(joint.index, dtype=int)
        scores = blocks[:, rows] - self.blocks.information[:, rows[:, None], rows] @ estimate
        own = scores[:, len(s) :] - scores[:, : len(s)] @ mix
        return Addition(reduced, pull, own, added, estimate[len(s) :])


@dataclass(frozen=True)
class Addition:
    """Log-likelihood gain of a set of columns jointly with the present model."""

    information: FloatArray
    """(a, a) with the model's own columns eliminated."""
    gradient: FloatArray
    """(a,)"""
    scores: FloatArray
    """(B, a) gradients of the blocks at the joint fit."""
    columns: PriorColumns
    estimate: FloatArray
    """(a,) of the joint fit."""

    @property
    def visible(self) -> bool:
        """Return True if the drive informs any of the columns."""
        diagonal = np.diag(self.information)
        return bool(np.all(diagonal > 1e-9 * self.columns.precision) and np.all(diagonal > 0.0))

    @property
    def overdispersion(self) -> float:
        """Return the variance of the blocks' scores over what the noise accounts for, at least 1."""
        size = len(self.gradient)
        scaled = np.linalg.solve(_regularised(self.information), self.scores.T @ self.scores)
        count = len(self.scores)
        ratio = float(np.trace(scaled)) / size * count / max(count - 1, 1)
        return max((PRIOR_BLOCKS + count * ratio) / (PRIOR_BLOCKS + count), 1.0)

    def log_evidence(self, ratio: float | None = None) -> float:
        """Return the log Bayes factor for the set, with the overdispersion `ratio`, else its own."""
        if not self.visible:
            return -np.inf
        ratio = self.overdispersion if ratio is None else ratio
        information, gradient = self.information / ratio, self.gradient / ratio
        prior, offset = self.columns.precision, self.columns.offset
        right = gradient + prior * offset
        matrix = information + np.diag(prior)
        gain = 0.5 * right @ np.linalg.solve(matrix, right) - 0.5 * np.sum(prior * offset**2)
        occam = np.linalg.slogdet(matrix)[1] - np.sum(np.log(prior))
        return float(gain - 0.5 * occam)

    def gain(self) -> float:
        """Return the log-likelihood gain of the best fit, without priors or overdispersion."""
        return 0.5 * float(self.gradient @ np.linalg.solve(_regularised(self.information), self.gradient))

    def p_value(self) -> float:
        """Return the two-sided p-value of the largest component, by Student's t over the blocks."""
        ratio = self.overdispersion
        covariance = np.linalg.inv(_regularised(self.information)) * ratio
        size = np.abs(covariance @ self.gradient / ratio) / np.sqrt(np.diag(covariance))
        tail = 2.0 * float(stdtr(max(len(self.scores) - 1, 1), -float(size.max())))
        return float(min(tail * len(size), 1.0))

    def sizes_at_evidence(self, nats: float) -> FloatArray:
        """Return (a,) for each column alone the size that would reach this log evidence."""
        ratio = self.overdispersion
        information = np.maximum(np.diag(self.information) / ratio, 1e-300)
        occam = 0.5 * np.log1p(information / self.columns.precision)
        return np.asarray(np.sqrt(2.0 * (nats + occam) / information))


def _regularised(matrix: FloatArray) -> FloatArray:
    """Return the matrix with its diagonal larger by a billionth, so that it can be inverted."""
    return matrix + np.diag(1e-9 * np.diag(matrix) + 1e-300)
