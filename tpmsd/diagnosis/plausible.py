"""Whether fitted values are such as nature makes.

In: a `Term` and its values in a joint fit. Out: whether they lie within what is physically thinkable, and
what the data say against two values that one force makes together.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tpmsd.diagnosis.terms import Term
from tpmsd.physics.catalogue import EFFECTS
from tpmsd.physics.effect import Parameter
from tpmsd.physics.motion import Car
from tpmsd.wheels import FloatArray

SMALLEST_M = 3e-5
"""No road leaves a tyre's radius alone better than to this: a smaller change is not worth a name."""
IMPOSSIBLE = 12.5
"""Log-likelihood against every ratio of an effect's two values that nature knows: then it is none."""
Bounds = Mapping[tuple[str, str], tuple[float, float]]
BOUNDS = {
    (name, parameter.name): (parameter.lower - 1.0, parameter.upper - 1.0)
    if name == "yaw_rate_scale"
    else (parameter.lower, parameter.upper)
    for name, effect in EFFECTS.items()
    for parameter in effect.parameters
    if isinstance(parameter, Parameter)
}
BOUNDS["doppler_lag", "lag_s"] = (-0.2, 0.2)
BOUNDS["grade_share", "share"] = (-1.5, 1.0)
# No wheels stand a hand's breadth farther out on either side than the car's papers say.
BOUNDS["track_width_error", "rear_m"] = BOUNDS["track_width_error", "front_m"] = (-0.25, 0.25)
"""Of the fitted values, by effect and parameter; a scale is fitted as its difference from one."""
BEHIND_M, BESIDE_M = 1.5, 1.2
"""How far behind the rear axle, before the front one, and off the middle a car's roof reaches."""


def bounds_of(car: Car) -> Bounds:
    """What a car adds to the bounds: what is called its antenna's place must lie on it."""
    ahead, left = car.antenna_forward_m, car.antenna_left_m
    return {
        ("antenna_lever_arm", "forward_m"): (-BEHIND_M - ahead, car.geometry.wheelbase_m + BEHIND_M - ahead),
        ("antenna_lever_arm", "left_m"): (-BESIDE_M - left, BESIDE_M - left),
    }


def thinkable(term: Term, values: FloatArray, bounds: Bounds = BOUNDS) -> bool:
    """Whether each of a term's values (k,) is within bounds, and a radius' change worth a name."""
    if term.on_radii and float(np.abs(values).max()) < SMALLEST_M:
        return False
    for name, value in zip(term.parameters, values, strict=False):
        low, high = bounds.get((term.effect, name), (-np.inf, np.inf))
        if not low <= value <= high:
            return False
    return True


def ratio_limits(term: Term) -> tuple[float, float] | None:
    """Least and greatest ratio of a term's two values, if its effect has such limits."""
    effect = EFFECTS.get(term.effect)
    return None if effect is None or len(term.parameters) != 2 else effect.ratio_limits


def against_ratio(term: Term, values: FloatArray, covariance: FloatArray) -> float:
    """What the data say against all ratios of a term's two values that its effect allows: nats."""
    limits = ratio_limits(term)
    if limits is None or limits[0] * values[0] ** 2 <= values[0] * values[1] <= limits[1] * values[0] ** 2:
        return 0.0
    # The nearest allowed pair lies on an edge: second = limit * first.
    edges = np.array([[-limit, 1.0] for limit in limits])
    variance = np.einsum("ki,ij,kj->k", edges, covariance, edges)
    return float(np.min(0.5 * (edges @ values) ** 2 / variance))
