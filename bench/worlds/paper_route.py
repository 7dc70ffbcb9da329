"""An 18 min, 12 km drive like Lundquist et al.'s (2013): town, small rural road, highway, town; clockwise.

In: nothing (plain numbers). Out: `Route`: where a rigid car is and what its wheels have rolled, every 10
ms. It imports nothing of the program; a path is a curvature over its length, a drive is that length over
time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEP_S = 0.01
GRID_M = 0.25
LENGTH_M = 12_000.0
DURATION_S = 1080.0
TRACK_M = 1.52
WHEELBASE_M = 2.63
ACCEL_MPS2 = 1.4
BRAKE_MPS2 = 1.8
MAX_LATERAL_MPS2 = 2.5
CREEP_MPS = 0.4

STRETCHES: tuple[tuple[float, float, tuple[float, ...], bool], ...] = (
    # length m, wanted speed m/s, bends (rad, left positive) evenly placed, whether it ends at a stop
    (250.0, 11.0, (-0.4,), True),
    (450.0, 12.5, (0.6, -1.1), True),
    (700.0, 13.5, (-1.2, 0.5), False),
    (3900.0, 18.0, (0.5, -0.9, 0.7, -0.6, 0.9, -1.3, 0.8, -0.7, 0.6, -1.2), True),
    (3400.0, 25.0, (-0.25, 0.15, -0.3), False),
    (300.0, 12.0, (-1.2,), True),
    (900.0, 13.5, (0.4, -0.5, 0.9, -1.0), True),
    (500.0, 12.0, (-1.4,), True),
    (550.0, 13.0, (1.2, -1.2), True),
    (400.0, 12.0, (-1.2,), True),
    (650.0, 13.0, (1.3, -1.3, 0.3), True),
)
"""Scaled to 12 km; the stops last so long that the drive takes 18 min."""
WIGGLE_PER_M = 3e-4
"""Curvature that the driver adds by never driving quite straight."""


@dataclass(frozen=True)
class Route:
    """Arrays over n instants, every 10 ms; the reference point is the middle of the rear axle."""

    time_s: Array
    speed_mps: Array
    heading_rad: Array
    """Mathematical angle, not wrapped."""
    east_m: Array
    north_m: Array
    rolled_m: Array
    """(n, 4) way that each wheel (fl fr rl rr) has rolled."""


def _bend(place: Array, middle: float, angle: float, length: float) -> Array:
    """A bend of raised-cosine curvature."""
    u = np.clip((place - middle) / length, -0.5, 0.5)
    return np.asarray(angle / length * (1.0 + np.cos(2 * math.pi * u)) * (np.abs(u) < 0.5))


def _path() -> tuple[Array, Array, Array, list[float]]:
    """Curvature and wanted speed over the place, and the places of the stops."""
    scale = LENGTH_M / sum(stretch[0] for stretch in STRETCHES)
    place = np.arange(0.0, LENGTH_M + GRID_M / 2, GRID_M)
    bend, wanted = np.zeros_like(place), np.zeros_like(place)
    stops, begin = [], 0.0
    for length, speed, bends, ends_at_stop in STRETCHES:
        end = begin + length * scale
        inside = (place >= begin) & (place <= end)
        wanted[inside] = speed
        room = (end - begin) / len(bends)
        for k, angle in enumerate(bends):
            # town corners are short, bends of fast roads long
            size = min(0.7 * room, abs(angle) * speed**2 / 1.5 + 20.0)
            bend += _bend(place, begin + (k + 0.5) * room, angle, size)
        if ends_at_stop:
            stops.append(end)
        begin = end
    wanted *= 1.0 + 0.04 * np.sin(2 * math.pi * place / 310.0) + 0.02 * np.sin(2 * math.pi * place / 97.0)
    for wave, phase in ((37.0, 0.3), (83.0, 1.9), (211.0, 4.0)):
        bend += WIGGLE_PER_M / 2 * np.sin(2 * math.pi * place / wave + phase)
    return place, bend, wanted, stops


def _speeds(bend: Array, wanted: Array, stops: list[float]) -> Array:
    """Speed over the place: what bends, stops, engine and brakes allow."""
    speed = np.minimum(wanted, np.sqrt(MAX_LATERAL_MPS2 / np.maximum(np.abs(bend), 1e-4)))
    speed[[0, -1]] = CREEP_MPS
    for stop in stops:
        speed[min(round(stop / GRID_M), speed.size - 1)] = CREEP_MPS
    for k in range(1, speed.size):
        speed[k] = min(speed[k], math.sqrt(speed[k - 1] ** 2 + 2 * ACCEL_MPS2 * GRID_M))
    for k in range(speed.size - 2, -1, -1):
        speed[k] = min(speed[k], math.sqrt(speed[k + 1] ** 2 + 2 * BRAKE_MPS2 * GRID_M))
    return speed


def _integral(values: Array, step: float) -> Array:
    return np.concatenate([[0.0], np.cumsum((values[1:] + values[:-1]) / 2 * step)])


@lru_cache(maxsize=1)
def paper_route() -> Route:
    """The drive, the same every time."""
    place, bend, wanted, stops = _path()
    speed = _speeds(bend, wanted, stops)
    clock = np.concatenate([[0.0], np.cumsum(2 * GRID_M / (speed[1:] + speed[:-1]))])
    # The time that is left is spent at the stops, and before the start.
    dwell = (DURATION_S - clock[-1]) / (len(stops) + 1)
    if dwell <= 0.0:
        raise ValueError("the drive takes longer than it may")
    times, places = [0.0, dwell], [0.0, 0.0]
    late = dwell
    for k in range(1, place.size):
        times.append(clock[k] + late)
        places.append(place[k])
        if any(abs(place[k] - stop) < GRID_M / 2 for stop in stops):
            late += dwell
            times.append(clock[k] + late)
            places.append(place[k])
    time_s: Array = np.arange(round(DURATION_S / STEP_S) + 1, dtype=np.float64) * STEP_S
    at = np.interp(time_s, times, places)
    turned = _integral(bend, GRID_M)
    heading = 0.4 + turned
    path_east, path_north = _integral(np.cos(heading), GRID_M), _integral(np.sin(heading), GRID_M)
    half = TRACK_M / 2
    # A rigid car on the path: rear wheels run parallel to it, front hubs on their own, longer ways.
    rolled = [
        _integral(np.hypot(1.0 - bend * half, bend * WHEELBASE_M), GRID_M),
        _integral(np.hypot(1.0 + bend * half, bend * WHEELBASE_M), GRID_M),
        place - turned * half,
        place + turned * half,
    ]
    moving = np.gradient(at, STEP_S)
    return Route(
        time_s=time_s,
        speed_mps=moving,
        heading_rad=np.interp(at, place, heading),
        east_m=np.interp(at, place, path_east),
        north_m=np.interp(at, place, path_north),
        rolled_m=np.stack([np.interp(at, place, each) for each in rolled], axis=1),
    )
