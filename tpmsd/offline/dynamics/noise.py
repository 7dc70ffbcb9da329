"""The noise that a path is estimated with: white steps of the states, disturbances, errors of the outputs.

In: standard deviations. Out: `PathNoise`, and a first guess of it from a recording.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.settings import SETTINGS


@dataclass(frozen=True, slots=True)
class PathNoise:
    """Standard deviations."""

    states: tuple[str, ...]
    """Names of the states."""
    white: FloatArray
    """(s,) random walk of the states per square root of a second."""
    start: FloatArray
    """(s,) of the states at the start of a block."""
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

    def for_states(self, states: Sequence[str], other: PathNoise | None = None) -> PathNoise:
        """Return the noise for these states, from `other` for those that this one lacks."""
        known: dict[str, tuple[float, float]] = {}
        for one in (self,) if other is None else (other, self):
            known.update(zip(one.states, zip(one.white, one.start, strict=True), strict=True))
        white, start = np.array([known[name] for name in states]).T
        return replace(self, states=tuple(states), white=white, start=start)


def least_noise(sizes: Mapping[str, float], disturbances: Sequence[str], outputs: FloatArray) -> PathNoise:
    """Return the lower bounds of the noise, for states of these sizes and these disturbances and outputs."""
    white = dict(zip(("v", "r", "u"), SETTINGS.min_white, strict=True))
    start = dict(zip(("v", "r", "u"), SETTINGS.start_std, strict=True))
    free = dict(zip(("force_x", "force_y", "moment"), SETTINGS.min_disturbance, strict=True))
    return PathNoise(
        tuple(sizes),
        np.array([white.get(name, SETTINGS.min_other * size) for name, size in sizes.items()]),
        np.array([start.get(name, size) for name, size in sizes.items()]),
        np.array([free[name] for name in disturbances]),
        outputs,
    )


def initial_noise(
    sizes: Mapping[str, float], disturbances: Sequence[str], readings: Sequence[FloatArray]
) -> PathNoise:
    """Return a starting noise: outputs by their second differences, the rest on purpose too large."""
    outputs = np.array([max(white_noise(values), 1e-6) for values in readings])
    low = least_noise(sizes, disturbances, outputs)
    return replace(low, white=10.0 * low.white, disturbance=100.0 * low.disturbance)


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
