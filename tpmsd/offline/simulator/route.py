"""A route: how the car moves along a road, at 100 Hz.

In: a kind of road (or segments), a duration, a Generator. Out: `Motion` with bounded accelerations, stops,
bends below 3 m/s2, and a driver who varies a little in speed and within the lane. A `Motion` from elsewhere
(say, smoothed from a drive's own fixes) can take its place: everything after this module takes a `Motion`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from tpmsd.car.physics.motion import Motion
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.simulator.road import ROUTE_KINDS, Segment, make_road

RATE_HZ = 100.0
_GRID_M = 0.5
_JERK_WINDOW_S = 1.5
_LANE_M = 3.5


@dataclass(frozen=True, slots=True)
class Driver:
    """Accelerations (m/s2) that a simulated driver uses along, and across in bends."""

    accel_mps2: float = 1.8
    """Acceleration from standstill; falls with speed as an engine's power demands."""
    accel_half_speed_mps: float = 20.0
    """Speed at which the acceleration is half of that."""
    brake_mps2: float = 1.6
    lateral_mps2: float = 2.2
    """Taken in bends."""
    speed_drift: float = 0.03
    """Standard deviation of speed over limit."""
    start_wait_s: float = 4.0
    """Time of standing before setting off, s."""

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Driver:
        """Return a random driver between gentle and brisk."""
        return cls(
            accel_mps2=float(rng.uniform(1.3, 2.3)),
            brake_mps2=float(rng.uniform(1.2, 2.2)),
            lateral_mps2=float(rng.uniform(1.6, 2.5)),
            start_wait_s=float(rng.uniform(3.0, 8.0)),
        )


def make_route(
    kind: str,
    duration_s: float,
    rng: np.random.Generator,
    *,
    wheelbase_m: float = 2.63,
    driver: Driver | None = None,
    flat: bool = False,
) -> Motion:
    """Return a drive of `duration_s` on a road of this kind; `flat` takes the slopes away.

    ConfigError on an unknown kind or a duration that is not between 10 s and a day.
    """
    if kind not in ROUTE_KINDS:
        raise ConfigError(f"unknown route {kind!r} (routes: {' '.join(ROUTE_KINDS)})")
    if not 10.0 <= duration_s <= 86_400.0:
        raise ConfigError(f"duration {duration_s:g} s is outside 10 to 86400 s")
    driver = Driver.drawn(rng) if driver is None else driver
    segments = make_road(kind, duration_s, rng)
    return drive_along(segments, duration_s, rng, driver=driver, wheelbase_m=wheelbase_m, flat=flat)


def drive_along(
    segments: list[Segment],
    duration_s: float,
    rng: np.random.Generator,
    *,
    driver: Driver,
    wheelbase_m: float = 2.63,
    flat: bool = False,
) -> Motion:
    """Return the motion along these segments from a standstill; they must last for the duration."""
    ends = np.cumsum([segment.length_m for segment in segments])
    path_m = np.arange(0.0, ends[-1], _GRID_M)
    curvature = _road_curvature(segments, ends, path_m) + _lane_drift_curvature(segments, ends, path_m, rng)
    tan_grade = _tan_grade(segments, ends, path_m, rng)
    cap = _speed_cap(segments, ends, path_m, curvature, driver, rng)
    stops = [
        (int(end / _GRID_M), segment.stop_s)
        for end, segment in zip(ends, segments, strict=True)
        if segment.stop_s > 0 and end < path_m[-1]
    ]
    cap[0] = 0.0
    for index, _ in stops:
        cap[index] = 0.0
    speed = _feasible_speed(path_m, cap, driver)
    time_s, speed_t = _speed_over_time(path_m, speed, [(0, driver.start_wait_s), *stops], duration_s)
    distance = np.concatenate([[0.0], np.cumsum(0.5 * (speed_t[1:] + speed_t[:-1]) / RATE_HZ)])
    grade = np.zeros_like(time_s) if flat else np.arctan(np.interp(distance, path_m, tan_grade))
    return Motion.from_profiles(
        time_s,
        speed_t,
        speed_t * np.interp(distance, path_m, curvature),
        wheelbase_m=wheelbase_m,
        grade_rad=grade,
        heading_start_rad=float(rng.uniform(-np.pi, np.pi)),
    )


def _road_curvature(segments: list[Segment], ends: FloatArray, path_m: FloatArray) -> FloatArray:
    knots: list[float] = []
    values: list[float] = []
    for end, segment in zip(ends, segments, strict=True):
        start = float(end) - segment.length_m
        ramp = min(segment.style.transition_m, 0.5 * segment.length_m)
        knots += [start, start + ramp, float(end) - ramp, float(end)]
        values += [0.0, segment.curvature_per_m, segment.curvature_per_m, 0.0]
    return np.asarray(np.interp(path_m, knots, values))


def _lane_drift_curvature(
    segments: list[Segment], ends: FloatArray, path_m: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Return the curvature of the driver's path beyond the road's: second derivative of the lateral position
    in the lane.
    """
    knots, offsets = [0.0], [0.0]
    lane = 0.0
    index = 0
    while knots[-1] < path_m[-1]:
        while index < len(segments) - 1 and ends[index] <= knots[-1]:
            index += 1
        style = segments[index].style
        if rng.random() < style.lane_change:
            lane = 0.0 if lane else _LANE_M
        knots.append(knots[-1] + style.drift_spacing_m)
        offsets.append(lane + style.drift_m * float(rng.standard_normal()))
    return np.asarray(CubicSpline(knots, offsets, bc_type="natural")(path_m, 2))


def _tan_grade(
    segments: list[Segment], ends: FloatArray, path_m: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Return the tangent of the slope along the path: level at the start, smooth, within 12 %."""
    knots, grades = [0.0], [0.0]
    index = 0
    while knots[-1] < path_m[-1]:
        while index < len(segments) - 1 and ends[index] <= knots[-1]:
            index += 1
        style = segments[index].style
        knots.append(knots[-1] + style.grade_spacing_m)
        grades.append(style.grade_std * float(rng.standard_normal()))
    smooth = CubicSpline(knots, grades, bc_type="clamped")(path_m)
    return np.asarray(0.12 * np.tanh(smooth / 0.12))


def _speed_cap(
    segments: list[Segment],
    ends: FloatArray,
    path_m: FloatArray,
    curvature: FloatArray,
    driver: Driver,
    rng: np.random.Generator,
) -> FloatArray:
    """Return the highest speed along the path by limits, the driver's habits and lateral acceleration."""
    which = np.minimum(np.searchsorted(ends, path_m, side="right"), len(segments) - 1)
    limit = np.array([segment.limit_mps for segment in segments])[which]
    knots = np.arange(0.0, path_m[-1] + 300.0, 150.0)
    drift = CubicSpline(knots, driver.speed_drift * rng.standard_normal(len(knots)))(path_m)
    limit = limit * (1.0 + np.clip(drift, -0.1, 0.1))
    in_bend = np.sqrt(driver.lateral_mps2 / np.maximum(np.abs(curvature), 1e-6))
    return np.asarray(np.minimum(limit, in_bend))


def _feasible_speed(path_m: FloatArray, cap_mps: FloatArray, driver: Driver) -> FloatArray:
    """Return the highest speed below the cap that the driver's acceleration and braking allow.

    With E(v) = integral of v/a(v) dv, a car at full acceleration gains E at the rate of one per metre, so
    that both passes are running minima.
    """
    grid = np.linspace(0.0, 80.0, 4001)
    up = (grid**2 / 2 + grid**3 / (3 * driver.accel_half_speed_mps)) / driver.accel_mps2
    energy = np.minimum.accumulate(np.interp(cap_mps, grid, up) - path_m) + path_m
    speed = np.interp(energy, up, grid)
    down = speed**2 / (2 * driver.brake_mps2) + path_m
    backward = np.minimum.accumulate(down[::-1])[::-1] - path_m
    return np.asarray(np.sqrt(2 * driver.brake_mps2 * np.maximum(backward, 0.0)))


def _speed_over_time(
    path_m: FloatArray, speed_mps: FloatArray, stops: list[tuple[int, float]], duration_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return the speed at 100 Hz, jerk limited by a Hann window; `stops` are (index into the path,
    seconds)."""
    steps = 2 * np.diff(path_m) / np.maximum(speed_mps[1:] + speed_mps[:-1], 1e-3)
    waits = np.zeros(len(path_m))
    for index, wait in stops:
        waits[index] += wait
    arrive = np.concatenate([[0.0], np.cumsum(steps)]) + np.concatenate([[0.0], np.cumsum(waits)[:-1]])
    # A stop is two knots: arrival and departure, both at rest.
    where = np.flatnonzero(waits)
    knots_t = np.insert(arrive, where + 1, arrive[where] + waits[where])
    knots_v = np.insert(speed_mps, where + 1, speed_mps[where])
    count = round(duration_s * RATE_HZ) + 1
    half = round(_JERK_WINDOW_S * RATE_HZ / 2)
    time_s = np.arange(count) / RATE_HZ
    padded = np.interp(np.arange(-half, count + half) / RATE_HZ, knots_t, knots_v)
    window = np.hanning(2 * half + 3)[1:-1]
    smooth = np.convolve(padded, window / window.sum(), mode="valid")
    return time_s, np.maximum(smooth, 0.0)
