"""An independent look at recorded drives: plain least squares on windows of a second.

    python -m bench run independent-look ../shared/recordings/*
    python -m bench run independent-look --together ../shared/recordings/van-*

It shares nothing with `tpmsd diagnose` but the reading of the files: no filter, no noise model, no catalogue,
no selection. Ratios of wheels and of wheel and receiver are regressed on what physics might make them depend
on; standard deviations come from a bootstrap over blocks of 30 s, which needs no noise model either.
`bench/results/real-recordings.md` sets its figures beside those of the diagnosis.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config
from tpmsd.interfaces.cli.drive_reading import read_ticks

Array = NDArray[np.float64]
RATE_HZ = 10.0
BLOCK = 30
DRAWS = 500
STRETCH_S = 100
MIN_SPEED_MPS = 6.0
FL, FR, RL, RR = range(4)


@dataclass(frozen=True)
class Seconds:
    """Windows of a second; arrays (n,) or (n, 4), NaN where not measured."""

    angle: Array
    """Turn of each wheel, rad."""
    gyro: Array
    speed: Array
    """Of the receiver, by Doppler."""
    course: Array
    """Unwrapped, counter-clockwise."""
    east: Array
    north: Array
    up: Array
    rolled: Array
    """Speed of the rear axle by its wheels and the configured radius."""
    accel: Array
    """By the wheels, between the neighbouring windows."""
    yaw: Array
    """By the gyro where there is one, less its bias against the course; else from the way over ground."""


def read(folder: Path, config: Config) -> Seconds:
    """A drive folder as windows of a second."""
    ticks = read_ticks(folder, config, RATE_HZ)
    per = round(RATE_HZ)
    begin = ticks[0].time_s - ticks[0].dt_s
    count = int((ticks[-1].time_s - begin) * RATE_HZ + 0.5) // per
    angle, gyro = np.zeros((count, 4)), np.zeros(count)
    seen, sums, numbers, late = np.zeros(count), np.zeros((count, 5)), np.zeros((count, 5)), np.zeros(count)
    turns = np.zeros((count, 2))
    for tick in ticks:
        at = round((tick.time_s - begin) * RATE_HZ) - 1
        if not 0 <= at // per < count:
            continue
        angle[at // per] += tick.rotation_rad
        gyro[at // per] += tick.yaw_rate_radps / per
        seen[at // per] += 1
        for fix in tick.fixes:
            k = int((fix.time_s - begin) // 1.0)
            if 0 <= k < count:
                values = np.array([fix.speed_mps, fix.east_m, fix.north_m, fix.up_m, fix.heading_rad])
                known = np.isfinite(values)
                sums[k] += np.where(known, values, 0.0)
                numbers[k] += known
                late[k] += fix.time_s - begin - k - 0.5
                if known[4]:
                    turns[k] += np.cos(fix.heading_rad), np.sin(fix.heading_rad)
    angle[seen < per] = np.nan
    gyro[seen < per] = np.nan
    mean = np.divide(sums, numbers, out=np.full_like(sums, np.nan), where=numbers > 0.5 * numbers.max(axis=0))
    radii = np.array(config.vehicle.wheel_radius_m)
    rolled = (angle[:, [RL, RR]] * radii[[RL, RR]]).mean(axis=1)
    # The fixes of a second are not spread evenly about its middle: bring them there.
    late = late / np.maximum(numbers[:, 1], 1)
    path_course = np.arctan2(_central(mean[:, 2]), _central(mean[:, 1]))
    mean[:, 0] -= _central(rolled) * late
    mean[:, 1] -= rolled * np.cos(path_course) * late
    mean[:, 2] -= rolled * np.sin(path_course) * late
    course = _unwrapped(np.where(numbers[:, 4] > 0, np.arctan2(turns[:, 1], turns[:, 0]), np.nan))
    yaw = _central(_unwrapped(path_course))
    course = course - yaw * late
    if np.isfinite(gyro).mean() > 0.5 and np.isfinite(course).sum() > BLOCK:
        bias, _, _ = regress(np.nancumsum(gyro) - course, [np.arange(count, dtype=np.float64)], draws=2)
        yaw = gyro - bias[0]
    return Seconds(
        angle=angle,
        gyro=gyro,
        speed=mean[:, 0],
        course=course,
        east=mean[:, 1],
        north=mean[:, 2],
        up=mean[:, 3],
        rolled=rolled,
        accel=_central(rolled),
        yaw=yaw,
    )


def _central(values: Array) -> Array:
    """Change per second between the neighbouring windows; NaN at the ends."""
    out = np.full_like(values, np.nan)
    out[1:-1] = 0.5 * (values[2:] - values[:-2])
    return out


def _unwrapped(angle: Array) -> Array:
    out = angle.copy()
    known = np.isfinite(angle)
    out[known] = np.unwrap(angle[known])
    return out


def regress(y: Array, columns: Sequence[Array], draws: int = DRAWS) -> tuple[Array, Array, int]:
    """Least squares with a constant, outliers of five robust deviations left out.

    Values and bootstrap standard deviations of the columns (not of the constant), and the windows used.
    """
    X = np.stack([np.ones_like(y), *columns], axis=1)
    block = np.arange(len(y)) // BLOCK
    kept = np.isfinite(y) & np.isfinite(X).all(axis=1)
    for _ in range(3):
        values = np.linalg.lstsq(X[kept], y[kept], rcond=None)[0]
        residual = y - X @ values
        kept &= np.abs(residual) < 5 * 1.4826 * np.median(np.abs(residual[kept]))
    X, y, block = X[kept], y[kept], block[kept]
    rng = np.random.default_rng(1)
    names = np.unique(block)
    grams = [X[block == name].T @ X[block == name] for name in names]
    scores = [X[block == name].T @ y[block == name] for name in names]
    drawn = []
    for _ in range(draws):
        picked = rng.integers(0, len(names), len(names))
        gram, score = sum(grams[k] for k in picked), sum(scores[k] for k in picked)
        drawn.append(np.linalg.lstsq(gram, score, rcond=None)[0])
    return values[1:], np.std(drawn, axis=0)[1:], int(kept.sum())


def look(folder: Path) -> None:
    """Print what plain least squares say of a drive."""
    config = load_config(folder)
    seconds = read(folder, config)
    vehicle = config.vehicle
    v, yaw, a = seconds.rolled, seconds.yaw, seconds.accel
    moving = (v > MIN_SPEED_MPS) & (np.abs(yaw) < 0.35)
    slow = np.where(moving, 0.0, np.nan)
    time = np.arange(len(v)) / 600.0
    r = vehicle.wheel_radius_m[RL]
    print(f"\n{folder.name}: {int(moving.sum())} s above {MIN_SPEED_MPS:g} m/s, up to {np.nanmax(v):.0f} m/s")
    for axle, left, right, track in (
        ("rear", RL, RR, vehicle.track_rear_m),
        ("front", FL, FR, vehicle.track_front_m),
    ):
        y = np.log(seconds.angle[:, right] / seconds.angle[:, left]) + slow
        if np.isfinite(y).any():
            _print(
                f"{axle} right over left",
                y,
                (("track error", yaw / v, 1.0, "m"), ("lateral load", v * yaw, r / 2, "s2"), _drift(time, r)),
                offset=-track * yaw / v,
            )
            alone = (("lateral load", v * yaw, r / 2, "s2"), _drift(time, r))
            _print("the same, for load alone", y, alone, offset=-track * yaw / v)
    y = np.log(seconds.angle[:, [FL, FR]].sum(axis=1) / seconds.angle[:, [RL, RR]].sum(axis=1)) + slow
    if np.isfinite(y).any():
        bend = 0.5 * (vehicle.wheelbase_m * yaw / v) ** 2
        _print(
            "front over rear",
            y,
            (("slip per accel", a, 1.0, "s2/m"), ("slip per v2", v**2, 1.0, "s2/m2")),
            -bend,
        )
    latency_s = _against_receiver(seconds, config, slow, time)
    if np.isfinite(seconds.gyro).any() and np.isfinite(seconds.course).any():
        rate = _central(seconds.course) + slow
        # The change between means over a second is the gyro's, weighted as a triangle.
        around = np.convolve(seconds.gyro, [0.25, 0.5, 0.25], mode="same")
        _print("course rate over gyro", rate - around, (("1 / scale - 1", around, 1.0, ""),))
        older = seconds.course + latency_s * yaw
        arm = config.gnss.antenna_forward_m * yaw / v
        left = older - np.nancumsum(seconds.gyro) + 0.5 * seconds.gyro - arm + slow
        bias = ("gyro bias", -time * 600.0, 1.0, "rad/s")
        _print("course minus turned gyro", left, (bias, ("antenna forward", yaw / v, 1.0, "m")))
        _print("the same, for slip", left, (bias, ("lateral slip", -v * yaw, 1.0, "rad.s2/m")))


def _against_receiver(seconds: Seconds, config: Config, slow: Array, time: Array) -> float:
    """Rear axle against the receiver: by its Doppler speed, else by its positions. Returns the latency."""
    v, a, r = seconds.rolled, seconds.accel, config.vehicle.wheel_radius_m[RL]
    kind = "Doppler speed"
    ground = seconds.speed + seconds.yaw * config.gnss.antenna_left_m
    if not np.isfinite(ground).any():
        kind = "positions"
        ground = np.hypot(_central(seconds.east), _central(seconds.north))
        ground = ground + seconds.yaw * config.gnss.antenna_left_m
        v = np.concatenate([[np.nan], (v[2:] + 2 * v[1:-1] + v[:-2]) / 4, [np.nan]])
    y = np.log(ground / v) + slow
    height = _smooth(seconds.up, 15)
    grade = _central(height) / np.maximum(_smooth(v, 15), 1.0)
    # What the drive does not vary it cannot tell: least spread of each column.
    candidates = [
        (("latency", -a / v, 1.0, "s"), 0.01),
        (("growth with v2", v**2, r, "s2/m"), 150.0),
        (("grade, 1 expected", -0.5 * grade**2, 1.0, ""), 2e-4),
        (("antenna left", -seconds.yaw / v, 1.0, "m"), 3e-3),
    ]
    columns = [column for column, least in candidates if np.nanstd(column[1] + slow) > least]
    columns.append(_drift(time, r))
    values = _print(f"{kind} over rear wheels", y, columns)
    if np.nanstd(a + slow) > 0.2:
        _print("the same, with slip beside", y, [*columns, ("minus slip per accel", a, 1.0, "s2/m")])
    stretches = []
    for begin in range(0, len(v), STRETCH_S):
        part = slice(begin, begin + STRETCH_S)
        if np.isfinite(y[part]).sum() > 40 and np.nanstd((a / v)[part]) > 0.01:
            value, std = _within(y[part], (-a / v)[part])
            if std < 0.1:
                stretches.append(f"{begin}: {value:+.3f}+-{std:.3f}")
    if stretches:
        print(f"  latency by stretches of {STRETCH_S} s, alone (s)   " + "  ".join(stretches))
    return float(values[0]) if columns[0][0] == "latency" else 0.0


def _within(y: Array, column: Array) -> tuple[float, float]:
    """As `regress`, for one column of a stretch too short for blocks of 30 s: blocks of a tenth of it."""
    known = np.flatnonzero(np.isfinite(y) & np.isfinite(column))
    rng = np.random.default_rng(1)
    drawn = []
    pieces = np.array_split(known, 10)
    for draw in range(DRAWS):
        picked = range(10) if draw == 0 else rng.integers(0, 10, 10)
        at = np.concatenate([pieces[k] for k in picked])
        X = np.stack([np.ones(len(at)), column[at]], axis=1)
        drawn.append(np.linalg.lstsq(X, y[at], rcond=None)[0][1])
    return float(drawn[0]), float(np.std(drawn[1:]))


def _drift(time: Array, radius_m: float) -> tuple[str, Array, float, str]:
    return "drift in 10 min", time, radius_m, "m"


def _smooth(values: Array, half: int) -> Array:
    known = np.isfinite(values)
    if known.sum() < 3:
        return np.full_like(values, np.nan)
    filled = np.interp(np.arange(len(values)), np.flatnonzero(known), values[known])
    kernel = np.hanning(2 * half + 3)
    return np.convolve(np.pad(filled, half + 1, mode="edge"), kernel / kernel.sum(), mode="valid")


def _print(
    title: str,
    y: Array,
    columns: Sequence[tuple[str, Array, float, str]],
    offset: Array | float = 0.0,
    shown: int | None = None,
) -> Array:
    """One regression: values with standard deviations (the first so many), in the units of the physics."""
    values, stds, count = regress(y + offset, [column for _, column, _, _ in columns])
    print(f"  {title} ({count} windows)")
    for (name, _, scale, unit), value, std in list(zip(columns, values, stds, strict=True))[:shown]:
        sure = abs(value) / max(std, 1e-300)
        print(f"    {name:<24}{scale * value:>12.3g} +- {scale * std:<9.2g}{unit:<10}{sure:6.1f} sigma")
    return values


def look_together(folders: Sequence[Path]) -> None:
    """The rear pair of several drives of one car: radius and drift per drive, track and load in common."""
    ys, yaws, loads, squares, owns = [], [], [], [], []
    for k, folder in enumerate(folders):
        config = load_config(folder)
        seconds = read(folder, config)
        v, yaw = seconds.rolled, seconds.yaw
        slow = np.where((v > MIN_SPEED_MPS) & (np.abs(yaw) < 0.35), 0.0, np.nan)
        pair = np.log(seconds.angle[:, RR] / seconds.angle[:, RL]) + slow
        ys.append(pair - config.vehicle.track_rear_m * yaw / v)
        yaws.append(yaw / v)
        loads.append(v * yaw)
        squares.append(v**2)
        own = np.zeros((len(v), 2 * len(folders)))
        own[:, 2 * k], own[:, 2 * k + 1] = 1.0, np.arange(len(v)) / 600.0
        owns.append(own)
    own = np.concatenate(owns)[:, 1:]  # the first drive's radius is the constant
    r = config.vehicle.wheel_radius_m[RL]
    columns = [
        ("track error", np.concatenate(yaws), 1.0, "m"),
        ("lateral load", np.concatenate(loads), r / 2, "s2"),
    ]
    columns += [(f"own {k}", own[:, k], r, "m") for k in range(own.shape[1])]
    print(f"\n{', '.join(folder.name for folder in folders)} together")
    _print("rear right over left", np.concatenate(ys), columns, shown=2)
    growth = ("left grows with v2", np.concatenate(squares), r, "s2/m")
    _print("the same, with growth of one", np.concatenate(ys), [growth, *columns], shown=3)


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("drives", type=Path, nargs="+", metavar="DRIVE")
    parser.add_argument(
        "--together", action="store_true", help="drives of one car: their rear wheels jointly"
    )


def main(args: argparse.Namespace) -> int:
    """Look at each folder."""
    with np.errstate(divide="ignore", invalid="ignore"):  # standing seconds, which are masked
        if args.together:
            look_together(args.drives)
            return 0
        for folder in args.drives:
            look(folder)
    return 0
