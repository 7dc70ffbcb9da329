"""What a drive measures, in windows of a second, as linear equations about the nominal motion.

In: `Recording`, `Nominal`, `Vehicle`. Out: `Equations`: residuals y, what they see of the windows' unknown
motion, and what they see of the parameters (X), such that y = H s + X theta + noise with the states s of
`LEANING_CAR`.

The motion (speed and yaw rate of each window, heading, position) is as unknown as the parameters: each
wheel, the gyro and the receiver merely measure it, and none of them is trusted alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.calibration.nominal import Nominal, Vehicle, calibrated_wheels
from tpmsd.inference.recording import Recording
from tpmsd.inference.trajectory import WINDOW_S
from tpmsd.inference.windows import CHANNELS, COURSE, EAST, GYRO, NORTH, SPEED, Linearised
from tpmsd.physics.kinematics import wheel_speeds
from tpmsd.physics.motion import GRAVITY_MPS2
from tpmsd.wheels import IS_FRONT, IS_LEFT, WHEELS, FloatArray

V, W, PSI = 0, 1, 2
"""Columns of a `Linearised` design."""
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
SLIPPING = 1e4
"""Factor on the variance of such a wheel's way: slip of a few per cent is a hundred times road noise."""
_STOPPED_MPS = 0.3


@dataclass(frozen=True)
class Equations(Linearised):
    """One drive's, over w windows from its start; NaN in `y` is: not measured."""

    y: FloatArray
    """(w, 9) metres per window, rad/s, m/s, rad, metres: measured minus nominal."""
    X: FloatArray
    """(w, 9, p) by `COLUMNS`."""
    inflate: FloatArray
    """(w, 9) factors on the variances: large where the wheels may slip."""

    @property
    def here(self) -> np.ndarray:
        """(w, 9) what was measured."""
        return np.isfinite(self.y)

    @property
    def data(self) -> FloatArray:
        """(w, 9, 1 + p) residuals and columns side by side."""
        return np.concatenate([np.nan_to_num(self.y)[:, :, None], self.X], axis=2)


def make_equations(
    recording: Recording, motion: Nominal, car: Vehicle, reference_speed_mps: float = 0.0
) -> Equations:
    """Linearise a drive. Ticks beyond the last whole window are left out.

    A radius is that at the reference speed: `growth` acts on v^2 beyond its square.
    """
    m = max(round(WINDOW_S / recording.dt_s), 1)
    mid = _Mid(recording, motion, car, m, recording.ticks // m)
    k = mid.k
    rows = _Rows(
        np.full((k, CHANNELS), math.nan), np.zeros((k, CHANNELS, 3)), np.zeros((k, CHANNELS, len(COLUMNS)))
    )
    _wheel_rows(recording, car, mid, rows, reference_speed_mps)
    _gyro_row(recording, mid, rows)
    fixes, after, accel = _receiver_rows(recording, motion, mid, rows)
    at_s = (np.arange(k) + 0.5) / max(k, 1) * PIECES
    for piece in range(PIECES):
        course = np.clip(at_s - piece, 0.0, 1.0)
        for wheel in range(4):
            rows.X[:, wheel, len(PARAMETERS) + wheel * PIECES + piece] = rows.X[:, wheel, wheel] * course
    rows.X[~np.isfinite(rows.y)] = 0.0
    inflate = np.ones((k, CHANNELS))
    inflate[np.abs(mid.accel) > MAX_ACCEL_MPS2, :GYRO] = SLIPPING
    return Equations(
        index=np.arange(k),
        fixes=fixes,
        after_fixes=after,
        covariates={"speed": mid.speed, "yaw_rate": mid.yaw, "accel_kinematic": accel},
        design=np.nan_to_num(rows.design),
        to_east_north=mid.grow,
        y=rows.y,
        X=rows.X,
        inflate=inflate,
    )


@dataclass(frozen=True)
class _Rows:
    """What is filled in channel by channel; shapes as in `Equations`."""

    y: FloatArray
    design: FloatArray
    X: FloatArray

    @classmethod
    def empty(cls, count: int) -> _Rows:
        """Nothing measured."""
        y = np.full((count, CHANNELS), math.nan)
        return cls(y, np.zeros((count, CHANNELS, 3)), np.zeros((count, CHANNELS, len(COLUMNS))))


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
    rows: _Rows,
    reference_mps: float,
) -> None:
    """Way by a wheel's rotation minus the way of its hub."""
    y, H, X = rows.y, rows.design, rows.X
    n = mid.k * mid.m
    geometry = car.geometry
    angle = recording.rotation_rad[:n].reshape(mid.k, mid.m, 4).sum(axis=1)
    way = angle * car.radius_m
    paths = mid.paths.sum(axis=1)
    half = (geometry.track_front_m / 2, geometry.track_front_m / 2, geometry.track_rear_m / 2)
    for wheel in calibrated_wheels(recording):
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
        full = np.nan_to_num(angle[:, wheel])
        X[:, wheel, wheel] = -full * car.radius_m[wheel]
        X[:, wheel, _at("track_front" if IS_FRONT[wheel] else "track_rear")] = by_track * mid.T
        X[:, wheel, _at("load_lateral")] = full * side * mid.lateral
        X[:, wheel, _at("slip_long")] = float(car.driven[wheel]) * paths[:, wheel] * mid.force
        X[:, wheel, _at("growth")] = -full * (mid.speed**2 - reference_mps**2)


def _gyro_row(recording: Recording, mid: _Mid, rows: _Rows) -> None:
    gyro = recording.inertial["yaw_rate_radps"][: mid.k * mid.m].reshape(mid.k, mid.m)
    rows.y[:, GYRO] = gyro.mean(axis=1) - mid.yaw
    rows.design[:, GYRO, W] = 1.0
    rows.X[:, GYRO, _at("gyro_gain")] = mid.yaw


def _receiver_rows(
    recording: Recording, motion: Nominal, mid: _Mid, rows: _Rows
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Speeds, courses and positions minus those of the nominal antenna, averaged over each window: how many
    there were (w, 3), which share of the window follows them (w, 3), the acceleration at the speeds (w,)."""
    y, H, X = rows.y, rows.design, rows.X
    forward, left = recording.car.antenna_forward_m, recording.car.antenna_left_m
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
            moving, np.remainder(recording.course_rad - course + math.pi, 2 * math.pi) - math.pi, math.nan
        ),
        EAST: recording.east_m - (at["east_m"] + forward * cos - left * sin),
        NORTH: recording.north_m - (at["north_m"] + forward * sin + left * cos),
    }
    place = np.floor(t / mid.T).astype(int)
    inside = (place >= 0) & (place < mid.k)
    late = 1.0 - (t / mid.T - place)  # share of the window that follows the fix
    numbers, shares, accel = np.zeros((mid.k, 3)), np.zeros((mid.k, 3)), np.zeros(mid.k)
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
        shares[:, column] = np.nan_to_num(after)
        if channel == SPEED:
            H[:, SPEED, V], H[:, SPEED, W] = 1.0, -left
            accel = mean(at["accel_mps2"])
            X[:, SPEED, _at("latency")] = X[:, SPEED, _at("doppler_lag")] = -accel
            X[:, SPEED, _at("antenna_left")] = -mean(w)
        elif channel == COURSE:
            yaw, speed = mean(w), mean(np.maximum(v, 1.0))
            H[:, COURSE, PSI] = 1.0
            H[:, COURSE, W] = mean(forward / np.maximum(v, 1.0))
            X[:, COURSE, _at("latency")] = X[:, COURSE, _at("doppler_lag")] = -yaw
            X[:, COURSE, _at("antenna_forward")] = yaw / speed
            X[:, COURSE, _at("slip_lateral")] = -mid.lateral
        else:
            axis = channel - EAST
            grow = mid.grow[:, axis]
            arm = mean(-forward * sin - left * cos if axis == 0 else forward * cos - left * sin)
            velocity = mean(vx * cos - vy * sin if axis == 0 else vx * sin + vy * cos)
            H[:, channel, W] = 0.5 * after**2 * mid.T * grow[:, 2] - after * mid.T * arm
            H[:, channel, PSI] = arm
            X[:, channel, _at("latency")] = -velocity
            X[:, channel, _at("antenna_forward")] = mean(cos if axis == 0 else sin)
            X[:, channel, _at("antenna_left")] = mean(-sin if axis == 0 else cos)
            drift = -mid.lateral * grow[:, 2]
            X[:, channel, _at("slip_lateral")] = np.cumsum(drift) - after * drift
    return numbers, shares, np.nan_to_num(accel)


_AT_FIXES = ("speed_mps", "yaw_rate_radps", "heading_rad", "grade_rad", "east_m", "north_m", "accel_mps2")


def _at(name: str) -> int:
    return PARAMETERS.index(name)
