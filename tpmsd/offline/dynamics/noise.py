"""The noise that a path is estimated with: white steps of the states, disturbances, errors of the outputs.

In: standard deviations. Out: `PathNoise`, and a first guess of it from a recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.settings import SETTINGS


@dataclass(frozen=True, slots=True)
class PathNoise:
    """Standard deviations."""

    white: FloatArray
    """(s,) random walk of the baseline's states per square root of a second."""
    disturbance: FloatArray
    """(d,) stationary standard deviation of the disturbances."""
    outputs: FloatArray
    """(m,) of one reading of each output."""

    def step_variance(self, dt_s: FloatArray) -> FloatArray:
        """Return the variances of one step, (n, s + d)."""
        decay = np.exp(-2.0 * dt_s / SETTINGS.disturbance_time_s)
        return np.concatenate(
            [self.white**2 * dt_s[:, None], self.disturbance**2 * (1.0 - decay)[:, None]], axis=1
        )


def least(states: Sequence[str], disturbances: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Return the least white and disturbance standard deviations of these states and disturbances."""
    white = dict(zip(("v", "r", "u"), SETTINGS.min_white, strict=True))
    free = dict(zip(("force_x", "force_y", "moment"), SETTINGS.min_disturbance, strict=True))
    return (
        np.array([white.get(name, SETTINGS.min_other) for name in states]),
        np.array([free[name] for name in disturbances]),
    )


def first_guess(
    states: Sequence[str], disturbances: Sequence[str], readings: Sequence[FloatArray]
) -> PathNoise:
    """Return a noise to start from: outputs by their second differences, the rest plainly too large."""
    white, free = least(states, disturbances)
    outputs = [max(white_noise(values), 1e-6) for values in readings]
    return PathNoise(10.0 * white, 100.0 * free, np.array(outputs))


def white_noise(values: FloatArray) -> float:
    """Return the standard deviation of a reading's white noise, by its fourth differences.

    Those of white noise have 70 times its variance; motion of a car is too slow to have any. The median makes
    the estimate that of the quiet parts.
    """
    known = values[np.isfinite(values)]
    if len(known) < 20:
        return 0.0
    bend = np.abs(np.diff(known, 4))
    return float(np.median(bend) / (0.6745 * np.sqrt(70.0)))
