"""Sets of effects that every car has, as one model against a spline term.

In: terms of the catalogue; Gram matrix and correlation of all columns, calibration and what was chosen beside
projected out. Out: the set with the highest evidence, and its log Bayes factor over none of them.

Slip, brakes and shifted loads act together over one force, each in its own shape: alone none of them explains
what they do, and a spline term explains anything. So models are compared and no single columns: the values of
a set have the normal priors of the catalogue, and are integrated out (Bayes factors: Kass and Raftery,
Journal of the American Statistical Association 90, 1995).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.catalogue import parameters_of
from tpmsd.car.physics.effect import Parameter
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.terms import Term


@dataclass(frozen=True)
class EffectSet:
    """Terms as one model."""

    terms: tuple[Term, ...] = ()
    log_bayes: float = 0.0
    """Log Bayes factor over none of them, nats."""


def priors_of(term: Term) -> tuple[FloatArray, FloatArray]:
    """Return the mean and standard deviation (k,) each of a term's values, as differences from neutral, by
    the catalogue; ValueError where it has none."""
    means, stds = [], []
    for name in term.parameters:
        known = parameters_of(term.effect)[name]
        if not isinstance(known, Parameter) or known.prior is None:
            raise ValueError(f"{term.effect}.{name} has no prior")
        means.append(known.prior.mean - known.neutral)
        stds.append(known.prior.std)
    return np.array(means), np.array(stds)


def log_bayes(terms: Sequence[Term], gram: FloatArray, b: FloatArray) -> float:
    """Log Bayes factor (nats) of terms over none of them.

    Values x ~ N(m, D^2) and data y = X x + white noise of unit size give, with A = X^T X, s = X^T y and
    M = 1 + D A D: m^T s - m^T A m / 2 + (s - A m)^T D M^-1 D (s - A m) / 2 - log(det M) / 2. `gram` (p, p)
    and `b` (p,) are of all columns.
    """
    if not terms:
        return 0.0
    part = np.concatenate([term.design[1:] for term in terms], axis=1)
    rows = np.flatnonzero(np.any(part != 0.0, axis=1))
    part = part[rows]
    means, stds = (np.concatenate(each) for each in zip(*map(priors_of, terms), strict=True))
    A, s = part.T @ gram[np.ix_(rows, rows)] @ part, part.T @ b[rows]
    left = (s - A @ means) * stds
    M = np.eye(len(s)) + A * np.outer(stds, stds)
    at_means = float(means @ s - 0.5 * means @ A @ means)
    return at_means + 0.5 * float(left @ np.linalg.solve(M, left) - np.linalg.slogdet(M)[1])


def best_set(terms: Sequence[Term], gram: FloatArray, b: FloatArray) -> EffectSet:
    """Return the set with the highest evidence, one term of each effect at most: of all effects at their
    fullest those are left out, one after the other, that it is better without, then single values of the
    rest.
    """
    by_effect: dict[str, list[Term]] = {}
    for term in terms:
        by_effect.setdefault(term.effect, []).append(term)
    if not by_effect:
        return EffectSet()

    def scored(chosen: Sequence[Term]) -> EffectSet:
        return EffectSet(tuple(chosen), log_bayes(chosen, gram, b))

    best = scored([max(each, key=lambda one: len(one.parameters)) for each in by_effect.values()])
    while True:
        trials = []
        for k, term in enumerate(best.terms):
            rest = (*best.terms[:k], *best.terms[k + 1 :])
            trials.append(scored(rest))
            trials += [scored((*rest, other)) for other in by_effect[term.effect] if other is not term]
        better = max(trials, key=lambda one: one.log_bayes, default=EffectSet())
        if better.log_bayes <= best.log_bayes + math.ulp(best.log_bayes):
            return best
        best = better
