"""What a drive measures, in windows of a second, as linear equations about the nominal motion.

In: `Recording`, `Nominal`, `Vehicle`. Out: `Windows`: residuals y, what they see of the windows' unknown
motion (H), and what they see of the parameters (X), such that y = H s + X theta + noise.

The motion (speed and yaw rate of each window, heading, position) is as unknown as the parameters: each
wheel, the gyro and the receiver merely measure it, and none of them is trusted alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.calibration.nominal import Nominal, Vehicle
from tpmsd.calibration.recording import Recording
from tpmsd.physics.kinematics import wheel_speeds
from tpmsd.physics.motion import GRAVITY_MPS2
from tpmsd.wheels import IS_FRONT, IS_LEFT, WHEELS, FloatArray

WINDOW_S = 1.0
GYRO, SPEED, COURSE, EAST, NORTH = 4, 5, 6, 7, 8
CHANNELS = 9
"""Rows of a window: the way of the four wheels, then these."""

(Q, QOLD, V, W, PSI, BETA, PE, PN, BE, BN, DS, DC, GB, LATE, LEAN) = (0, 4, *range(8, 21))
STATES = 21
"""Reading errors of the wheels' angles at the window's end and start (a count's error at an edge enters two
windows with opposite signs), errors of nominal speed and yaw rate (fresh in every window), of heading, the
axle's crab angle, position, the receiver's slow position error, its slow velocity error (along, across), the
gyro's bias, what the fixes' age has drifted, and what a slanting road or a side wind takes from the radii of
one side and gives to those of the other (relative)."""

PARAMETERS = (
    *(f"radius_{wheel}" for wheel in WHEELS),
    "track_rear",
    "track_front",
    "antenna_forward",
    "antenna_left",
    "load_lateral",
    "slip_long",
    "slip_lateral",
    "growth",
    "gyro_gain",
    "latency",
    "doppler_lag",
)
"""Radii, tracks and gyro gain relative to the present ones; the others in SI units, with the signs of the
effects in `tpmsd.physics`. The last two belong to each drive."""
PIECES = 4
CHANGES = tuple(f"change_{wheel}_{piece}" for wheel in WHEELS for piece in range(PIECES))
"""Relative changes of single wheels, each over one quarter of the drive. They are let in only where noise
and outliers are judged, so that a tyre that loses pressure does not pass for noise; a calibration holds
none."""
COLUMNS = PARAMETERS + CHANGES
LOCAL = ("latency", "doppler_lag", *CHANGES)

MOVING_MPS = 3.0
"""Slower than this, Doppler speed (a magnitude) is biased and courses are loose."""
MAX_ACCEL_MPS2 = 2.5
"""Harder than this the tyres slip too much to be modelled: such windows' wheels weigh little."""
ROUGH_PENALTY = 0.02
_STOPPED_MPS = 0.3


@dataclass(frozen=True)
class Windows:
    """Arrays over k windows; NaN in `y` is: not measured."""

    y: FloatArray
    """(k, 9) metres per window, rad, m/s, rad, metres."""
    H: FloatArray
    """(k, 9, 21)"""
    X: FloatArray
    """(k, 9, p) by `COLUMNS`."""
    grow: FloatArray
    """(k, 2, 3) derivative of the window's way east and north by speed, yaw rate and heading errors."""
    speed_mps: FloatArray
    turn_rad: FloatArray
    time_s: FloatArray
    """Middle of each window."""
    fixes: FloatArray
    """(k, 3) how many speeds, courses and positions were averaged."""
    reading_m: FloatArray
    """(4,) standard deviation of a wheel's way at an instant by its counts."""
    extra_m2: FloatArray
    """(k,) variance added to the wheels' ways where they may slip."""

    def __len__(self) -> int:
        return len(self.y)


def make_windows(
    recording: Recording, motion: Nominal, car: Vehicle, reference_speed_mps: float = 0.0
) -> Windows:
    """Linearise a drive. Ticks beyond the last whole window are left out.

    A radius is that at the reference speed: `growth` acts on v^2 beyond its square.
    """
    m = max(round(WINDOW_S / recording.dt_s), 1)
    k = len(recording.rotation_rad) // m
    T = m * recording.dt_s
    mid = _Mid(recording, motion, car, m, k)
    y, H = np.full((k, CHANNELS), math.nan), np.zeros((k, CHANNELS, STATES))
    X = np.zeros((k, CHANNELS, len(COLUMNS)))
    _wheel_rows(recording, car, mid, y, H, X, reference_speed_mps)
    _gyro_row(recording, mid, y, H, X)
    fixes = _receiver_rows(recording, motion, mid, y, H, X)
    at_s = (np.arange(k) + 0.5) / max(k, 1) * PIECES
    for piece in range(PIECES):
        course = np.clip(at_s - piece, 0.0, 1.0)
        for wheel in range(4):
            X[:, wheel, len(PARAMETERS) + wheel * PIECES + piece] = X[:, wheel, wheel] * course
    unusable = ~np.isfinite(y)
    H[unusable], X[unusable] = 0.0, 0.0
    hard = np.abs(mid.accel) > MAX_ACCEL_MPS2
    return Windows(
        y=y,
        H=H,
        X=X,
        grow=mid.grow,
        speed_mps=mid.speed,
        turn_rad=mid.yaw * T,
        time_s=np.asarray((np.arange(k) + 0.5) * T, dtype=np.float64),
        fixes=fixes,
        reading_m=recording.reading_std_rad * car.radius_m,
        extra_m2=hard * (ROUGH_PENALTY * mid.speed * T) ** 2,
    )


class _Mid:
    """The nominal motion's means over the windows."""

    def __init__(self, recording: Recording, motion: Nominal, car: Vehicle, m: int, k: int) -> None:
        self.m, self.k, self.T = m, k, m * recording.dt_s
        dt = recording.dt_s
        n = k * m

        def ticks(edges: FloatArray) -> FloatArray:
            return (0.5 * (edges[1:] + edges[:-1]))[:n].reshape(k, m)

        v, w = ticks(motion.speed_mps), ticks(motion.yaw_rate_radps)
        grade = ticks(motion.grade_rad)
        self.v, self.w = v, w
        self.speed, self.yaw = v.mean(axis=1), w.mean(axis=1)
        self.accel = ticks(motion.accel_mps2).mean(axis=1)
        self.force = self.accel + GRAVITY_MPS2 * np.sin(grade).mean(axis=1)
        self.lateral = (v * w).mean(axis=1)
        heading = ticks(motion.heading_rad)
        cos, sin, flat = np.cos(heading), np.sin(heading), np.cos(grade)
        since = (np.arange(m) + 0.5) * dt
        way = v * flat * dt
        self.grow = np.stack(
            [
                np.stack(
                    [(flat * cos).sum(1) * dt, -(way * since * sin).sum(1), -(way * sin).sum(1)], axis=1
                ),
                np.stack([(flat * sin).sum(1) * dt, (way * since * cos).sum(1), (way * cos).sum(1)], axis=1),
            ],
            axis=1,
        )
        self.paths = wheel_speeds(v, w, car.geometry) * dt
        self.wheelbase = car.geometry.wheelbase_m


def _wheel_rows(
    recording: Recording,
    car: Vehicle,
    mid: _Mid,
    y: FloatArray,
    H: FloatArray,
    X: FloatArray,
    reference_mps: float,
) -> None:
    """Way by a wheel's rotation minus the way of its hub."""
    n = mid.k * mid.m
    geometry = car.geometry
    angle = recording.rotation_rad[:n].reshape(mid.k, mid.m, 4).sum(axis=1)
    way = angle * car.radius_m
    paths = mid.paths.sum(axis=1)
    half = (geometry.track_front_m / 2, geometry.track_front_m / 2, geometry.track_rear_m / 2)
    for wheel in recording.wheels:
        side = -1.0 if IS_LEFT[wheel] else 1.0
        arm = half[min(wheel, 2)]
        along = mid.v + side * mid.w * arm
        if IS_FRONT[wheel]:
            lateral = mid.w * mid.wheelbase
            hub = np.maximum(np.hypot(along, lateral), 1e-3)
            by_v = (along / hub).mean(axis=1)
            by_w = ((along * side * arm + lateral * mid.wheelbase) / hub).mean(axis=1)
            by_track = (along / hub * side * mid.w * arm).mean(axis=1)
        else:
            by_v, by_w = np.ones(mid.k), np.full(mid.k, side * arm)
            by_track = side * mid.yaw * arm
        standing = (paths[:, wheel] < _STOPPED_MPS * mid.T) & (np.abs(way[:, wheel]) < _STOPPED_MPS * mid.T)
        y[:, wheel] = np.where(standing, math.nan, way[:, wheel] - paths[:, wheel])
        # What load transfer makes a wheel show grows with speed and yaw rate, so it sees their errors, too.
        leaning = np.nan_to_num(angle[:, wheel]) * side * car.load_lateral_s2
        H[:, wheel, V], H[:, wheel, W] = by_v * mid.T + leaning * mid.yaw, by_w * mid.T + leaning * mid.speed
        H[:, wheel, Q + wheel], H[:, wheel, QOLD + wheel] = 1.0, -1.0
        H[:, wheel, LEAN] = side * paths[:, wheel]
        full = np.nan_to_num(angle[:, wheel])
        X[:, wheel, wheel] = -full * car.radius_m[wheel]
        X[:, wheel, _at("track_front" if IS_FRONT[wheel] else "track_rear")] = by_track * mid.T
        X[:, wheel, _at("load_lateral")] = full * side * mid.lateral
        X[:, wheel, _at("slip_long")] = float(car.driven[wheel]) * paths[:, wheel] * mid.force
        X[:, wheel, _at("growth")] = -full * (mid.speed**2 - reference_mps**2)


def _gyro_row(recording: Recording, mid: _Mid, y: FloatArray, H: FloatArray, X: FloatArray) -> None:
    gyro = recording.gyro_radps[: mid.k * mid.m].reshape(mid.k, mid.m)
    y[:, GYRO] = gyro.mean(axis=1) - mid.yaw
    H[:, GYRO, W] = H[:, GYRO, GB] = 1.0
    X[:, GYRO, _at("gyro_gain")] = mid.yaw


def _receiver_rows(
    recording: Recording, motion: Nominal, mid: _Mid, y: FloatArray, H: FloatArray, X: FloatArray
) -> FloatArray:
    """Speeds, courses and positions minus those of the nominal antenna, averaged over each window."""
    forward, left = recording.antenna_forward_m, recording.antenna_left_m
    t = recording.fix_time_s
    at = {name: np.interp(t, motion.time_s, getattr(motion, name)) for name in _AT_FIXES}
    v, w, psi = at["speed_mps"] * np.cos(at["grade_rad"]), at["yaw_rate_radps"], at["heading_rad"]
    cos, sin = np.cos(psi), np.sin(psi)
    vx, vy = v - w * left, w * forward
    moving = v > MOVING_MPS
    course = psi + np.arctan2(vy, np.maximum(vx, 0.1))
    parts = {
        SPEED: np.where(moving, recording.speed_mps - np.hypot(vx, vy), math.nan),
        COURSE: np.where(
            moving, np.remainder(recording.heading_rad - course + math.pi, 2 * math.pi) - math.pi, math.nan
        ),
        EAST: recording.east_m - (at["east_m"] + forward * cos - left * sin),
        NORTH: recording.north_m - (at["north_m"] + forward * sin + left * cos),
    }
    place = np.floor(t / mid.T).astype(int)
    inside = (place >= 0) & (place < mid.k)
    late = 1.0 - (t / mid.T - place)  # share of the window that follows the fix
    numbers = np.zeros((mid.k, 3))
    for column, channel in ((0, SPEED), (1, COURSE), (2, EAST), (2, NORTH)):
        use = inside & np.isfinite(parts[channel])
        count = np.bincount(place[use], minlength=mid.k).astype(np.float64)
        numbers[:, column] = count

        def mean(values: FloatArray, use: np.ndarray = use, count: FloatArray = count) -> FloatArray:
            total = np.bincount(place[use], weights=values[use], minlength=mid.k)
            out = np.full(mid.k, math.nan)
            np.divide(total, count, out=out, where=count > 0)
            return out

        y[:, channel] = mean(parts[channel])
        after = mean(late)
        if channel == SPEED:
            H[:, SPEED, V], H[:, SPEED, W], H[:, SPEED, DS] = 1.0, -left, 1.0
            accel = mean(at["accel_mps2"])
            H[:, SPEED, LATE] = -accel
            X[:, SPEED, _at("latency")] = X[:, SPEED, _at("doppler_lag")] = -accel
            X[:, SPEED, _at("antenna_left")] = -mean(w)
        elif channel == COURSE:
            swing, yaw, speed = mean(forward / np.maximum(v, 1.0)), mean(w), mean(np.maximum(v, 1.0))
            H[:, COURSE, PSI] = H[:, COURSE, BETA] = 1.0
            H[:, COURSE, W] = swing - after * mid.T
            H[:, COURSE, DC] = 1.0 / speed
            H[:, COURSE, LATE] = -yaw
            X[:, COURSE, _at("latency")] = X[:, COURSE, _at("doppler_lag")] = -yaw
            X[:, COURSE, _at("antenna_forward")] = yaw / speed
            X[:, COURSE, _at("slip_lateral")] = -mid.lateral
        else:
            axis = channel - EAST
            grow = mid.grow[:, axis]
            arm = mean(-forward * sin - left * cos if axis == 0 else forward * cos - left * sin)
            velocity = mean(vx * cos - vy * sin if axis == 0 else vx * sin + vy * cos)
            H[:, channel, PE + axis] = H[:, channel, BE + axis] = 1.0
            H[:, channel, V] = -after * grow[:, 0]
            H[:, channel, W] = 0.5 * after**2 * mid.T * grow[:, 2] - after * mid.T * arm
            H[:, channel, PSI] = arm - after * grow[:, 2]
            H[:, channel, BETA] = -after * grow[:, 2]
            H[:, channel, LATE] = -velocity
            X[:, channel, _at("latency")] = -velocity
            X[:, channel, _at("antenna_forward")] = mean(cos if axis == 0 else sin)
            X[:, channel, _at("antenna_left")] = mean(-sin if axis == 0 else cos)
            drift = -mid.lateral * grow[:, 2]
            X[:, channel, _at("slip_lateral")] = np.cumsum(drift) - after * drift
    return numbers


_AT_FIXES = ("speed_mps", "yaw_rate_radps", "heading_rad", "grade_rad", "east_m", "north_m", "accel_mps2")


def _at(name: str) -> int:
    return PARAMETERS.index(name)
