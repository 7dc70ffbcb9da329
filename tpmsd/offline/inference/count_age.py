"""The age of the counts, as far as all wheels share it, taken out of a recording.

In: a `Recording`. Out: the same one less a common age, or the very same where there is none.

A count on the bus may be that of the control unit's last own reading of the rings, up to 20 ms before the
stamp, in a rhythm that beats against the frames. A common age a(t) makes the distance of all wheels v * a
shorter at once, which at 25 m/s is half a metre: far more than the counts resolve. It acts as a white error
of the stamps.

Its size is estimated from third differences of the distance D that the wheels have rolled in the mean. Those
of a car that moves with jerk j are j * dt^3, a millimetre in 0.1 s; an error of standard deviation s of each
D makes sqrt(20) * s. What is beyond the counts' own resolution and grows with speed is age. The distance
itself is then smoothed by penalised least squares (Whittaker, Proceedings of the Edinburgh Mathematical
Society 41, 1923):

    sum (S - D)^2 / (r^2 + (s v)^2) + sum (third difference of S)^2 / (j dt^3)^2 -> min,

and (S - D) / v is the age, less its mean: a constant age is one of the fixes, and is left to the diagnosis.
A slow sweep of the age (seconds) looks like a speed and stays, but for its jumps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.linalg import solveh_banded

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.recording import Recording

LONGEST_S = 0.02
"""Age of a count: the slowest usual task of a control unit that reads its counters."""
MIN_STD_S = 1e-3
"""Below, the stamps' own jitter is as large, and every drive's noise holds it: 0.4 to 0.8 ms on the real
recordings at hand."""
JERK_MPS3 = 1.0
"""Root mean square in driving, traffic included."""
FAST_MPS = 5.0
"""Speed from which an age is estimated: below, a count is longer than what an age makes."""
FEWEST = 600
"""Ticks at such a speed: a minute."""
DIFFERENCE = np.array([-1.0, 3.0, -3.0, 1.0])
"""Third difference."""
POWER = float(DIFFERENCE @ DIFFERENCE)
"""Variance of the third differences of white noise over its own, 20."""
SPEED_TICKS = 11
"""Over which a speed is the mean: longer than the frames' beat, shorter than a manoeuvre."""


@dataclass(frozen=True)
class CommonAge:
    """Age of counts that all wheels share."""

    std_s: float
    """Standard deviation."""
    age_s: FloatArray
    """(n + 1,) at the ticks' edges, less its mean; 0 where it is not estimated."""


def without_common_age(recording: Recording) -> Recording:
    """Return the recording with each wheel's angle at the time of its stamp; unchanged without a common
    age."""
    age = common_age(recording)
    if age is None:
        return recording
    rate = np.stack([smooth(turn) for turn in recording.rotation_rad.T], axis=1) / recording.dt_s
    at_edges = np.concatenate([rate[:1], 0.5 * (rate[1:] + rate[:-1]), rate[-1:]])
    late = np.nan_to_num(at_edges) * age.age_s[:, None]
    return replace(recording, rotation_rad=recording.rotation_rad + np.diff(late, axis=0))


def common_age(recording: Recording) -> CommonAge | None:
    """Return the age that all counters of a drive share; None if it is not identifiable, as of speed
    signals."""
    wheels = recording.wheels
    if len(wheels) < 2 or not bool(np.all(recording.quantum_rad[wheels] > 0.0)):
        return None
    radius_m = recording.car.radius_m[wheels]
    distance_m = (recording.rotation_rad[:, wheels] * radius_m).mean(axis=1)
    speed = smooth(distance_m) / recording.dt_s
    read_m = float(np.sqrt(np.mean((recording.quantum_rad[wheels] * radius_m) ** 2) / (2 * len(wheels))))
    std_s = _age_std_s(distance_m, speed, read_m)
    if not MIN_STD_S < std_s < LONGEST_S:
        return None
    age = np.zeros(recording.ticks + 1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], np.isfinite(distance_m), [False]]).astype(int)))
    known = np.zeros(len(age), dtype=np.bool_)
    for start, end in edges.reshape(-1, 2):
        if end - start < SPEED_TICKS:
            continue
        here = slice(start, end + 1)
        v = speed[start:end]
        v = np.concatenate([v[:1], 0.5 * (v[1:] + v[:-1]), v[-1:]])
        shown = np.concatenate([[0.0], np.cumsum(distance_m[start:end])])
        rolled = _smoothed_distance(shown, np.hypot(read_m, std_s * v), JERK_MPS3 * recording.dt_s**3)
        fast = v > FAST_MPS
        age[here][fast] = (rolled - shown)[fast] / v[fast]
        known[here] |= fast
    if not known.any():
        return None
    middle = float(np.median(age[known]))
    age[known] = np.clip(age[known] - middle, -LONGEST_S, LONGEST_S)
    return CommonAge(std_s, age)


def _age_std_s(distance_m: FloatArray, speed: FloatArray, read_m: float) -> float:
    """Return the standard deviation of the age (s) by the third differences of the distance; 0 for too short
    a drive."""
    third = np.convolve(distance_m, [1.0, -2.0, 1.0], mode="valid")
    v = speed[1:-1]
    fast = np.isfinite(third) & (v > FAST_MPS)
    if fast.sum() < FEWEST:
        return 0.0
    bounds = np.quantile(v[fast], np.linspace(0.0, 1.0, 6))
    squares, speeds = [], []
    for low, high in pairwise(bounds):
        inside = fast & (v >= low) & (v <= high)
        most = math.sqrt(POWER) * LONGEST_S * v[inside]  # beyond, a count was lost or a wheel slipped
        mean = float(np.mean(np.minimum(third[inside] ** 2, most**2)))
        squares.append(mean / POWER - read_m**2)
        speeds.append(float(np.mean(v[inside] ** 2)))
    return float(np.sqrt(max(np.median(np.array(squares) / np.array(speeds)), 0.0)))


def _smoothed_distance(shown: FloatArray, std: FloatArray, third_m: float) -> FloatArray:
    """Return the (m,) distance that the car has rolled, smoothed from the counters' (m,) by third differences
    of `third_m` and errors of `std`."""
    n = len(shown)
    weight, stiff = (third_m / std) ** 2, np.zeros((4, n))
    for k, factor in enumerate(DIFFERENCE):
        for j in range(k + 1):
            # Row of the upper band: entry (i, i + k - j) of D' D.
            stiff[3 - (k - j), k : n - 3 + k] += factor * DIFFERENCE[j]
    stiff[3] += weight
    return np.asarray(solveh_banded(stiff, weight * shown))


def smooth(values: FloatArray) -> FloatArray:
    """Return the (n,) running mean over `SPEED_TICKS` of the finite values; NaN stays NaN."""
    known = np.isfinite(values)
    box = np.ones(SPEED_TICKS)
    count = np.convolve(known, box, mode="same")
    total = np.convolve(np.where(known, values, 0.0), box, mode="same")
    return np.where(known, total / np.maximum(count, 1.0), np.nan)
