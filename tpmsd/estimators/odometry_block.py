"""The wheels' rotation over about a second, ready to be held against the receiver and against each other.

In: ticks and fixes. Out: a `Block` when one is complete. Over a block the counters' quantisation is small,
and Doppler speeds at both ends and between give the way by the trapezoid rule.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tpmsd.estimators.settings import SETTINGS
from tpmsd.physics.kinematics import Geometry, wheel_speeds
from tpmsd.timeline.tick import Fix, Tick
from tpmsd.wheels import FL, FR, FloatArray


@dataclass(frozen=True, slots=True)
class FrontResidual:
    """One front wheel's hub path, predicted from the rear pair, minus what its own rotation says."""

    residual_m: float
    by_rear: FloatArray
    """(2,) derivative of the predicted path by the radii of rl and rr."""
    by_track_m: float
    """Derivative of the predicted path by the relative error of the track, per turn."""
    reading_m: float


@dataclass(frozen=True, slots=True)
class Block:
    """Rotation, and what it can be compared with, over one block."""

    duration_s: float
    informative: bool
    angle_rad: FloatArray
    """(d,) rotation in the estimator's order (rl, rr[, fl, fr]); over the Doppler span for the rear pair if
    there is one."""
    way_m: float
    doppler_way_m: float
    """NaN without Doppler speeds."""
    turn_rad: float
    """Turn over the Doppler span."""
    accel_mps2: float
    """Mean longitudinal acceleration."""
    speed_change_mps: float
    """Doppler speed at the end minus that at the start."""
    speed_noise: float
    """By how much the error of the Doppler speeds is greater than usual."""
    speed_swing_mps: float
    """Largest step between Doppler speeds, plus the change: what jitter of the time stamps acts on."""
    reading_way_m: float
    front: tuple[FrontResidual | None, FrontResidual | None]
    at_radii: FloatArray
    """(d,) radius errors at which turn and front residuals were formed."""
    gyro_turn_rad: float
    """The yaw rate signal integrated over the block; NaN where it was missing."""
    load_per_turn: float
    """Derivative of the wheels' turn by the lateral load transfer (`error_state.ProcessModel.load_turn`), per
    turn."""
    reading_turn_rad: float
    """Reading error of the counters as a turn."""


class BlockBuilder:
    """Adds ticks up; a block ends at a fix with speed, or by time where there are none."""

    def __init__(self, order: list[int], nominal: FloatArray, geometry: Geometry) -> None:
        self._order, self._nominal, self._geometry = order, nominal, geometry
        self.reset()

    def reset(self) -> None:
        """Drop what was gathered."""
        self._ticks: list[tuple[Tick, bool, float]] = []
        self._fixes: list[tuple[int, Fix]] = []

    def add_fix(self, fix: Fix, tick: Tick) -> None:
        """A fix inside the tick that is about to be added."""
        if math.isfinite(fix.speed_mps):
            self._fixes.append((tick.index, fix))

    def add(self, tick: Tick, informative: bool, radii: FloatArray, accel_mps2: float) -> Block | None:
        """Take a tick; the block it completes, if any. `radii` are the present radius errors (d,)."""
        left, right = self._order[:2]
        if not (math.isfinite(tick.rotation_rad[left]) and math.isfinite(tick.rotation_rad[right])):
            self.reset()
            return None
        self._ticks.append((tick, informative, accel_mps2))
        begin = self._ticks[0][0]
        elapsed = tick.time_s - (begin.time_s - begin.dt_s)
        fresh = bool(self._fixes) and self._fixes[-1][0] == tick.index
        doppler = fresh and self._fixes[-1][1].time_s - self._fixes[0][1].time_s >= SETTINGS.block_min_s * 0.9
        if not doppler and elapsed < SETTINGS.block_max_s:
            return None
        if elapsed > 2 * SETTINGS.block_max_s:
            self.reset()
            return None
        block = self._build(radii, doppler)
        last = [f for f in self._fixes if f[0] == tick.index][-1:]
        self.reset()
        if last:
            # The last fix opens the next block, which begins inside this tick.
            self._fixes = last
            self._ticks = [(tick, informative, accel_mps2)]
        return block

    def _build(self, radii: FloatArray, doppler: bool) -> Block:
        ticks = [t for t, _, _ in self._ticks]
        shares = [1.0] * len(ticks)
        way = math.nan
        change = swing = 0.0
        noise = 1.0
        if doppler:
            # Plain numbers: for so few numpy takes ten times as long.
            fixes = [fix for _, fix in self._fixes]
            first, last = fixes[0], fixes[-1]
            steps = [(a.speed_mps, b.speed_mps, b.time_s - a.time_s) for a, b in pairwise(fixes)]
            way = sum((before + after) / 2 * span_s for before, after, span_s in steps)
            change = last.speed_mps - first.speed_mps
            noise = math.sqrt(sum(fix.speed_noise**2 for fix in fixes) / len(fixes))
            swing = max((abs(after - before) for before, after, _ in steps), default=0.0) + abs(change)
            for j, t in enumerate(ticks):
                inside_s = min(t.time_s, last.time_s) - max(t.time_s - t.dt_s, first.time_s)
                shares[j] = min(max(inside_s / t.dt_s, 0.0), 1.0)
            if max((span_s for *_, span_s in steps), default=0.0) > SETTINGS.block_max_s:
                way = math.nan
        share = np.array(shares)
        rotation = np.concatenate([t.rotation_rad for t in ticks]).reshape(-1, 4)[:, self._order]
        rotation *= share[:, None]
        quantum = np.concatenate([t.rotation_std_rad for t in ticks]).reshape(-1, 4)[:, self._order]
        angle = np.add.reduce(rotation)
        reading = np.fmax.reduce(quantum, initial=0.0)  # errors of the ticks between cancel
        radius = self._nominal + radii
        times_s = np.array([t.dt_s for t in ticks])
        gyro = np.array([t.yaw_rate_radps for t in ticks])
        left, right = rotation[:, 0] * radius[0], rotation[:, 1] * radius[1]
        ways, turns = (left + right) / 2, (right - left) / self._geometry.track_rear_m
        front = (
            self._front(rotation, share, ways, turns, angle, reading, radius)
            if len(self._order) == 4
            else (None, None)
        )
        duration = float(share @ times_s)
        way_m = float(np.add.reduce(ways))
        accel_per_turn = way_m / max(duration, 1e-3) ** 2
        reading_roll_m = math.hypot(reading[0] * radius[0], reading[1] * radius[1])
        return Block(
            duration_s=max(duration, 1e-3),
            informative=all(flag for _, flag, _ in self._ticks),
            angle_rad=angle,
            way_m=way_m,
            doppler_way_m=way,
            turn_rad=float(np.add.reduce(turns)),
            accel_mps2=sum(a for _, _, a in self._ticks) / len(self._ticks),
            speed_change_mps=change,
            speed_noise=noise,
            speed_swing_mps=swing,
            reading_way_m=reading_roll_m / 2,
            front=front,
            at_radii=radii.copy(),
            gyro_turn_rad=float(share @ (gyro * times_s)),
            load_per_turn=-accel_per_turn * float(angle[0] + angle[1]) / self._geometry.track_rear_m,
            reading_turn_rad=reading_roll_m / self._geometry.track_rear_m,
        )

    def _front(
        self,
        rotation: FloatArray,
        share: FloatArray,
        ways: FloatArray,
        turns: FloatArray,
        angle: FloatArray,
        reading: FloatArray,
        radius: FloatArray,
    ) -> tuple[FrontResidual | None, FrontResidual | None]:
        # The hub's lateral part enters squared, so quantisation noise in a short tick's turn would bias it:
        # there the turn is smoothed.
        size = max(round(SETTINGS.front_smoothing_s / self._ticks[0][0].dt_s), 1)
        whole = np.where(share > 0.0, turns / np.maximum(share, 1e-9), 0.0)
        smooth = moving_mean(whole, size) * share
        lateral = (smooth - turns) * self._geometry.wheelbase_m
        paths = wheel_speeds(ways, turns, self._geometry, lateral)
        out: list[FrontResidual | None] = []
        ratio = self._geometry.track_front_m / self._geometry.track_rear_m
        angles, readings, radii = angle.tolist(), reading.tolist(), radius.tolist()
        for column, wheel, side in ((2, FL, -1.0), (3, FR, 1.0)):
            if not math.isfinite(angles[column]) or angles[column] <= 0.0:
                out.append(None)
                continue
            # path ~ way + side * turn * track_front / 2; the hub's lateral part is second order.
            to_left, to_right = (1 - side * ratio) / 2, (1 + side * ratio) / 2
            by_rear = np.array([to_left * angles[0], to_right * angles[1]])
            rear_m = math.hypot(readings[0] * to_left, readings[1] * to_right) * radii[0]
            noise = math.hypot(readings[column] * radii[column], rear_m)
            residual = float(np.add.reduce(paths[:, wheel])) - angles[column] * radii[column]
            out.append(FrontResidual(residual, by_rear, side * self._geometry.track_front_m / 2, noise))
        return out[0], out[1]


def moving_mean(values: FloatArray, size: int) -> FloatArray:
    """(n,) mean over `size` neighbours of each, of which one more lies before than behind if `size` is even;
    beyond the ends the first and the last value go on."""
    before = size // 2
    padded = np.concatenate([np.full(before, values[0]), values, np.full(size - 1 - before, values[-1])])
    return np.convolve(padded, np.full(size, 1.0 / size), mode="valid")
