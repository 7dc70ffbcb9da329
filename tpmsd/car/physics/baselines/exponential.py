"""One step of states of which some follow what drives them within a fraction of it.

In: rates as a function, rate constants. Out: the states after the step. Exponential Runge-Kutta of fourth
order ([Cox 2002], equations (26) to (29)): exact for x' = -k x, and Runge-Kutta's method where k is 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from tpmsd.foundation.wheels import FloatArray

MAX_DECAY = 5.0
"""Largest rate constant times step: slip angles that follow within 1 to 50 ms are exact to a few millionths
of a radian on steps of 20 ms, a tenth of what a recording's rounding makes of them."""
_SERIES = 12
"""Terms of the series of small exponents: 1e-16 at 1."""


def exponential_step(
    x: FloatArray,
    first: FloatArray,
    rates: Callable[[FloatArray, float], FloatArray],
    h: FloatArray,
    decays: Mapping[int, FloatArray],
) -> FloatArray:
    """Return the states (..., n) after a step of `h` seconds, (..., 1), by the exponential method.

    `first` are the rates at its start, `rates` takes states and a fraction of it; `decays` are the rate
    constants (...) of the columns that have one.
    """
    k = np.zeros((*np.broadcast_shapes(x.shape[:-1], *map(np.shape, decays.values())), x.shape[-1]))
    for column, constant in decays.items():
        k[..., column] = constant
    half, whole = _Weights(-0.5 * h * k, decays), _Weights(-h * k, decays)
    a = 0.5 * h * half.one * first
    second = rates(x + a, 0.5) + k * a
    b = 0.5 * h * half.one * second
    third = rates(x + b, 0.5) + k * b
    c = half.power * a + 0.5 * h * half.one * (2.0 * third - first)
    last = rates(x + c, 1.0) + k * c
    one, two, three = whole.one, whole.two, whole.three
    start, end = one - 3.0 * two + 4.0 * three, 4.0 * three - two
    middle = 2.0 * (two - 2.0 * three)
    return np.asarray(x + h * (start * first + middle * (second + third) + end * last))


class _Weights:
    """Weights exp(z), phi_1 = (exp(z) - 1) / z, phi_2 = (phi_1 - 1) / z and phi_3 = (phi_2 - 1/2) / z."""

    def __init__(self, z: FloatArray, columns: Mapping[int, FloatArray]) -> None:
        self.power, self.one = np.ones(z.shape), np.ones(z.shape)
        self.two, self.three = np.full(z.shape, 1.0 / 2.0), np.full(z.shape, 1.0 / 6.0)
        for column in columns:
            own = z[..., column]
            small = own > -1.0
            by = np.where(small, 1.0, own)
            three = np.where(small, _phi_3_by_series(np.where(small, own, 0.0)), 0.0)
            power = np.exp(own)
            one = np.where(small, 1.0 + own * (0.5 + own * three), (power - 1.0) / by)
            two = np.where(small, 0.5 + own * three, (one - 1.0) / by)
            self.power[..., column], self.one[..., column], self.two[..., column] = power, one, two
            self.three[..., column] = np.where(small, three, (two - 0.5) / by)


def _phi_3_by_series(z: FloatArray) -> FloatArray:
    """Return phi_3 of small exponents: the sum of z^k / (k + 3)!."""
    out = np.zeros_like(z)
    for k in range(_SERIES, -1, -1):
        out = out * z + 1.0 / math.factorial(k + 3)
    return out
