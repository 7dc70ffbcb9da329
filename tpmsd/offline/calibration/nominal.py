"""The motion about which the calibration linearises: what rear wheels and receiver show, smoothed.

In: `Recording`, `Vehicle` (present radii and geometry). Out: `NominalMotion`, arrays at the ticks' edges.
It need only be near the truth: its errors in speed, yaw rate, heading and position are estimated too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d, median_filter

from tpmsd.car.config.model import VehicleConfig
from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.car.physics.motion import driven_mask, integrate
from tpmsd.foundation.wheels import FL, FR, RL, RR, FloatArray
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import fill

SMOOTHING_S = 0.3
HEIGHT_SMOOTHING_S = 8.0
LEAD_SMOOTHING_S = 8.0
COURSE_FROM_MPS = 3.0
LEG_S = 1.5
DRIFT_SMOOTHING_S = 4.0
COURSES_FROM = 0.3
"""Share of the fixes that must bear a course for the receiver's courses to be used instead of its
positions."""


@dataclass(frozen=True)
class Vehicle:
    """Present estimate of the car."""

    radius_m: FloatArray
    """(4,)"""
    geometry: WheelPositions
    driven: np.ndarray
    """(4,) mask."""
    load_lateral_s2: float = 0.0
    """Change of radius in bends, subtracted at the outer wheels and added at the inner ones, m per m/s2."""

    def corrected(
        self, radii: FloatArray, track_rear: float, track_front: float, load_lateral_s2: float = 0.0
    ) -> Vehicle:
        """Return the car after relative corrections of radii (4,) and tracks."""
        geometry = replace(
            self.geometry,
            track_rear_m=self.geometry.track_rear_m * (1.0 + track_rear),
            track_front_m=self.geometry.track_front_m * (1.0 + track_front),
        )
        return replace(
            self,
            radius_m=self.radius_m * (1.0 + radii),
            geometry=geometry,
            load_lateral_s2=load_lateral_s2,
        )


def vehicle_of(config: VehicleConfig) -> Vehicle:
    """Return the vehicle with the configured radii and geometry."""
    return Vehicle(
        np.array(config.wheel_radius_m, dtype=np.float64),
        WheelPositions(config.track_front_m, config.track_rear_m, config.wheelbase_m),
        driven_mask(config.driven_axle),
    )


def calibrated_wheels(recording: Recording) -> list[int]:
    """Return the indices of the wheels to calibrate: the rear pair, and before it the front pair if both were
    read through most of the drive.
    """
    known = np.isfinite(recording.rotation_rad).mean(axis=0)
    front = [FL, FR] if min(known[FL], known[FR]) > 0.5 else []
    return [*front, RL, RR]


@dataclass(frozen=True)
class NominalMotion:
    """Arrays (n + 1,) at the ticks' edges."""

    time_s: FloatArray
    speed_mps: FloatArray
    yaw_rate_radps: FloatArray
    heading_rad: FloatArray
    east_m: FloatArray
    north_m: FloatArray
    grade_rad: FloatArray
    accel_mps2: FloatArray


def nominal_motion(recording: Recording, car: Vehicle) -> NominalMotion:
    """Return the smoothed motion of a recording by rear wheels and receiver."""
    edges, dt = recording.edges_s, recording.dt_s
    rate = recording.rotation_rad / dt * car.radius_m
    sigma = SMOOTHING_S / dt
    speed = np.maximum(_smooth_at_edges((rate[:, RL] + rate[:, RR]) / 2, sigma), 0.0)
    shown = _smooth_at_edges((rate[:, RR] - rate[:, RL]) / car.geometry.track_rear_m, sigma)
    by_wheels = shown / shown_turn_ratio(car, speed)
    heading = integrate(by_wheels, edges) + _smoothed_heading_difference(
        recording, edges, speed, integrate(by_wheels, edges)
    )
    grade = _grade(recording, edges, speed)
    forward = speed * np.cos(grade)
    if not np.isfinite(recording.course_rad).mean() > COURSES_FROM:
        for _ in range(2):
            heading = heading + _heading_correction_by_positions(recording, edges, heading, forward)
    yaw = np.gradient(heading, dt)
    return NominalMotion(
        time_s=edges,
        speed_mps=speed,
        yaw_rate_radps=yaw,
        heading_rad=heading,
        east_m=integrate(forward * np.cos(heading), edges),
        north_m=integrate(forward * np.sin(heading), edges),
        grade_rad=grade,
        accel_mps2=np.gradient(speed, dt),
    )


def shown_turn_ratio(car: Vehicle, speed_mps: FloatArray) -> FloatArray:
    """Return the (n,) ratio of the turn that the rear wheels show to the true turn, at speeds (n,).

    In a bend the outer wheel shrinks and the inner one grows by c * v * yaw rate, which looks like more turn:
    half as much again at 25 m/s is common.
    """
    too_much = 2 * car.load_lateral_s2 * np.square(speed_mps)
    return np.asarray(1.0 + too_much / (car.radius_m[RL] * car.geometry.track_rear_m), dtype=np.float64)


def _smooth_at_edges(ticks: FloatArray, sigma: float) -> FloatArray:
    """Return the (n + 1,) values at the ticks' edges after Gaussian smoothing by `sigma` ticks."""
    smooth = gaussian_filter1d(fill(ticks), sigma, mode="nearest")
    return np.concatenate([smooth[:1], 0.5 * (smooth[1:] + smooth[:-1]), smooth[-1:]])


def _smoothed_heading_difference(
    recording: Recording, edges: FloatArray, speed: FloatArray, turned: FloatArray
) -> FloatArray:
    """Return the (n + 1,) low-pass filtered difference between the receiver's course and the wheels' turn,
    rad; 0 with too few courses.
    """
    time_s, course = courses(recording)
    moving = np.interp(time_s, edges, speed) > COURSE_FROM_MPS
    if moving.sum() < 5:
        return np.zeros_like(edges)
    time_s, course = time_s[moving], course[moving]
    off = np.unwrap(course - np.interp(time_s, edges, turned))
    off = median_filter(off, size=min(9, len(off)), mode="nearest")
    grid = np.interp(edges, time_s, off)
    return gaussian_filter1d(grid, LEAD_SMOOTHING_S / recording.dt_s, mode="nearest")


def _heading_correction_by_positions(
    recording: Recording, edges: FloatArray, heading: FloatArray, forward: FloatArray
) -> FloatArray:
    """Return the (n + 1,) correction of the nominal heading, rad: the cross-track drift of the positions over
    the speed.

    An error of heading costs its square half in distance, so what is left of it must be small.
    """
    known = np.isfinite(recording.east_m)
    if known.sum() < 10:
        return np.zeros_like(edges)
    time_s, dt = recording.fix_time_s[known], recording.dt_s
    ahead, left = recording.car.antenna_forward_m, recording.car.antenna_left_m
    cos, sin = np.cos(heading), np.sin(heading)
    antenna = (
        integrate(forward * cos, edges) + ahead * cos - left * sin,
        integrate(forward * sin, edges) + ahead * sin + left * cos,
    )
    drift = []
    for measured, path in zip((recording.east_m, recording.north_m), antenna, strict=True):
        off = np.interp(edges, time_s, measured[known] - np.interp(time_s, edges, path))
        drift.append(gaussian_filter1d(off, DRIFT_SMOOTHING_S / dt, order=1, mode="nearest") / dt)
    across = -sin * drift[0] + cos * drift[1]
    fast = forward > COURSE_FROM_MPS
    return np.asarray(np.clip(np.where(fast, across / np.maximum(forward, COURSE_FROM_MPS), 0.0), -0.3, 0.3))


def courses(recording: Recording) -> tuple[FloatArray, FloatArray]:
    """Return the times and courses of the receiver; from its positions over a leg where it gives no
    courses.
    """
    known = np.isfinite(recording.course_rad)
    if len(known) and known.mean() > COURSES_FROM:
        return recording.fix_time_s[known], recording.course_rad[known]
    time_s, east, north = recording.fix_time_s, recording.east_m, recording.north_m
    if len(time_s) < 3:
        return np.empty(0), np.empty(0)
    later = np.minimum(np.searchsorted(time_s, time_s + LEG_S), len(time_s) - 1)
    de, dn = east[later] - east, north[later] - north
    lasting = time_s[later] - time_s
    fit = (np.hypot(de, dn) > 3.0) & (lasting > 0.8 * LEG_S) & (lasting < 2 * LEG_S)
    return 0.5 * (time_s + time_s[later])[fit], np.arctan2(dn, de)[fit]


def _grade(recording: Recording, edges: FloatArray, speed: FloatArray) -> FloatArray:
    """Return the (n + 1,) smoothed slope (rad) by the receiver's heights; 0 with too few heights."""
    known = np.isfinite(recording.up_m)
    if known.sum() < 30:
        return np.zeros_like(edges)
    sigma = HEIGHT_SMOOTHING_S / recording.dt_s
    height = np.interp(edges, recording.fix_time_s[known], recording.up_m[known])
    climb = np.gradient(gaussian_filter1d(height, sigma, mode="nearest"), recording.dt_s)
    smooth_speed = gaussian_filter1d(speed, sigma, mode="nearest")
    slope = np.where(smooth_speed > 2.0, climb / np.maximum(smooth_speed, 2.0), 0.0)
    return np.asarray(np.arcsin(np.clip(slope, -0.2, 0.2)))
