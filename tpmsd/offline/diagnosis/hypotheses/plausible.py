"""Plausibility of fitted values by physics.

In: a `Term` and its values in a joint fit. Out: whether they lie within what is physically thinkable, and
what the data say against two values that one force makes together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tpmsd.car.physics.catalogue import ADDED, EFFECTS, MISSED
from tpmsd.car.physics.motion import Car
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.terms import CarLimits, Term
from tpmsd.offline.diagnosis.settings import SETTINGS

Bounds = Mapping[tuple[str, ...], tuple[float, float]]
Rates = Mapping[str, tuple[float, float]]
"""Least and greatest rate of lost counts (1/s) by wheel; of added ones negative."""
RATE = "rate_per_s"


def bounds_of(car: Car) -> Bounds:
    """Return the limits of the fitted values (differences from neutral) on this car, by effect and
    parameter.
    """
    return {
        (name, parameter): limits
        for name, effect in EFFECTS.items()
        for parameter, limits in effect.limits(car).items()
    }


def completions_of(car: Car) -> Mapping[tuple[str, str], str]:
    """Return, by effect and parameter, the parameter of other effects to which the limits of the
    sum apply.
    """
    return {
        (name, parameter): other
        for name, effect in EFFECTS.items()
        for parameter, other in effect.summed_with(car).items()
    }


def limits_of(car: Car, rates: Sequence[Rates] = ()) -> CarLimits:
    """Return the limits that the hypotheses know of a car, and those of its counters by the `rates` of lost
    counts that their ripple leaves possible on each drive."""
    bounds = {**bounds_of(car), **counter_bounds(rates)}
    return CarLimits(bounds, completions_of(car), car.radius_m, car.driven)


def counter_bounds(rates: Sequence[Rates]) -> Bounds:
    """Return the limits of lost and added counts, by effect, parameter and wheel, of the wheels whose ripple
    shows on all drives: what one of the drives allows is possible.
    """
    wheels = set.intersection(*(set(one) for one in rates)) if rates else set()
    out: dict[tuple[str, ...], tuple[float, float]] = {}
    for wheel in wheels:
        low, high = min(one[wheel][0] for one in rates), max(one[wheel][1] for one in rates)
        out[MISSED.name, RATE, wheel] = (low, high)
        out[ADDED.name, RATE, wheel] = (-high, -low)
    return out


def completion_matrix(terms: Sequence[Term], completions: Mapping[tuple[str, str], str]) -> FloatArray:
    """Return the matrix (k, k) from all fitted values of the terms to the values that limits apply to."""
    names = [(which, name) for which, term in enumerate(terms) for name in term.parameters]
    out = np.eye(len(names))
    for row, (which, name) in enumerate(names):
        other = completions.get((terms[which].effect, name))
        out[row] += [other == theirs and one != which for one, theirs in names]
    return out


def is_plausible(term: Term, values: FloatArray, bounds: Bounds) -> bool:
    """Return whether each of a term's values (k,) is within bounds, and a change of a radius large enough to
    be reported."""
    if term.on_radii and float(np.abs(values).max()) < SETTINGS.hypotheses.smallest_radius_m:
        return False
    for name, value in zip(term.parameters, values, strict=False):
        for key in ((term.effect, name), (term.effect, name, term.wheel or term.pattern)):
            low, high = bounds.get(key, (-np.inf, np.inf))
            if not low <= value <= high:
                return False
    return True


def ratio_limits(term: Term) -> tuple[float, float] | None:
    """Return the least and greatest ratio of a term's two values; None if its effect has no such limits."""
    return None if len(term.parameters) != 2 else term.kind_of.nonlinear.ratio_limits


def nats_against_ratio(term: Term, values: FloatArray, covariance: FloatArray) -> float:
    """Return the least log-likelihood (nats) that a term loses where physics limits its values' ratio.

    The ratio is that of its two values, the limits are those of its effect.
    """
    limits = ratio_limits(term)
    if limits is None:
        return 0.0
    least, greatest = limits
    # Normals of the two edges, second = limit * first; without a greatest ratio the first value may be zero.
    edges = np.array([[-least, 1.0], [greatest, -1.0] if np.isfinite(greatest) else [1.0, 0.0]])
    beyond = edges @ values
    if float(np.prod(beyond)) >= 0.0:
        return 0.0
    # The nearest allowed pair lies on an edge.
    variance = np.einsum("ki,ij,kj->k", edges, covariance, edges)
    return float(np.min(0.5 * beyond**2 / variance))
