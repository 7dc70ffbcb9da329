"""A drive as arrays.

In: the `Tick`s of a drive and its configuration. Out: `Recording`: wheels and inertial signals on one regular
grid of ticks, and the fixes beside them. What was not measured is NaN.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.config.model import Config
from tpmsd.timeline.tick import Tick
from tpmsd.wheels import RL, RR, FloatArray

MAX_HOURS = 24.0


@dataclass(frozen=True)
class Recording:
    """Arrays over n ticks and m fixes; times in seconds since the first tick began."""

    name: str
    dt_s: float
    rotation_rad: FloatArray
    """(n, 4) turn of each wheel in each tick."""
    reading_std_rad: FloatArray
    """(4,) standard deviation of a wheel's angle at an instant by the counts' quantisation; 0 for speeds."""
    gyro_radps: FloatArray
    """(n,) the bus's yaw rate."""
    fix_time_s: FloatArray
    east_m: FloatArray
    north_m: FloatArray
    up_m: FloatArray
    speed_mps: FloatArray
    heading_rad: FloatArray
    """Course over ground as a mathematical angle."""
    antenna_forward_m: float
    antenna_left_m: float
    accel_long_mps2: FloatArray
    accel_lat_mps2: FloatArray
    """(n,) each."""
    compass_rad: FloatArray | None = None
    """(n,) heading by a magnetometer at the ticks' ends, as a mathematical angle, where there is one."""

    @property
    def edges_s(self) -> FloatArray:
        """(n + 1,) times at which the ticks begin and end."""
        return np.asarray(np.arange(len(self.rotation_rad) + 1) * self.dt_s, dtype=np.float64)

    @property
    def wheels(self) -> list[int]:
        """Wheels that were read through most of the drive; the rear pair first in any case."""
        known = np.isfinite(self.rotation_rad).mean(axis=0)
        front = [k for k in (0, 1) if known[k] > 0.5 and known[1 - k] > 0.5]
        return [*front, RL, RR]


def record(name: str, ticks: Sequence[Tick], config: Config) -> Recording:
    """Lay the ticks out on one grid. ValueError if there are none, or if they span more than a day."""
    if not ticks:
        raise ValueError("it holds no readings of bus and receiver that belong together")
    dt_s = ticks[0].dt_s
    begin = ticks[0].time_s - dt_s
    count = round((ticks[-1].time_s - begin) / dt_s)
    if count * dt_s > MAX_HOURS * 3600:
        raise ValueError(f"it spans {count * dt_s / 3600:.0f} h, more than {MAX_HOURS:.0f} h")
    rotation, std = np.full((count, 4), math.nan), np.full((count, 4), math.nan)
    gyro, long, lateral = (np.full(count, math.nan) for _ in range(3))
    fixes: list[tuple[float, ...]] = []
    for tick in ticks:
        at = round((tick.time_s - begin) / dt_s) - 1
        if not 0 <= at < count:
            continue
        rotation[at], std[at] = tick.rotation_rad, tick.rotation_std_rad
        gyro[at] = tick.yaw_rate_radps
        long[at], lateral[at] = tick.accel_long_mps2, tick.accel_lat_mps2
        fixes += [
            (f.time_s - begin, f.east_m, f.north_m, f.up_m, f.speed_mps, f.heading_rad) for f in tick.fixes
        ]
    table = np.array(fixes, dtype=np.float64).reshape(-1, 6)
    table = table[np.argsort(table[:, 0], kind="stable")]
    known = np.isfinite(std)
    # A tick's reading error is that of two instants.
    reading = [np.median(std[known[:, k], k]) / math.sqrt(2) if known[:, k].any() else 0.0 for k in range(4)]
    return Recording(
        name=name,
        dt_s=dt_s,
        rotation_rad=rotation,
        reading_std_rad=np.array(reading, dtype=np.float64),
        gyro_radps=gyro,
        fix_time_s=table[:, 0],
        east_m=table[:, 1],
        north_m=table[:, 2],
        up_m=table[:, 3],
        speed_mps=table[:, 4],
        heading_rad=table[:, 5],
        antenna_forward_m=config.gnss.antenna_forward_m,
        antenna_left_m=config.gnss.antenna_left_m,
        accel_long_mps2=long,
        accel_lat_mps2=lateral,
    )
