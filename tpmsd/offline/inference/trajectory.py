"""The motion that a recording itself shows, smoothed from wheels, inertial signals and fixes.

In: `Recording`. Out: `ReferenceTrajectory`: a `Motion` at the ticks' edges, with the car's radii calibrated
to the receiver. The diagnosis linearises about it and estimates the errors of this motion together with
everything else, so it need only be near the truth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tpmsd.car.physics.kinematics import wheel_speeds
from tpmsd.car.physics.motion import GRAVITY_MPS2, Car, Motion, integrate
from tpmsd.foundation.wheels import FL, FR, RL, RR, FloatArray
from tpmsd.offline.inference.min_speed import least_speed
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.smoothing import NEAREST, gaussian, running_median

WINDOW_S = 1.0
"""Over which the channels are compared."""
SPEED_SMOOTHING_S = 0.35
YAW_SMOOTHING_S = 0.6
"""At most, where wheels alone tell the yaw rate: 87 % of a lane change of four seconds are left, and the
motion's own errors make up for the rest."""
YAW_ERROR_RADPS = 1e-3
"""Error of such a yaw rate, by the rounding of counts, where no more smoothing than that is needed for it."""
ACCEL_SMOOTHING_S = 0.25
"""On top of the speed's own."""
GRADE_SMOOTHING_S = 0.5
HEIGHT_SMOOTHING_S = 12.0
FEWEST_HEIGHTS = 30
"""Fixes with a height, from which slopes are estimated from them."""
MIN_SMOOTHING_S = 3.0
SLOPE_ERROR = 1e-3
FLAT_BELOW = 0.006
"""Scatter of the slope by heights alone below which it is the heights' own error."""
HEADING_SMOOTHING_S = 8.0
COURSE_FROM_MPS = 3.0
DRIFT_WITHIN_S = 3.0


@dataclass(frozen=True)
class ReferenceTrajectory:
    """Reference motion at which the diagnosis linearises."""

    motion: Motion
    """At the ticks' edges, (n + 1,)."""
    car: Car
    """The configured car with calibrated radii."""
    valid: np.ndarray
    """(n,) ticks in which all the car's wheels were read."""
    grade_known: bool
    """True if slopes could be estimated from heights or from the accelerometer."""
    grade_by: str
    """accelerometer | heights | nothing"""
    min_mps: float
    """Speed from which the drive is compared."""


def reference(recording: Recording) -> ReferenceTrajectory:
    """Return the recording's smoothed motion; it needs both rear wheels, and some speeds or positions."""
    wheels = recording.wheels
    valid = np.all(np.isfinite(recording.rotation_rad[:, wheels]), axis=1)
    car = replace(recording.car, radius_m=recording.car.radius_m.copy())
    yaw, speed = _yaw_and_speed(recording, car)
    least = least_speed(speed)
    scale = _radius_scale(recording, speed, least)
    car = replace(car, radius_m=_balanced_radii_m(recording, car, yaw, speed, least) * scale)
    yaw, speed = _yaw_and_speed(recording, car)
    heading, yaw = _heading(recording, yaw, speed, least)
    motion = _motion(recording, car, speed, yaw, heading)
    grade, by = _grade(recording, speed, motion.accel_long_mps2)
    motion = replace(motion, grade_rad=grade, measured=_bus_readings(recording))
    known = by != "nothing"
    return ReferenceTrajectory(motion, car, valid, grade_known=known, grade_by=by, min_mps=least)


def moved(
    recording: Recording, before: ReferenceTrajectory, end_s: FloatArray, errors: FloatArray
) -> ReferenceTrajectory:
    """Return the reference corrected by its errors (w, 3) of speed, yaw rate and heading; windows end at
    `end_s`."""
    old, edges = before.motion, recording.edges_s
    window = np.round(end_s / WINDOW_S).astype(int) - 1
    slower = np.zeros(len(edges) // round(WINDOW_S / recording.dt_s) + 2)
    slower[window] = errors[:, 0]
    speed = np.interp(edges, (np.arange(len(slower)) + 0.5) * WINDOW_S, slower)
    first = np.diff(window, prepend=-9) > 1
    at = np.concatenate([end_s, end_s[first] - WINDOW_S])
    turned = np.concatenate([errors[:, 2], errors[first, 2] - WINDOW_S * errors[first, 1]])
    order = np.argsort(at, kind="stable")
    turn = np.interp(edges, at[order], turned[order])
    width_s = _yaw_smoothing_s(recording, before.car)
    if not _has_gyro(recording) and width_s > SPEED_SMOOTHING_S:
        turn = gaussian(turn, width_s / recording.dt_s, NEAREST)
    yaw = old.yaw_rate_radps + np.gradient(turn, recording.dt_s)
    speed = np.maximum(old.speed_mps + speed, 0.0)
    motion = _motion(recording, before.car, speed, yaw, old.heading_rad + turn)
    return replace(before, motion=replace(motion, grade_rad=old.grade_rad, measured=old.measured))


def before_low_pass(recording: Recording, shown: ReferenceTrajectory, time_constant_s: float) -> Motion:
    """Return the motion whose wheel speeds are those of a reference behind a first-order low-pass.

    The wheels tell the motion best by far, so it is the motion that changes with the constant, and not what
    they show: x = y + T dy/dt is linear in T, where a low-pass of y is not. A gyro's yaw rate stays.
    """
    old = shown.motion

    def restored(values: FloatArray) -> FloatArray:
        return np.asarray(values + time_constant_s * np.gradient(values, recording.dt_s))

    speed, yaw, heading = np.maximum(restored(old.speed_mps), 0.0), old.yaw_rate_radps, old.heading_rad
    if not _has_gyro(recording):
        yaw, heading = restored(yaw), restored(heading)
    motion = _motion(recording, shown.car, speed, yaw, heading)
    return replace(motion, grade_rad=old.grade_rad, measured=old.measured)


def _motion(
    recording: Recording, car: Car, speed: FloatArray, yaw: FloatArray, heading: FloatArray
) -> Motion:
    """Return the motion on level ground of speed, yaw rate and heading (n + 1,) at the ticks' edges."""
    edges = recording.edges_s
    curvature = np.divide(yaw, speed, out=np.zeros_like(speed), where=speed > 1.0)
    return Motion(
        time_s=edges,
        distance_m=integrate(speed, edges),
        speed_mps=speed,
        accel_long_mps2=np.gradient(twiced(speed, ACCEL_SMOOTHING_S / recording.dt_s), recording.dt_s),
        accel_lat_mps2=speed * yaw,
        yaw_rate_radps=yaw,
        grade_rad=np.zeros_like(speed),
        heading_rad=heading,
        steering_rad=np.arctan(car.geometry.wheelbase_m * curvature),
    )


def _bus_readings(recording: Recording) -> dict[str, FloatArray]:
    """Return (n + 1,) each, steering, torque and temperature, if the bus has them."""
    out = {}
    wheel = recording.inertial["steering_wheel_angle_rad"]
    if _is_measured(wheel):
        out["steering"] = to_edges(wheel, 1.0)
        out["steering_rate"] = np.gradient(to_edges(wheel, 3.0), recording.dt_s)
    for name, role in (("torque", "drive_torque_nm"), ("temperature", "ambient_temp_k")):
        if _is_measured(recording.inertial[role]):
            out[name] = to_edges(fill(recording.inertial[role]), 1.0)
    return out


def _is_measured(values: FloatArray) -> bool:
    """Return whether more than 80 % of the values are known, and not all equal."""
    known = np.isfinite(values)
    return bool(known.mean() > 0.8 and np.ptp(values[known]) > 0)


def fill(values: FloatArray) -> FloatArray:
    """Return the (n,) values with NaN replaced by interpolation over the index; zeros where nothing is
    known."""
    known = np.isfinite(values)
    if not known.any():
        return np.zeros_like(values)
    return np.interp(np.arange(len(values)), np.flatnonzero(known), values[known])


def to_edges(ticks: FloatArray, sigma: float) -> FloatArray:
    """Return (n + 1,) values at the ticks' edges from their means (n,), smoothed by a Gaussian of `sigma`
    ticks."""
    smooth = twiced(fill(ticks), sigma)
    return np.concatenate([smooth[:1], 0.5 * (smooth[1:] + smooth[:-1]), smooth[-1:]])


def twiced(values: FloatArray, sigma: float) -> FloatArray:
    """Return the values smoothed by a Gaussian, plus the smoothed remainder (Tukey's twicing).

    A single pass flattens every swing, and with it the answer of the channels to a latency or to slip.
    """
    once = gaussian(values, sigma)
    return np.asarray(once + gaussian(values - once, sigma))


def _yaw_and_speed(recording: Recording, car: Car) -> tuple[FloatArray, FloatArray]:
    """Return yaw rate and speed (n + 1,) at the ticks' edges, from a gyro if there is one, and the rear
    wheels."""
    rate = recording.rotation_rad / recording.dt_s * car.radius_m
    sigma = SPEED_SMOOTHING_S / recording.dt_s
    turning = (rate[:, RR] - rate[:, RL]) / car.geometry.track_rear_m
    rear = to_edges((rate[:, RL] + rate[:, RR]) / 2, sigma)
    if _has_gyro(recording):
        by_wheels = to_edges(turning, sigma)
        yaw = to_edges(recording.inertial["yaw_rate_radps"], 0.7)
        rolling = rear > min(COURSE_FROM_MPS, least_speed(rear))
        yaw = yaw - float(np.median((yaw - by_wheels)[rolling])) if np.any(rolling) else yaw
    else:
        yaw = to_edges(turning, _yaw_smoothing_s(recording, car) / recording.dt_s)
    speed = rear
    if np.isfinite(rate[:, [FL, FR]]).all(axis=1).mean() > 0.8:
        unit = np.maximum(rear, 0.5)
        share = wheel_speeds(unit, yaw, car.geometry)
        front = to_edges((rate[:, FL] + rate[:, FR]) / 2, sigma)
        speed = 0.5 * (rear + front * unit / (share[:, FL] + share[:, FR]) * 2)
    return yaw, np.maximum(speed, 0.0)


def _has_gyro(recording: Recording) -> bool:
    """Return whether more than 80 % of the yaw rates are known."""
    return bool(np.isfinite(recording.inertial["yaw_rate_radps"]).mean() > 0.8)


def _yaw_smoothing_s(recording: Recording, car: Car) -> float:
    """Return the width (s) of the Gaussian that smooths the wheels' yaw rate to `YAW_ERROR_RADPS`.

    The error is that of the rear wheels' rounding.

    What a coarse ring leaves of it in the heading's course within a second looks like anything that is later
    or smoother than the wheels: a receiver's lag is not distinguished from a low-pass.
    """
    # Of a turn, which holds the rounding of two readings, for each of the two wheels.
    rounding_m = math.hypot(*(recording.quantum_rad[[RL, RR]] * car.radius_m[[RL, RR]])) / math.sqrt(2.0)
    width = _gaussian_width_s(rounding_m / car.geometry.track_rear_m, recording.dt_s, YAW_ERROR_RADPS)
    return float(np.clip(width, SPEED_SMOOTHING_S, YAW_SMOOTHING_S))


def _gaussian_width_s(scatter: float, every_s: float, rate_error: float) -> float:
    """Return the width (s) of the Gaussian that smooths a signal's rate to an error of `rate_error`.

    The signal has white errors.

    White errors of standard deviation s, one per T seconds, leave s T^(1/2) / (2 pi^(1/4) w^(3/2)) of a
    rate behind a Gaussian of width w.
    """
    return float((scatter * math.sqrt(every_s) / (2.0 * math.pi**0.25 * rate_error)) ** (2.0 / 3.0))


def _radius_scale(recording: Recording, speed: FloatArray, min_mps: float) -> float:
    """Return the factor on the radii that fits the receiver's speeds, or its distances where it gives no
    speeds."""
    at_fix = np.interp(recording.fix_time_s, recording.edges_s, speed)
    usable = np.isfinite(recording.speed_mps) & (at_fix > min_mps)
    if usable.sum() > 30:
        return float(np.median(recording.speed_mps[usable] / at_fix[usable]))
    distance_m = np.interp(recording.fix_time_s, recording.edges_s, integrate(speed, recording.edges_s))
    step = (
        max(1, round(len(distance_m) / max(float(np.ptp(recording.fix_time_s)), 1.0)))
        if len(distance_m) > 2
        else 1
    )
    if len(distance_m) <= step:
        return 1.0
    moved = np.hypot(
        recording.east_m[step:] - recording.east_m[:-step],
        recording.north_m[step:] - recording.north_m[:-step],
    )
    rolled = distance_m[step:] - distance_m[:-step]
    usable = (rolled > min_mps) & np.isfinite(moved)
    return float(np.median(moved[usable] / rolled[usable])) if usable.sum() > 30 else 1.0


def _balanced_radii_m(
    recording: Recording, car: Car, yaw: FloatArray, speed: FloatArray, min_mps: float
) -> FloatArray:
    """Return the (4,) radii with which each wheel rolls as far as the common motion says."""
    middle_v, middle_w = 0.5 * (speed[1:] + speed[:-1]), 0.5 * (yaw[1:] + yaw[:-1])
    expected = wheel_speeds(middle_v, middle_w, car.geometry) * recording.dt_s
    radii = car.radius_m.copy()
    for k in recording.wheels:
        usable = np.isfinite(recording.rotation_rad[:, k]) & (middle_v > min_mps) & (np.abs(middle_w) < 0.1)
        if usable.sum() > 50:
            turned = recording.rotation_rad[usable, k].sum()
            radii[k] *= float(expected[usable, k].sum() / max(turned * radii[k], 1e-9))
    return radii


def _heading(
    recording: Recording, yaw: FloatArray, speed: FloatArray, min_mps: float
) -> tuple[FloatArray, FloatArray]:
    """Return (n + 1,) heading, the integrated yaw rate pulled slowly to the receiver's course, and its
    rate."""
    edges = recording.edges_s
    turned = integrate(yaw, edges)
    time_s, course = _courses(recording)
    moving = np.interp(time_s, edges, speed) > min(COURSE_FROM_MPS, min_mps)
    if moving.sum() < 10:
        return turned, yaw
    drift = _yaw_rate_bias(time_s[moving], course[moving] - np.interp(time_s[moving], edges, turned))
    turned, yaw = turned + drift * edges, yaw + drift
    off = np.unwrap(course[moving] - np.interp(time_s[moving], edges, turned))
    off = running_median(off, 9)
    grid = np.interp(edges, time_s[moving], off)
    lead = gaussian(grid, HEADING_SMOOTHING_S / recording.dt_s, NEAREST)
    return turned + lead, yaw + np.gradient(lead, recording.dt_s)


def _yaw_rate_bias(time_s: FloatArray, off_rad: FloatArray) -> float:
    """Return the median rate of the receiver's course against the integrated yaw rate, rad/s: the gyro's
    bias.

    The gyro's zero was taken from wheels whose radii may differ: over a minute without fixes that is more
    than half a turn.
    """
    step = np.diff(time_s)
    near = (step > 0.0) & (step < DRIFT_WITHIN_S)
    if near.sum() < 10:
        return 0.0
    turn = np.remainder(np.diff(off_rad)[near] + np.pi, 2.0 * np.pi) - np.pi
    return float(np.median(turn / step[near]))


def _courses(recording: Recording) -> tuple[FloatArray, FloatArray]:
    """Return times and courses of the receiver; from positions about a second apart where it gives none."""
    known = np.isfinite(recording.course_rad)
    if known.sum() > 0.3 * len(known):
        return recording.fix_time_s[known], recording.course_rad[known]
    time_s, east, north = recording.fix_time_s, recording.east_m, recording.north_m
    if len(time_s) < 3:
        return np.empty(0), np.empty(0)
    later = np.minimum(np.searchsorted(time_s, time_s + 1.0), len(time_s) - 1)
    de, dn = east[later] - east, north[later] - north
    fit = (np.hypot(de, dn) > 2.0) & (time_s[later] - time_s < 3.0)
    return 0.5 * (time_s + time_s[later])[fit], np.arctan2(dn, de)[fit]


def _slope(height_m: FloatArray, speed: FloatArray, sigma: float, dt: float) -> FloatArray:
    """Return (n + 1,) rise over distance of heights smoothed by a Gaussian of `sigma` ticks."""
    height = twiced(height_m, sigma)
    smoothed = gaussian(speed, sigma, NEAREST)
    slope = np.where(smoothed > 1.0, np.gradient(height, dt) / np.maximum(smoothed, 1.0), 0.0)
    return np.asarray(np.clip(slope, -0.25, 0.25))


def slope_by_heights(recording: Recording, speed: FloatArray) -> FloatArray | None:
    """Return (n + 1,) rise over distance by the heights alone at speeds (n + 1,); None where they are too
    few."""
    known = np.isfinite(recording.up_m)
    if known.sum() <= FEWEST_HEIGHTS:
        return None
    up = np.interp(recording.edges_s, recording.fix_time_s[known], recording.up_m[known])
    return _slope(up, speed, HEIGHT_SMOOTHING_S / recording.dt_s, recording.dt_s)


def _height_smoothing_s(time_s: FloatArray, up_m: FloatArray, speed_mps: float) -> float:
    """Return the width (s) of the Gaussian behind which the heights' scatter leaves `SLOPE_ERROR` of slope.

    The scatter is that of second differences, by their median.
    """
    second = np.diff(up_m, 2)
    scatter = max(float(np.median(np.abs(second))) / 0.6745 / math.sqrt(6.0), 0.03)
    every_s = float(np.median(np.diff(time_s)))
    width = _gaussian_width_s(scatter, every_s, SLOPE_ERROR * max(speed_mps, 1.0))
    return float(np.clip(width, MIN_SMOOTHING_S, HEIGHT_SMOOTHING_S))


def _grade(recording: Recording, speed: FloatArray, accel: FloatArray) -> tuple[FloatArray, str]:
    """Return (n + 1,) grade (rad): slow part from heights, fast part from the accelerometer; and its
    source."""
    edges = recording.edges_s
    dt = recording.dt_s
    by_heights = slope_by_heights(recording, speed)
    have_heights = by_heights is not None
    slow = np.zeros_like(edges) if by_heights is None else by_heights
    known = np.isfinite(recording.up_m)
    time_s, up = recording.fix_time_s[known], recording.up_m[known]
    force = recording.inertial["accel_long_mps2"]
    if np.isfinite(force).mean() < 0.8:
        moving = speed > 3.0
        if not have_heights or not moving.any() or float(np.std(slow[moving])) < FLAT_BELOW:
            return np.zeros_like(edges), "nothing"
        width_s = _height_smoothing_s(time_s, up, float(np.median(speed[moving])))
        return np.arcsin(_slope(np.interp(edges, time_s, up), speed, width_s / dt, dt)), "heights"
    gravity = (to_edges(force, 1.0) - accel) / GRAVITY_MPS2
    gravity = gaussian(gravity, GRADE_SMOOTHING_S / dt, NEAREST)
    moving = speed > 3.0
    if have_heights and moving.sum() > 100:
        gravity = gravity - float(np.mean((gravity - slow)[moving]))
    return np.arcsin(np.clip(gravity, -0.3, 0.3)), "accelerometer"
