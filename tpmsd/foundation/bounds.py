"""Bounds of numbers that come back from a state file: a checksum proves them whole, not sane.

In: plain JSON values. Out: the same as numbers and arrays; ValueError for what is beyond its bounds. A number
that passes here cannot overflow, and a covariance that passes is one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from tpmsd.foundation.wheels import FloatArray

LARGEST = 1e12
"""Upper bound of every saved quantity; the largest are Unix times, 2e9 s."""
MAX_DEPTH = 16
MAX_VALUES = 100_000
WIDER = 25.0
"""Ratio by which a saved variance may exceed the prior one: quantities that drift (GNSS latency) grow beyond
it."""
FAR = 50.0
"""Distance of a saved parameter from its prior mean, at most, in prior standard deviations."""
_ROUNDING = 1e-9
"""Share of the largest variance by which an eigenvalue may be negative by rounding."""


def number(value: object, low: float, high: float, what: str = "number") -> float:
    """Return a finite number in [low, high]; ValueError else, also for booleans and text."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"the saved {what} is no number")
    # Compared before it is converted: an integer of 400 digits has no float.
    if not low <= value <= high:
        raise ValueError(f"the saved {what} is not between {low:g} and {high:g}")
    return float(value)


def whole(value: object, low: int, high: int, what: str = "count") -> int:
    """Return an integer in [low, high]; ValueError else."""
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise ValueError(f"the saved {what} is no whole number between {low} and {high}")
    return value


def vector(value: object, size: int, what: str = "vector") -> FloatArray:
    """Return (size,) finite numbers below LARGEST; ValueError else."""
    if not isinstance(value, list) or len(value) != size:
        raise ValueError(f"the saved {what} has another shape")
    return np.array([number(x, -LARGEST, LARGEST, what) for x in value])


def covariance(value: object, most: FloatArray, what: str = "covariance") -> FloatArray:
    """Return (d, d) symmetric, positive semidefinite, with a diagonal of at most `most` (d,); ValueError
    else."""
    size = most.size
    if not isinstance(value, list) or len(value) != size:
        raise ValueError(f"the saved {what} has another shape")
    out = np.array([vector(row, size, what) for row in value]).reshape(size, size)
    scale = float(np.max(most, initial=0.0))
    if np.any(np.diag(out) < 0.0) or np.any(np.diag(out) > most * (1.0 + 1e-6) + 1e-15):
        raise ValueError(f"the saved {what} is beyond its bounds")
    if not np.allclose(out, out.T, rtol=1e-6, atol=_ROUNDING * scale):
        raise ValueError(f"the saved {what} is not symmetric")
    # In units of its own diagonal, so that small variances beside large ones are held to account, too.
    std = np.sqrt(np.maximum(np.diag(out), 1e-12 * scale + 1e-30))
    if np.linalg.eigvalsh(out / np.outer(std, std))[0] < -1e-6:
        raise ValueError(f"the saved {what} is none")
    return out


def check_plain(saved: object, depth: int = 0) -> int:
    """Return the number of values in a JSON document; ValueError if a number is not finite or out of bounds,
    or if the document is too deep or too large."""
    if depth > MAX_DEPTH:
        raise ValueError("the saved state is nested too deeply")
    if isinstance(saved, dict | list):
        items = saved.values() if isinstance(saved, dict) else saved
        count = 1
        for item in items:
            count += check_plain(item, depth + 1)
            if count > MAX_VALUES:
                raise ValueError(f"the saved state holds more than {MAX_VALUES} values")
        return count
    if isinstance(saved, int | float) and not isinstance(saved, bool):
        number(saved, -LARGEST, LARGEST)
    elif saved is not None and not isinstance(saved, str | bool):
        raise ValueError("the saved state is no JSON")
    return 1


def check_like(saved: Mapping[str, Any], fresh: Mapping[str, Any]) -> None:
    """Raise ValueError if a saved state is implausible against the fresh state of the same estimator.

    Every square matrix named `..covariance..` must be one, with variances of at most WIDER times the prior
    ones; a vector `mean_m` beside `covariance_m2`, or `X` beside `X_covariance`, may be FAR prior standard
    deviations off. Raises ValueError.
    """
    if not isinstance(saved, Mapping):
        raise ValueError("the saved radii are none")
    for name, prior in fresh.items():
        if "covariance" not in name or not isinstance(prior, list):
            continue
        if name not in saved:
            raise ValueError(f"the saved radii lack {name}")
        variances = np.diag(np.array(prior, dtype=np.float64))
        if name.endswith("_covariance"):
            mean_name = name.removesuffix("_covariance")
        else:
            mean_name = name.replace("covariance", "mean").replace("_m2", "_m")
        covariance(saved[name], WIDER * variances, name)
        if mean_name in fresh and variances.size:
            before = np.array(fresh[mean_name], dtype=np.float64)
            off = vector(saved.get(mean_name), before.size, mean_name) - before
            if np.any(np.abs(off) > FAR * np.sqrt(variances)):
                raise ValueError(f"the saved {mean_name} is beyond its bounds")
    if "informative_s" in fresh and not math.isnan(fresh["informative_s"]):
        number(saved.get("informative_s"), 0.0, LARGEST, "driving time")


def no_wider(spread: FloatArray, most: FloatArray) -> FloatArray:
    """Return a covariance (d, d) shrunk, correlations kept, to variances of at most `most` (d,).

    Every restart widens what was saved; a box whose power fails every ten seconds must not forget more than
    a box that never knew.
    """
    variances = np.maximum(np.diag(spread), 1e-300)
    factor = np.sqrt(np.minimum(most / variances, 1.0))
    return np.asarray(spread * np.outer(factor, factor))
