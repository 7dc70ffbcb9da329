"""A series of readings without its white noise.

In: times and readings, NaN where there is none. Out: the likeliest smooth series, interpolated at every time.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solveh_banded

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.drive import filled
from tpmsd.offline.dynamics.noise import white_noise

MIN_NOISE = 1e-5
"""Noise over the series' range below which it is taken as it is: the readings of a simulator, rounded."""


def smooth_series(time_s: FloatArray, values: FloatArray, rate_walk: float) -> FloatArray:
    """Return the most likely (n,) series behind readings with white noise, if its rate is a random walk.

    It minimises sum (y - x)^2 / R + sum h (slope change / h)^2 / q, with R by fourth differences, q the
    square of `rate_walk` (unit of the rate per square root of a second) and h the mean of two steps: the
    fixed-interval smoother of an integrated random walk [Whittaker 1923]. It delays nothing.
    """
    known = np.isfinite(values)
    time, readings = time_s[known], values[known]
    noise = white_noise(readings)
    if noise <= MIN_NOISE * float(np.ptp(readings) if len(readings) else 0.0):
        return filled(time_s, values)
    h = np.diff(time)
    between = 0.5 * (h[:-1] + h[1:])
    bend = np.stack([1.0 / h[:-1], -1.0 / h[:-1] - 1.0 / h[1:], 1.0 / h[1:]])
    weight = (noise / rate_walk) ** 2 / between
    band = np.zeros((3, len(readings)))
    band[2] = 1.0
    for i in range(3):
        for j in range(i + 1):
            band[2 - (i - j), i : len(h) - 1 + i] += weight * bend[i] * bend[j]
    smooth = solveh_banded(band, readings, check_finite=False)
    return np.asarray(np.interp(time_s, time, smooth))
