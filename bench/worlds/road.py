"""A made-up road and the driver on it.

In: `Spec` and a generator. Out: speed, curvature and slope every 20 ms.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bench.worlds.spec import Spec

Array = NDArray[np.float64]
STEP_S = 0.02
LEGS_MPS = {"mixed": (9, 33), "rural": (12, 27), "motorway": (20, 38), "city": (6, 16), "hills": (10, 28)}
"""Slowest and fastest leg."""


def profile(spec: Spec, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Speed (m/s), curvature (1/m, left positive) and slope over time."""
    n = round(spec.duration_s / STEP_S)
    target = _targets(spec, rng, n)
    bend = np.zeros(n)
    k = 0
    while k < n:
        length = round(float(rng.uniform(4, 18)) / STEP_S)
        if rng.random() < 0.6:
            # lateral acceleration up to 2 m/s2 at the leg's speed
            a_lat = float(rng.uniform(0.3, 2.2)) * float(rng.choice([-1, 1]))
            shape = np.sin(np.linspace(0, math.pi, min(length, n - k))) ** 2
            bend[k : k + length] = a_lat * shape / max(target[k], 6.0) ** 2
        k += length
    speed = _followed(target, float(rng.uniform(1.0, 2.0)), float(rng.uniform(1.2, 2.5)))
    slope = np.zeros(n)
    if spec.hilly > 0:
        distance = np.cumsum(speed) * STEP_S
        knots = np.arange(0.0, distance[-1] + 800.0, 300.0)
        slope = CubicSpline(knots, rng.normal(0, spec.hilly, len(knots)))(distance)
        slope = np.clip(slope + np.where(distance < 0.5 * distance[-1], spec.climb, -spec.climb), -0.15, 0.15)
    return speed, bend, slope


def _targets(spec: Spec, rng: np.random.Generator, n: int) -> Array:
    legs = LEGS_MPS[spec.road]
    target = np.empty(n)
    k = 0
    while k < n:
        length = round(float(rng.uniform(12, 45)) / STEP_S)
        v = float(rng.uniform(*legs))
        if spec.rising_speed:
            v = legs[0] + (legs[1] - legs[0]) * k / n + float(rng.normal(0, 1.5))
        if spec.steady:
            v = 0.5 * sum(legs)
        v = max(v, 4.0)
        if spec.stops and rng.random() < 0.12:
            v, length = 0.0, round(float(rng.uniform(10, 35)) / STEP_S)
        target[k : k + length] = v
        k += length
    return target


def _followed(target: Array, up: float, down: float) -> Array:
    """A car follows its target speed with bounded acceleration and smooth jerk."""
    speed: list[float] = []
    v, a = 0.0, 0.0
    for wanted in target.tolist():
        want = min(max((wanted - v) * 0.35, -down), up * max(0.15, 1 - v / 55))
        a += (want - a) * STEP_S / 0.6
        v = max(v + a * STEP_S, 0.0)
        speed.append(v)
    return np.array(speed)
