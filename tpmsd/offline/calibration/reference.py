"""First layer of [KF-WLS]: the reference pose from receiver and inertial signals, and the side-slip.

In: `Recording`, `Vehicle`. Out: `ReferencePose` at the ticks' edges, smoothed over the whole drive.

Position: p'' = a per axis (section 3.1), as a Kalman smoother with the accelerations of the bus as input
where it has them, else those of the wheels. Heading: the yaw rate (of the bus, else of the wheels) with a
drifting bias, held to the compass where there is one, else to the receiver's course. Side-slip: course minus
compass, regressed on the lateral acceleration (beta = -c * a_y); without a compass nothing tells it from the
heading, and it is taken as none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from tpmsd.foundation.wheels import RL, RR, FloatArray
from tpmsd.offline.calibration.nominal import Vehicle, courses, nominal_motion
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import fill

POSITION_STD_M, ACCEL_STD_MPS2 = 1.0, 0.3
COURSE_STD_RAD, COMPASS_STD_RAD = 0.02, 0.035
GYRO_STD_RADPS, GYRO_DRIFT_RADPS = 0.005, 1e-4
MOVING_MPS = 3.0


@dataclass(frozen=True)
class ReferencePose:
    """Arrays (n + 1,) at the ticks' edges."""

    east_m: FloatArray
    north_m: FloatArray
    """Middle of the rear axle."""
    heading_rad: FloatArray
    side_slip_rad: FloatArray


def reference_pose(recording: Recording, car: Vehicle, side_slip: bool = True) -> ReferencePose:
    """Return the reference pose at the ticks' edges, smoothed from receiver and inertial signals."""
    dt, edges = recording.dt_s, recording.edges_s
    rate = recording.rotation_rad / dt * car.radius_m
    rear = np.stack([fill(rate[:, RL]), fill(rate[:, RR])], axis=1)
    by_wheels = (rear[:, 1] - rear[:, 0]) / car.geometry.track_rear_m
    gyro = recording.inertial["yaw_rate_radps"]
    yaw = fill(gyro) if np.isfinite(gyro).mean() > 0.8 else by_wheels
    speed = gaussian_filter1d(rear.mean(axis=1), 0.3 / dt, mode="nearest")
    lateral = recording.inertial["accel_lat_mps2"]
    lateral = fill(lateral) if np.isfinite(lateral).mean() > 0.8 else speed * yaw
    long = recording.inertial["accel_long_mps2"]
    long = fill(long) if np.isfinite(long).mean() > 0.8 else np.gradient(speed, dt)
    start = nominal_motion(recording, car).heading_rad
    slip = np.zeros(len(edges))
    heading = _smoothed_heading(recording, yaw, slip, start, speed)
    compass = recording.inertial.get("compass_rad")
    if side_slip and compass is not None and np.isfinite(compass).mean() > 0.5:
        slip = np.concatenate([[0.0], -_slip_per_accel(recording, heading, lateral, speed) * lateral])
    if compass is None or not np.isfinite(compass).any():
        heading = _smoothed_heading(recording, yaw, slip, start, speed)
    middle = 0.5 * (heading[1:] + heading[:-1])
    cos, sin = np.cos(middle), np.sin(middle)
    accel = np.stack([long * cos - lateral * sin, long * sin + lateral * cos], axis=1)
    at_fix = np.interp(recording.fix_time_s, edges, heading)
    forward, left = recording.car.antenna_forward_m, recording.car.antenna_left_m
    axle = np.stack(
        [
            recording.east_m - forward * np.cos(at_fix) + left * np.sin(at_fix),
            recording.north_m - forward * np.sin(at_fix) - left * np.cos(at_fix),
        ],
        axis=1,
    )
    position = _smoothed_position(recording.fix_time_s, axle, accel, dt, len(edges))
    return ReferencePose(position[:, 0], position[:, 1], heading, slip)


def _wrap_angle(angle: FloatArray) -> FloatArray:
    """Return the angle within -pi to pi."""
    return np.asarray(np.remainder(angle + math.pi, 2 * math.pi) - math.pi)


def _smoothed_heading(
    recording: Recording, yaw: FloatArray, slip: FloatArray, start: FloatArray, speed: FloatArray
) -> FloatArray:
    """Return the (n + 1,) heading by a Kalman smoother over (heading, bias); `start` resolves multiples of a
    full turn.
    """
    dt, count = recording.dt_s, len(yaw) + 1
    total, number = np.zeros(count), np.zeros(count)  # information and its product with the reading
    compass = recording.inertial.get("compass_rad")
    if compass is not None and np.isfinite(compass).any():
        known = np.flatnonzero(np.isfinite(compass))
        number[known + 1] += 1.0 / COMPASS_STD_RAD**2
        total[known + 1] += (start[known + 1] + _wrap_angle(compass[known] - start[known + 1])) / (
            COMPASS_STD_RAD**2
        )
    else:
        time_s, course = courses(recording)
        index = np.clip(np.rint(time_s / dt).astype(int), 0, count - 1)
        moving = speed[np.clip(index, 0, count - 2)] > MOVING_MPS
        for at, angle in zip(index[moving], course[moving], strict=True):
            number[at] += 1.0 / COURSE_STD_RAD**2
            total[at] += (start[at] + float(_wrap_angle(angle - slip[at] - start[at]))) / COURSE_STD_RAD**2
    reading = np.divide(total, number, out=np.full(count, math.nan), where=number > 0)
    F = np.array([[1.0, -dt], [0.0, 1.0]])
    noise = np.diag([(GYRO_STD_RADPS * dt) ** 2 * 10.0, GYRO_DRIFT_RADPS**2 * dt])
    first = np.flatnonzero(np.isfinite(reading))
    begin = np.array([reading[first[0]] if first.size else start[0], 0.0])
    inputs = np.stack([yaw * dt, np.zeros_like(yaw)], axis=1)
    return _smooth_states(begin, np.diag([0.5, 0.01]), F, noise, inputs, reading, number)[:, 0]


def _slip_per_accel(
    recording: Recording, heading: FloatArray, lateral: FloatArray, speed: FloatArray
) -> float:
    """Return the side-slip coefficient c of beta = -c * a_y (s2/m), fitted jointly with the compass's offset;
    0 with too few courses.
    """
    time_s, course = courses(recording)
    at = np.clip((time_s / recording.dt_s).astype(int), 0, len(lateral) - 1)
    moving = speed[at] > MOVING_MPS
    smooth = gaussian_filter1d(lateral, 0.5 / recording.dt_s, mode="nearest")
    off = _wrap_angle(course - np.interp(time_s, recording.edges_s, heading))[moving]
    if off.size < 30:
        return 0.0
    design = np.stack([-smooth[at][moving], np.ones(off.size)], axis=1)
    return float(np.clip(np.linalg.lstsq(design, off, rcond=None)[0][0], -0.02, 0.02))


def _smoothed_position(
    time_s: FloatArray, axle: FloatArray, accel: FloatArray, dt: float, count: int
) -> FloatArray:
    """Return the (n + 1, 2) positions, each axis by a Kalman smoother over (position, velocity)."""
    known = np.isfinite(axle).all(axis=1)
    index = np.clip(np.rint(time_s / dt).astype(int), 0, count - 1)[known]
    number = np.bincount(index, minlength=count) / POSITION_STD_M**2
    # A fix lies up to half a tick from the edge that it is put to: it is moved there at the local velocity.
    velocity = np.gradient(axle[known], time_s[known], axis=0) if known.sum() > 2 else np.zeros((0, 2))
    moved = axle[known] + np.clip(velocity, -80.0, 80.0) * (index * dt - time_s[known])[:, None]
    F = np.array([[1.0, dt], [0.0, 1.0]])
    noise = ACCEL_STD_MPS2**2 * np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])
    out = np.zeros((count, 2))
    for axis in (0, 1):
        sums = np.bincount(index, weights=moved[:, axis], minlength=count)
        counts = np.bincount(index, minlength=count)
        reading = np.divide(sums, counts, out=np.full(count, math.nan), where=counts > 0)
        inputs = np.stack([0.5 * dt**2 * accel[:, axis], dt * accel[:, axis]], axis=1)
        begin = np.array([moved[0, axis] if len(moved) else 0.0, 0.0])
        out[:, axis] = _smooth_states(begin, np.diag([25.0, 900.0]), F, noise, inputs, reading, number)[:, 0]
    return out


def _smooth_states(
    mean: FloatArray,
    P: FloatArray,
    F: FloatArray,
    noise: FloatArray,
    inputs: FloatArray,
    reading: FloatArray,
    information: FloatArray,
) -> FloatArray:
    """Return the (n + 1, 2) states by a Kalman filter and Rauch-Tung-Striebel smoother; the first of the two
    states is measured.
    """
    count = len(reading)
    means, covariances = np.zeros((count, 2)), np.zeros((count, 2, 2))
    ahead, spread = np.zeros((count, 2)), np.zeros((count, 2, 2))
    for k in range(count):
        if k:
            mean, P = F @ mean + inputs[k - 1], F @ P @ F.T + noise
        ahead[k], spread[k] = mean, P
        if math.isfinite(reading[k]):
            gain = P[:, 0] / (P[0, 0] + 1.0 / information[k])
            mean = mean + gain * (reading[k] - mean[0])
            P = P - np.outer(gain, P[0])
        means[k], covariances[k] = mean, P
    for k in range(count - 2, -1, -1):
        G = covariances[k] @ F.T @ np.linalg.inv(spread[k + 1])
        means[k] = means[k] + G @ (means[k + 1] - ahead[k + 1])
    return means
