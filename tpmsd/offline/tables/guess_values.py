"""Meaning of a column's values: units, signs, directions and measures of the car.

In: arrays of a table on one clock. Out: units, scales and lengths; None where the values cannot tell. Pure.

Measured against the receiver: its distance over ground gives the unit of every speed, its course unit and
sign of the yaw rate, and wheel turns per distance the rolling radius.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.tables.gather import WGS84_A_M, WGS84_E2

MIN_MOVING_MPS = 3.0
"""Slower, the course of the receiver's positions is mostly noise."""
UNIT_TOLERANCE = 0.06
"""A speed over the road differs from the receiver's by tyre and calibration, by 4 % at most (UN ECE R39)."""
RADII_M = (0.22, 0.48)
"""Rolling radii of cars and vans, from the smallest city car to a large off-road car."""
_ROAD = {"m/s": 1.0, "km/h": 3.6, "mph": 1.0 / 0.44704, "kn": 3600.0 / 1852.0}
_TURNING = {"rad/s": 1.0, "rpm": 30.0 / np.pi, "deg/s": 180.0 / np.pi}
_TIME_STEPS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_SLOWEST_STEP_S = 2.0


@dataclass(frozen=True)
class GroundMotion:
    """The receiver's motion at the times of its fixes."""

    time_s: FloatArray
    speed_mps: FloatArray
    course_rad: FloatArray
    """Clockwise from north, unwrapped; NaN where the car is slow."""

    def yaw_rate(self) -> tuple[FloatArray, FloatArray]:
        """Return times (s) and yaw rate (rad/s, counter-clockwise) between fixes in which the course is
        known.
        """
        rate = -np.diff(self.course_rad) / np.diff(self.time_s)
        known = np.isfinite(rate) & (np.abs(rate) < 1.0)
        return 0.5 * (self.time_s[1:] + self.time_s[:-1])[known], rate[known]


def time_unit(values: FloatArray) -> str | None:
    """Return the coarsest unit of time in which the median step is at most 2 s; None if time falls."""
    steps = np.diff(values[np.isfinite(values)])
    if len(steps) < 2 or np.any(steps < 0.0) or not np.any(steps > 0.0):
        return None
    step = float(np.median(steps[steps > 0.0]))
    return next((unit for unit, scale in _TIME_STEPS.items() if step * scale <= _SLOWEST_STEP_S), None)


def motion_of(
    time_s: FloatArray, east_m: FloatArray, north_m: FloatArray, min_step_s: float = 0.5
) -> GroundMotion | None:
    """Return the motion by positions renewed at least `min_step_s` apart; None with fewer than ten."""
    known = np.flatnonzero(np.isfinite(east_m) & np.isfinite(north_m) & np.isfinite(time_s))
    if not len(known):
        return None
    east, north, times = east_m[known], north_m[known], time_s[known]
    fresh = np.concatenate([[True], (np.diff(east) != 0.0) | (np.diff(north) != 0.0)])
    east, north, times = east[fresh], north[fresh], times[fresh]
    kept = [0]
    for at in range(1, len(times)):
        if times[at] - times[kept[-1]] >= min_step_s:
            kept.append(at)
    picked = np.array(kept)
    if len(picked) < 10:
        return None
    east, north, times = east[picked], north[picked], times[picked]
    step = np.diff(times)
    speed = np.hypot(np.diff(east), np.diff(north)) / step
    course = np.arctan2(np.diff(east), np.diff(north))
    usable = (speed > MIN_MOVING_MPS) & (step < 5.0)
    full = np.full(len(course), np.nan)
    full[usable] = np.unwrap(course[usable])
    return GroundMotion(0.5 * (times[1:] + times[:-1]), np.where(step < 5.0, speed, np.nan), full)


def to_plane(latitude_deg: FloatArray, longitude_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return east and north (m) of the smallest longitude and latitude, on the ellipsoid's tangent; good to
    1e-4 within 50 km.
    """
    lat, lon = np.radians(latitude_deg), np.radians(longitude_deg)
    at = float(np.nanmedian(lat))
    w2 = 1.0 - WGS84_E2 * np.sin(at) ** 2
    north = (lat - np.nanmin(lat)) * WGS84_A_M * (1 - WGS84_E2) / w2**1.5
    return (lon - np.nanmin(lon)) * WGS84_A_M / np.sqrt(w2) * np.cos(at), north


def kind_of_wheel(values: FloatArray) -> str:
    """Return `count`, `angle` or `speed`: counts are whole and rise, angles rise, speeds do neither."""
    known = values[np.isfinite(values)]
    steps = np.diff(known)
    moving = steps[steps != 0.0]
    if not len(moving) or float((moving > 0.0).mean()) < 0.9:
        return "speed"
    falls = moving[moving < 0.0]
    # What rolls over falls by nearly all of its range.
    if len(falls) and float(np.abs(falls).min()) < 0.5 * float(np.ptp(known)):
        return "speed"
    return "count" if bool(np.all(known == np.round(known))) else "angle"


def modulus_of(values: FloatArray) -> int | None:
    """Return the number of values of a count that rolls over; None where it never does.

    The power of two above the largest count where that is within the largest step; else the smallest number
    that makes each step over the end as large as the steps around it.
    """
    known = values[np.isfinite(values)]
    steps = np.diff(known)
    at = np.flatnonzero(steps < 0.0).tolist()
    if not at:
        return None
    top, rising = float(known.max()), steps[steps > 0.0]
    power = 2 ** math.ceil(math.log2(top + 1.0))
    if power - top <= 2.0 * float(rising.max()) + 1.0:
        return int(power)
    around = [0.5 * (steps[max(k - 1, 0)] + steps[min(k + 1, len(steps) - 1)]) for k in at]
    over = [one - steps[k] for one, k in zip(around, at, strict=True)]
    return max(round(float(np.median(over))), int(top) + 1)


def rate_of(time_s: FloatArray, values: FloatArray, modulus: int | None = None) -> FloatArray:
    """Return the (n,) derivative of rising values, per second, their roll-overs taken out; NaN where it is
    not known.
    """
    known = np.isfinite(values) & np.isfinite(time_s)
    held = values[known]
    if modulus:
        held = held + modulus * np.concatenate([[0.0], np.cumsum(np.diff(held) < 0.0)])
    rate = np.full(len(values), np.nan)
    if known.sum() > 2:
        rate[known] = np.gradient(held, time_s[known])
    return rate


def units_per_mps(time_s: FloatArray, values: FloatArray, motion: GroundMotion) -> float | None:
    """Return units of a speed per m/s of the receiver while the car moves; None with too few readings or
    fixes.
    """
    known = np.isfinite(values) & np.isfinite(time_s)
    moving = np.isfinite(motion.speed_mps) & (motion.speed_mps > MIN_MOVING_MPS)
    if known.sum() < 10 or moving.sum() < 10:
        return None
    inside = moving & (motion.time_s >= time_s[known][0]) & (motion.time_s <= time_s[known][-1])
    if inside.sum() < 10:
        return None
    here = np.interp(motion.time_s[inside], time_s[known], values[known])
    return float(here.sum() / motion.speed_mps[inside].sum())


def road_unit(per_mps: float) -> str | None:
    """Return the unit of a speed over the road by its ratio to m/s; None where none fits."""
    near = min(_ROAD, key=lambda unit: abs(per_mps / _ROAD[unit] - 1.0))
    return near if abs(per_mps / _ROAD[near] - 1.0) < UNIT_TOLERANCE else None


def rotation_unit(per_mps: float) -> tuple[str, float] | None:
    """Return unit and rolling radius (m) of a wheel's rotation by its ratio to m/s; None if no radius is a
    car's.
    """
    for unit, factor in _TURNING.items():
        radius = factor / per_mps
        if RADII_M[0] <= radius <= RADII_M[1]:
            return unit, float(radius)
    return None


def slope_and_correlation(
    time_s: FloatArray, values: FloatArray, at_s: FloatArray, wanted: FloatArray
) -> tuple[float, float]:
    """Return the least-squares slope of `values` on `wanted` at times `at_s`, and their correlation; both 0
    if unknown.
    """
    known = np.isfinite(values) & np.isfinite(time_s)
    if known.sum() < 10 or len(at_s) < 10:
        return 0.0, 0.0
    here = np.interp(at_s, time_s[known], values[known])
    x, y = wanted - wanted.mean(), here - here.mean()
    power = float(x @ x), float(y @ y)
    if not power[0] > 0.0 or not power[1] > 0.0:
        return 0.0, 0.0
    cross = float(x @ y)
    return cross / power[0], cross / float(np.sqrt(power[0] * power[1]))


def yaw_unit(slope_of_rate: float) -> tuple[str, float] | None:
    """Return unit and sign of a yaw rate by its slope on the course's rate; None where neither unit fits."""
    for unit in ("rad/s", "deg/s"):
        size = abs(slope_of_rate) / _TURNING[unit]
        if 0.6 < size < 1.5:
            return unit, float(np.sign(slope_of_rate))
    return None
