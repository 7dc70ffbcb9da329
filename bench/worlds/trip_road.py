"""Roads and the driver on them: speed, curvature and slope over time.

In: the kind of road, how long, a generator. Out: `Profile` every 20 ms.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from bench.worlds.instruments import markov
from bench.worlds.magic_tyre import Array

STEP_S = 0.02
COARSE = 5
"""The driver decides every 0.1 s."""


@dataclass(frozen=True)
class Road:
    """A kind of road."""

    legs_mps: tuple[float, float]
    leg_s: tuple[float, float]
    stops: float = 0.0
    """Probability of a stop after a leg."""
    bends: float = 0.5
    """Share of the time in bends."""
    lateral_mps2: float = 2.2
    slope: float = 0.01
    """Standard deviation of the slope."""
    turns: float = 0.0
    """Probability that a leg ends in a turn, a roundabout or a parking lot, at walking speed."""


ROADS = {
    "city": Road((7.0, 15.0), (8.0, 40.0), stops=0.3, turns=0.35, bends=0.25),
    "rural": Road((15.0, 27.0), (15.0, 80.0), stops=0.05, turns=0.12, slope=0.02),
    "motorway": Road((25.0, 38.0), (40.0, 240.0), bends=0.35, lateral_mps2=1.5, slope=0.012),
    "hills": Road((11.0, 24.0), (15.0, 60.0), stops=0.03, bends=0.7, lateral_mps2=3.0, slope=0.05),
    "track": Road((14.5, 27.0), (30.0, 120.0), bends=0.4, slope=0.004),
    "zone": Road((6.0, 9.0), (8.0, 40.0), stops=0.2, turns=0.3, bends=0.25),
    "parking": Road((2.0, 6.0), (5.0, 15.0), stops=0.4, turns=0.8),
    "roundabouts": Road((10.0, 17.0), (8.0, 25.0), turns=1.0),
    # the held-out half's own
    "alpine": Road(
        (8.0, 19.0), (10.0, 35.0), stops=0.02, bends=0.85, lateral_mps2=3.5, slope=0.07, turns=0.15
    ),
    "autobahn": Road((28.0, 46.0), (30.0, 150.0), bends=0.3, lateral_mps2=1.8, slope=0.02),
    "suburb": Road((8.0, 20.0), (10.0, 50.0), stops=0.2, turns=0.2),
    "coast": Road((13.0, 25.0), (12.0, 50.0), bends=0.75, lateral_mps2=2.6, slope=0.025, turns=0.1),
}
POOL_ROADS = {
    "development": ("city", "rural", "motorway", "hills"),
    "held-out": ("suburb", "coast", "autobahn", "alpine"),
}


@dataclass(frozen=True)
class Profile:
    """(n,) each, every 20 ms."""

    speed: Array
    bend: Array
    """Curvature, left positive, 1/m."""
    slope: Array


def profile(
    kind: str,
    duration_s: float,
    rng: np.random.Generator,
    limit_mps: float = 99.0,
    lateral_mps2: float | None = None,
    stop: bool = False,
) -> Profile:
    """Drive the road for that long, never faster than the limit; `stop`: come to rest at the end."""
    road = ROADS[kind]
    if lateral_mps2 is not None:
        road = replace(road, lateral_mps2=lateral_mps2)
    n = round(duration_s / (STEP_S * COARSE))
    target, curvature = np.empty(n), np.zeros(n)
    k = 0
    while k < n:
        long = round(float(rng.uniform(*road.leg_s)) * 10)
        target[k : k + long] = min(float(rng.uniform(*road.legs_mps)), limit_mps)
        k += long
        if rng.random() < road.stops:
            long = round(float(rng.uniform(5.0, 30.0)) * 10)
            target[k : k + long] = 0.0
            k += long
        elif rng.random() < road.turns:
            radius = float(rng.uniform(7.0, 18.0))
            long = round(float(rng.uniform(0.4, 1.6)) * np.pi * radius / 5.0 * 10)
            slow = float(rng.uniform(3.5, 5.5))
            target[k : k + long + 30] = min(slow, limit_mps)
            side = float(rng.choice([-1.0, 1.0]))
            curvature[k + 30 : k + 30 + long] = side / radius
            k += long + 30
    if stop:
        target[-300:], curvature[-300:] = 0.0, 0.0
    speed = _followed(target.tolist(), float(rng.uniform(1.0, 1.8)), float(rng.uniform(1.2, 2.4)))
    curvature = gaussian_filter1d(curvature, 8.0) + _bends(road, speed, rng)
    fine = np.arange(n * COARSE) * STEP_S
    coarse = np.arange(n) * STEP_S * COARSE
    speed = np.maximum(np.interp(fine, coarse, gaussian_filter1d(speed, 4.0)), 0.0)
    bend = np.interp(fine, coarse, curvature) + markov(rng, len(fine), STEP_S, 2e-4, 3.0)
    tightest = np.minimum(0.15, 6.0 / np.maximum(speed, 1.0) ** 2)
    return Profile(speed, np.clip(bend, -tightest, tightest), _slopes(road, speed, rng))


def _bends(road: Road, speed: Array, rng: np.random.Generator) -> Array:
    out = np.zeros(len(speed))
    k = 0
    while k < len(speed):
        long = int(rng.uniform(30, 140))
        if rng.random() < road.bends:
            lateral = float(rng.uniform(0.2, road.lateral_mps2)) * float(rng.choice([-1.0, 1.0]))
            piece = speed[k : k + long]
            shape = np.sin(np.linspace(0.0, np.pi, len(piece))) ** 2
            out[k : k + long] = lateral * shape / np.maximum(piece, 7.0) ** 2
        k += long
    return out


def _slopes(road: Road, speed: Array, rng: np.random.Generator) -> Array:
    distance = np.cumsum(speed) * STEP_S
    knots = np.arange(0.0, distance[-1] + 1200.0, 400.0)
    return np.asarray(
        np.clip(CubicSpline(knots, rng.normal(0.0, road.slope, len(knots)))(distance), -0.16, 0.16)
    )


def _followed(target: list[float], up: float, down: float) -> Array:
    """A driver who follows a target speed with bounded acceleration and jerk."""
    out: list[float] = []
    v = a = 0.0
    step = STEP_S * COARSE
    for wanted in target:
        want = min(max((wanted - v) * 0.35, -down), up * max(0.15, 1.0 - v / 60.0))
        a += (want - a) * step / 0.6
        v = max(v + a * step, 0.0)
        out.append(v)
    return np.array(out)
