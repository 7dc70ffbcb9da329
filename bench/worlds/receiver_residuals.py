"""A receiver's errors as real ones make them: residuals of the recordings, drawn in blocks.

In: recordings; speed over time of a simulated drive. Out: errors of position and velocity at its fixes.

`residuals` compares the fixes with the way that the rear wheels rolled (along) and with a cubic over some
seconds (across): what is left is the receiver's error as far as it is faster than some ten seconds, with the
stamps' errors of a real host in it. Slower errors are not in it. `Library.drawn` is a block bootstrap
(Kuensch 1989, Annals of Statistics 17): blocks of 20 s, each taken from where the real car drove about as
fast as the simulated one.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import minimize_scalar
from scipy.signal import savgol_filter

from bench.worlds.recordings import Recorded, read

Array = NDArray[np.float64]
BLOCK_S = 20.0
RATE_HZ = 10.0
NEAREST = 10
"""Blocks among which is drawn, the nearest in speed."""
BLEND_S = 1.0
SLOWEST_MPS = 1.0
PATH_S = 8.0
"""Across the way a cubic over this time is the car's own path."""
ROLLED_S = 0.3
FARTHEST_M, FASTEST_MPS = 8.0, 1.5
"""Beyond these a block holds lost counts or a jump of the host's clock, not the receiver's error."""
DEVELOPMENT = ("van-motorway-a", "van-motorway-c", "rav4-suburb-60s")
HELD_OUT = ("van-motorway-b", "van-motorway-d", "rav4-suburb-60s")


@dataclass(frozen=True)
class Block:
    """Errors at 10 Hz along and across the car's way."""

    speed_mps: float
    place_m: Array
    """(n, 2)"""
    velocity_mps: Array
    """(n, 2); across it is NaN where the receiver states no course."""


@dataclass(frozen=True)
class Library:
    """Blocks of several recordings."""

    blocks: tuple[Block, ...]

    def drawn(
        self, time_s: Array, speed: Array, heading: Array, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """(m, 2) errors of east and north and (m, 2) of their rates at the times of fixes."""
        speeds = np.array([block.speed_mps for block in self.blocks])
        grid = np.arange(time_s[0], time_s[-1] + BLOCK_S + 1.0, 1.0 / RATE_HZ)
        total, weights = np.zeros((len(grid), 4)), np.zeros(len(grid))
        length, blend = round(BLOCK_S * RATE_HZ), round(BLEND_S * RATE_HZ)
        shape = np.minimum(np.arange(1, length + 1) / blend, np.arange(length, 0, -1) / blend).clip(0.0, 1.0)
        for first in range(0, len(grid) - length, length - blend):
            middle = float(np.interp(grid[first] + 0.5 * BLOCK_S, time_s, speed))
            near = np.argsort(np.abs(speeds - middle))[:NEAREST]
            block = self.blocks[int(rng.choice(near))]
            other = self.blocks[int(rng.choice(near))]
            mirror = float(rng.choice([-1.0, 1.0]))
            across = block.velocity_mps[:, 1]
            if not np.isfinite(across).all():  # errors across are taken to be like those along
                across = other.velocity_mps[:, 0]
            rows = np.column_stack([block.place_m, block.velocity_mps[:, 0], across]) * [1, mirror, 1, mirror]
            total[first : first + length] += rows * shape[:, None]
            weights[first : first + length] += shape
        total /= np.maximum(weights, 1e-3)[:, None]
        at = np.stack([np.interp(time_s, grid, column) for column in total.T], axis=1)
        cos, sin = np.cos(heading), np.sin(heading)
        turned = [
            np.stack([a * cos - b * sin, a * sin + b * cos], axis=1)
            for a, b in ((at[:, 0], at[:, 1]), (at[:, 2], at[:, 3]))
        ]
        return turned[0], turned[1]


def library(folder: Path, names: tuple[str, ...]) -> Library:
    """The blocks of the recordings of these names below `folder`; ValueError if there are too few."""
    blocks = [block for name in names if (folder / name).is_dir() for block in residuals(read(folder / name))]
    if len(blocks) < NEAREST:
        raise ValueError(f"{folder}: {len(blocks)} blocks of residuals, at least {NEAREST} are needed")
    return Library(tuple(blocks))


def residuals(recorded: Recorded) -> list[Block]:
    """The blocks of one recording, without those in which a fix is missing for long."""
    begin = max(recorded.fix_utc_s[0], recorded.time_s[0]) + 3.0
    end = min(recorded.fix_utc_s[-1], recorded.time_s[-1]) - 3.0
    grid = np.arange(begin, end, 1.0 / RATE_HZ)
    utc, offset = recorded.fix_utc_s, _clock_offset(recorded, begin, end)
    distance = np.interp(grid + offset, recorded.time_s, recorded.distance_m.mean(axis=1))
    # the frames' stamps jitter by milliseconds; the car's speed changes over tenths of a second
    rolled = gaussian_filter1d(np.gradient(distance, 1.0 / RATE_HZ), ROLLED_S * RATE_HZ)
    place = np.stack([np.interp(grid, utc, column) for column in recorded.fix_m.T], axis=1)
    path = savgol_filter(place, round(PATH_S * RATE_HZ) + 1, 3, axis=0)
    step = np.gradient(path, axis=0)
    heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    cos, sin = np.cos(heading), np.sin(heading)
    across = (place - path)[:, 1] * cos - (place - path)[:, 0] * sin
    moved = np.diff(place, axis=0, prepend=place[:1])
    along = np.cumsum(moved[:, 0] * cos + moved[:, 1] * sin) - np.cumsum(rolled) / RATE_HZ
    speed = np.interp(grid, utc, recorded.fix_speed_mps) - rolled
    course = np.full(len(grid), np.nan)
    if np.isfinite(recorded.fix_course_rad).all():
        turned = np.interp(grid, utc, np.unwrap(recorded.fix_course_rad)) - heading
        course = rolled * np.sin(turned - np.median(turned))
    gaps = np.interp(grid, utc[1:], np.diff(utc)) > 0.35
    out = []
    length = round(BLOCK_S * RATE_HZ)
    slow, fast = np.vander(np.linspace(-1, 1, length), 4), np.vander(np.linspace(-1, 1, length), 2)
    for first in range(0, len(grid) - length + 1, length):
        part = slice(first, first + length)
        faint = bool(np.isnan(speed[part]).any() or gaps[part].any())
        if faint or rolled[part].min() < SLOWEST_MPS:
            continue
        rows = np.stack([_without(along[part], slow), across[part]], axis=1)
        velocity = np.stack([_without(speed[part], fast), course[part]], axis=1)
        if float(np.abs(rows).max()) < FARTHEST_M and float(np.abs(velocity[:, 0]).max()) < FASTEST_MPS:
            out.append(Block(float(rolled[part].mean()), rows, velocity))
    return out


def _without(values: Array, columns: Array) -> Array:
    """Values less their least-squares fit by the columns."""
    return np.asarray(values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0])


def _clock_offset(recorded: Recorded, begin: float, end: float) -> float:
    """Host time minus UTC at which wheels and receiver tell the same speed."""
    grid = np.arange(begin + 2.0, end - 2.0, 1.0 / RATE_HZ)
    stated = np.interp(grid, recorded.fix_utc_s, recorded.fix_speed_mps)
    distance = recorded.distance_m.mean(axis=1)
    known = np.isfinite(stated)

    def apart(offset: float) -> float:
        ends = [np.interp(grid + offset + side, recorded.time_s, distance) for side in (-0.25, 0.25)]
        return float(np.mean(np.abs(((ends[1] - ends[0]) / 0.5 - stated)[known])))

    return float(minimize_scalar(apart, bounds=(-1.5, 1.5), method="bounded").x)
