"""A drive as arrays.

In: the `Tick`s of a drive and its configuration. Out: `Recording`: wheels and inertial signals on one regular
grid of ticks, and the fixes beside them. What was not measured is NaN. Pure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import compress

import numpy as np

from tpmsd.car.config.model import Config
from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.car.physics.motion import Car, driven_mask
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.timeline.tick import Tick

MAX_HOURS = 24.0
INERTIAL = (
    "yaw_rate_radps",
    "accel_long_mps2",
    "accel_lat_mps2",
    "steering_wheel_angle_rad",
    "drive_torque_nm",
    "ambient_temp_k",
)


@dataclass(frozen=True)
class Recording:
    """Arrays over n ticks and m fixes; times in seconds since the drive's start."""

    car: Car
    """Car as configured."""
    dt_s: float
    start_s: float
    """The drive's start on its host clock."""
    rotation_rad: FloatArray
    """(n, 4) turn of each wheel in each tick."""
    quantum_rad: FloatArray
    """(4,) standard deviation of one tick's reading by the counts' quantisation; 0 for speed signals."""
    inertial: dict[str, FloatArray]
    """(n,) each, by the names of `INERTIAL`."""
    fix_time_s: FloatArray
    """(m,) when each fix was valid, as far as is known from its own stamp and arrival."""
    east_m: FloatArray
    north_m: FloatArray
    up_m: FloatArray
    speed_mps: FloatArray
    course_rad: FloatArray
    """Mathematical angle, counter-clockwise from east."""
    host_minus_utc_s: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(m,) how far the host's clock was ahead of UTC at each fix, less that of the first; empty: not
    known."""
    name: str = "the drive"
    """Name in reports."""
    counts_per_rev: tuple[float | None, ...] = (None, None, None, None)
    """Counts per revolution of each wheel by which the angles were made, where not the configured
    ones."""

    @property
    def ticks(self) -> int:
        """Return the number of ticks, gaps included."""
        return len(self.rotation_rad)

    @property
    def edges_s(self) -> FloatArray:
        """Return (n + 1,) times at which the ticks begin and end."""
        return np.arange(self.ticks + 1, dtype=np.float64) * self.dt_s

    @property
    def wheels(self) -> list[int]:
        """Return the indices of the wheels that have any reading."""
        return [k for k in range(4) if bool(np.any(np.isfinite(self.rotation_rad[:, k])))]


def car_of(config: Config) -> Car:
    """Return the car, as the physics catalogue has it, that a configuration describes."""
    vehicle = config.vehicle
    return Car(
        radius_m=np.array(vehicle.wheel_radius_m, dtype=np.float64),
        geometry=WheelPositions(vehicle.track_front_m, vehicle.track_rear_m, vehicle.wheelbase_m),
        driven=driven_mask(vehicle.driven_axle),
        teeth_per_rev=vehicle.teeth_per_rev,
        antenna_forward_m=config.gnss.antenna_forward_m,
        antenna_left_m=config.gnss.antenna_left_m,
        **({} if vehicle.steering_ratio is None else {"steering_ratio": vehicle.steering_ratio}),
    )


def record(ticks: Sequence[Tick], config: Config, name: str = "the drive") -> Recording:
    """Return the ticks as arrays on one time grid; `name` is the drive's name in reports.

    ValueError if there are no ticks, or if they span more than a day.
    """
    if not ticks:
        raise ValueError("no tick: the drive holds no readings that belong together")
    dt_s = ticks[0].dt_s
    begin = ticks[0].time_s - dt_s
    count = round((ticks[-1].time_s - begin) / dt_s)
    if count * dt_s > MAX_HOURS * 3600:
        raise ValueError(f"the drive spans {count * dt_s / 3600:.0f} h, more than {MAX_HOURS:.0f} h")
    indices = np.round((np.array([tick.time_s for tick in ticks]) - begin) / dt_s).astype(int) - 1
    within = (indices >= 0) & (indices < count)
    ticks, indices = list(compress(ticks, within.tolist())), indices[within]
    rotation, std = np.full((count, 4), math.nan), np.full((count, 4), math.nan)
    rotation[indices] = [tick.rotation_rad for tick in ticks]
    std[indices] = [tick.rotation_std_rad for tick in ticks]
    inertial = {name: np.full(count, math.nan) for name in INERTIAL}
    for role, values in inertial.items():
        values[indices] = [getattr(tick, role) for tick in ticks]
    fixes = [
        (
            *(fix.time_s - begin, fix.east_m, fix.north_m, fix.up_m, fix.speed_mps, fix.heading_rad),
            tick.host_time_s - tick.time_s + fix.time_s - fix.utc_s,
        )
        for tick in ticks
        for fix in tick.fixes
    ]
    table = np.array(fixes, dtype=np.float64).reshape(-1, 7)
    table = table[np.argsort(table[:, 0], kind="stable")]
    known = np.isfinite(std)
    return Recording(
        car=car_of(config),
        dt_s=dt_s,
        start_s=ticks[0].host_time_s - dt_s,
        rotation_rad=rotation,
        quantum_rad=np.array(
            [float(np.median(std[known[:, k], k])) if known[:, k].any() else 0.0 for k in range(4)]
        ),
        inertial=inertial,
        fix_time_s=table[:, 0],
        east_m=table[:, 1],
        north_m=table[:, 2],
        up_m=table[:, 3],
        speed_mps=table[:, 4],
        course_rad=table[:, 5],
        host_minus_utc_s=table[:, 6] - table[:1, 6],
        name=name,
    )
