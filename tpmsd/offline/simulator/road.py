"""Roads as lists of segments, by kind.

In: a kind (`city rural motorway mixed oval test-track hills`), a duration and a Generator. Out: segments
with length, curvature, speed limit and stops, enough for the duration. `tpmsd.offline.simulator.route`
drives a car along them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain, cycle

import numpy as np

KMH = 1 / 3.6


@dataclass(frozen=True, slots=True)
class RoadStyle:
    """Habits of the driver and shape of the land on a kind of road."""

    transition_m: float
    """Length over which curvature builds up (clothoid)."""
    drift_spacing_m: float
    """Distance between the driver's small corrections within the lane."""
    drift_m: float
    """Standard deviation of the place within the lane."""
    lane_change: float
    """Chance of a change of lane per correction."""
    grade_std: float
    """Standard deviation of the slope (its tangent)."""
    grade_spacing_m: float


CITY = RoadStyle(8.0, 30.0, 0.15, 0.0, 0.010, 120.0)
RURAL = RoadStyle(40.0, 60.0, 0.15, 0.0, 0.015, 250.0)
HILLS = RoadStyle(40.0, 60.0, 0.15, 0.0, 0.050, 250.0)
MOTORWAY = RoadStyle(120.0, 120.0, 0.20, 0.06, 0.012, 500.0)
TRACK = RoadStyle(15.0, 60.0, 0.10, 0.0, 0.0, 500.0)


@dataclass(frozen=True, slots=True)
class Segment:
    """A stretch of road of constant curvature but for its transitions."""

    length_m: float
    curvature_per_m: float
    """Positive to the left."""
    limit_mps: float
    style: RoadStyle
    stop_s: float = 0.0
    """Time for which the car stands at the segment's end, s; 0 where it does not stop."""


def _bend_segment(
    angle_rad: float, radius_m: float, limit_mps: float, style: RoadStyle, stop_s: float = 0.0
) -> Segment:
    # The curvature ramps up and down within the segment, so the turned angle is curvature * (length - ramp).
    length = abs(angle_rad) * radius_m + style.transition_m
    return Segment(length, math.copysign(1 / radius_m, angle_rad), limit_mps, style, stop_s)


def _straight_segment(length_m: float, limit_mps: float, style: RoadStyle, stop_s: float = 0.0) -> Segment:
    return Segment(length_m, 0.0, limit_mps, style, stop_s)


def _random_sign(rng: np.random.Generator) -> float:
    return 1.0 if rng.random() < 0.5 else -1.0


def _city_segments(rng: np.random.Generator) -> Iterator[Segment]:
    while True:
        limit = float(rng.choice([30, 50, 50, 60])) * KMH
        for _ in range(int(rng.integers(3, 9))):
            wait = float(rng.uniform(4, 30)) if rng.random() < 0.35 else 0.0
            yield _straight_segment(float(rng.uniform(80, 350)), limit, CITY, wait)
            kind = rng.random()
            if kind < 0.45:
                yield _bend_segment(_random_sign(rng) * math.pi / 2, float(rng.uniform(8, 16)), limit, CITY)
            elif kind < 0.6:  # a roundabout, driven to the second exit: right, left, right
                yield _bend_segment(-0.6, 14.0, limit, CITY)
                yield _bend_segment(1.9, 16.0, limit, CITY)
                yield _bend_segment(-0.6, 16.0, limit, CITY)
            elif kind < 0.85:
                yield _bend_segment(
                    _random_sign(rng) * float(rng.uniform(0.2, 0.8)), float(rng.uniform(50, 160)), limit, CITY
                )


def _rural_segments(rng: np.random.Generator, style: RoadStyle = RURAL) -> Iterator[Segment]:
    while True:
        limit = float(rng.choice([70, 80, 90, 100])) * KMH
        for _ in range(int(rng.integers(6, 14))):
            yield _straight_segment(float(rng.uniform(60, 500)), limit, style)
            yield _bend_segment(
                _random_sign(rng) * float(rng.uniform(0.15, 1.1)), float(rng.uniform(90, 600)), limit, style
            )
        if rng.random() < 0.5:  # a village
            yield _straight_segment(float(rng.uniform(300, 900)), 50 * KMH, style)
        if rng.random() < 0.4:  # a junction
            yield _straight_segment(float(rng.uniform(60, 150)), 60 * KMH, style, float(rng.uniform(3, 15)))
            yield _bend_segment(_random_sign(rng) * math.pi / 2, 18.0, 40 * KMH, style)


def _motorway_segments(rng: np.random.Generator) -> Iterator[Segment]:
    yield _straight_segment(200.0, 60 * KMH, RURAL)
    yield _bend_segment(_random_sign(rng) * 1.9, 70.0, 60 * KMH, RURAL)
    while True:
        limit = float(rng.choice([80, 100, 100, 120, 120, 130])) * KMH
        for _ in range(int(rng.integers(2, 5))):
            traffic = float(rng.uniform(0.65, 0.9)) if rng.random() < 0.2 else 1.0
            yield _straight_segment(float(rng.uniform(300, 1500)), limit * traffic, MOTORWAY)
            radius = float(rng.uniform(800, 4000))
            yield _bend_segment(
                _random_sign(rng) * float(rng.uniform(0.1, 0.6)), radius, limit * traffic, MOTORWAY
            )


def _oval_segments(rng: np.random.Generator) -> Iterator[Segment]:
    side = _random_sign(rng)
    while True:
        limit = float(rng.uniform(12, 22))
        for _ in range(2):
            yield _straight_segment(400.0, limit, TRACK)
            yield _bend_segment(side * math.pi, 110.0, limit, TRACK)


# About 2.2 km with a dozen bends, like the track of the published experiment: (straight m, bend deg, radius
# m).
_LAP = (
    (180.0, 80.0, 60.0),
    (60.0, -55.0, 70.0),
    (90.0, 75.0, 45.0),
    (140.0, 60.0, 60.0),
    (70.0, -90.0, 50.0),
    (60.0, 100.0, 50.0),
    (210.0, 70.0, 60.0),
    (50.0, -40.0, 80.0),
    (60.0, 65.0, 60.0),
    (120.0, -60.0, 60.0),
    (70.0, 95.0, 45.0),
    (150.0, 60.0, 70.0),
)


def _test_track_segments(rng: np.random.Generator) -> Iterator[Segment]:
    for straight, angle, radius in cycle(_LAP):
        limit = 60 * KMH * float(rng.uniform(0.95, 1.05))
        yield _straight_segment(straight, limit, TRACK)
        yield _bend_segment(math.radians(angle), radius, limit, TRACK)


def _hill_segments(rng: np.random.Generator) -> Iterator[Segment]:
    return _rural_segments(rng, HILLS)


def _mixed_segments(rng: np.random.Generator, duration_s: float) -> Iterator[Segment]:
    """Yield a fifth in a city, then 0.3 rural, 0.3 motorway and 0.1 rural of the time; the rest in a city."""
    for kind, share in (
        (_city_segments, 0.2),
        (_rural_segments, 0.3),
        (_motorway_segments, 0.3),
        (_rural_segments, 0.1),
    ):
        yield from _until_duration(kind(rng), duration_s * share)
    yield from _city_segments(rng)


_KINDS: dict[str, Callable[[np.random.Generator], Iterator[Segment]]] = {
    "city": _city_segments,
    "rural": _rural_segments,
    "motorway": _motorway_segments,
    "oval": _oval_segments,
    "test-track": _test_track_segments,
    "hills": _hill_segments,
}
ROUTE_KINDS = ("city", "rural", "motorway", "mixed", "oval", "test-track", "hills")


def make_road(kind: str, duration_s: float, rng: np.random.Generator) -> list[Segment]:
    """Return segments that take at least `duration_s` to drive at up to 1.15 times their limits."""
    segments = _mixed_segments(rng, duration_s) if kind == "mixed" else _KINDS[kind](rng)
    first = next(segments)
    away = _straight_segment(60.0, 50 * KMH, first.style)  # setting off, before the first bend
    return list(_until_duration(chain([away, first], segments), 1.15 * duration_s + 10.0))


def _until_duration(segments: Iterator[Segment], duration_s: float) -> Iterator[Segment]:
    """Yield segments until their duration at their limits reaches `duration_s`."""
    total = 0.0
    for segment in segments:
        yield segment
        total += segment.length_m / segment.limit_mps + segment.stop_s
        if total >= duration_s:
            return
