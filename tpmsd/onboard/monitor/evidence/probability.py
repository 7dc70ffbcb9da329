"""Normal and chi-square distributions for plain numbers, as the monitor needs them.

In: numbers. Out: probabilities and quantiles. scipy.special has both, but to import it takes a quarter of the
daemon's start and keeps 20 MB of memory.
"""

from __future__ import annotations

import math

MAX_STEPS = 60
"""Steps of Newton's method at most; it comes from below, where the density is larger, and takes some steps
far out.
"""


def normal_cdf(z: float) -> float:
    """Return the probability that a standard normal variable is at most z."""
    return 0.5 * math.erfc(-z / math.sqrt(2.0))


def chi_square_cdf(x: float, freedom: int) -> float:
    """Return the probability that `freedom` squared standard normal variables add up to at most x >= 0: the
    regularised lower incomplete gamma function by its series (Abramowitz and Stegun 1964, 6.5.29)."""
    shape, half = 0.5 * freedom, 0.5 * x
    if half <= 0.0:
        return 0.0
    term = total = math.exp(shape * math.log(half) - half - math.lgamma(shape + 1.0))
    while term > 1e-17 * total:
        shape += 1.0
        term *= half / shape
        total += term
    return total


def chi_square_quantile(probability: float, freedom: int) -> float:
    """Return the x of a `chi_square_cdf`, 0.5 <= probability < 1: Newton's method from the cube of a normal
    quantile (Wilson and Hilferty 1931).
    """
    z = math.sqrt(-2.0 * math.log(2.0 * (1.0 - probability)))
    x = freedom * (1.0 - 2.0 / (9.0 * freedom) + z * math.sqrt(2.0 / (9.0 * freedom))) ** 3
    shape = 0.5 * freedom
    for _ in range(MAX_STEPS):
        density = 0.5 * math.exp((shape - 1.0) * math.log(0.5 * x) - 0.5 * x - math.lgamma(shape))
        step = max((probability - chi_square_cdf(x, freedom)) / density, -0.5 * x)
        x += step
        if abs(step) < 1e-14 * x:
            break
    return x
