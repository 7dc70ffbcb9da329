"""The wheels' rotation over about a second, to be compared with the receiver and among the wheels.

In: ticks and fixes. Out: a `Block` when one is complete. Over a block the counters' quantisation is small,
and Doppler speeds at both ends and between give the distance by the trapezoid rule.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Fix, Tick


@dataclass(frozen=True, slots=True)
class FrontResidual:
    """One front wheel's hub path, predicted from the rear pair, minus the path by its own rotation."""

    residual_m: float
    by_rear: FloatArray
    """(2,) derivative of the predicted path by the radii of rl and rr."""
    by_own: float
    """Derivative of the residual by that wheel's radius: minus the rotation that the rear pair predicts. With
    the rotation that was read, its reading error would be the residual's too (errors in variables), and would
    pull the radius that all wheels have in common down without end."""
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
    distance_m: float
    doppler_distance_m: float
    """NaN without Doppler speeds."""
    heading_change_rad: float
    """Turn over the Doppler span."""
    accel_mps2: float
    """Mean longitudinal acceleration."""
    speed_change_mps: float
    """Doppler speed at the end minus that at the start."""
    speed_noise: float
    """Standard deviation of the Doppler speeds over the typical one."""
    speed_swing_mps: float
    """Largest step between Doppler speeds, plus the change: what jitter of the time stamps acts on."""
    reading_distance_m: float
    front: tuple[FrontResidual | None, FrontResidual | None]
    at_radii: FloatArray
    """(d,) radius errors at which turn and front residuals were formed."""
    gyro_heading_change_rad: float
    """Integral of the yaw rate signal over the block; NaN where it was missing."""
    load_per_turn: float
    """Derivative of the wheels' turn by the lateral load transfer (`error_state.ProcessModel.load_turn`), per
    turn."""
    reading_heading_change_rad: float
    """Reading error of the counters as a turn."""
    ticks: int
    """Number of ticks in it."""


class BlockBuilder:
    """Collects ticks; a block ends at a fix with speed, or by time where there are none."""

    def __init__(self, order: list[int], nominal: FloatArray, geometry: WheelPositions) -> None:
        self._order, self._nominal, self._geometry = order, nominal, geometry
        self.reset()

    def reset(self) -> None:
        """Discard the collected ticks and fixes."""
        self._ticks: list[tuple[Tick, bool, float]] = []
        self._fixes: list[tuple[int, Fix]] = []

    def add_fix(self, fix: Fix, tick: Tick) -> None:
        """Add a fix inside the tick that is about to be added."""
        if math.isfinite(fix.speed_mps):
            self._fixes.append((tick.index, fix))

    def add(self, tick: Tick, informative: bool, radii: FloatArray, accel_mps2: float) -> Block | None:
        """Add a tick and return the block that it completes, else None. `radii` are the present radius errors
        (d,)."""
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
        block = self._make_block(radii, doppler)
        last = [f for f in self._fixes if f[0] == tick.index][-1:]
        self.reset()
        if last:
            # The last fix opens the next block, which begins inside this tick.
            self._fixes = last
            self._ticks = [(tick, informative, accel_mps2)]
        return block

    def _make_block(self, radii: FloatArray, doppler: bool) -> Block:
        """Return the block of the collected ticks; `doppler`: it ends at a fix with speed."""
        # Plain numbers: for so few numpy takes several times as long.
        ticks = [t for t, _, _ in self._ticks]
        shares = [1.0] * len(ticks)
        travel, change, noise, swing = math.nan, 0.0, 1.0, 0.0
        if doppler:
            fixes = [fix for _, fix in self._fixes]
            travel, change, noise, swing = _doppler_motion(fixes)
            for j, t in enumerate(ticks):
                inside_s = min(t.time_s, fixes[-1].time_s) - max(t.time_s - t.dt_s, fixes[0].time_s)
                shares[j] = min(max(inside_s / t.dt_s, 0.0), 1.0)
        order, track_m = self._order, self._geometry.track_rear_m
        radius = (self._nominal + radii).tolist()
        angle, reading = [0.0] * len(order), [0.0] * len(order)
        travels, turns = [], []
        duration = gyro = 0.0
        for tick, share in zip(ticks, shares, strict=True):
            turned, quantum = tick.rotation_rad.tolist(), tick.rotation_std_rad.tolist()
            for k, wheel in enumerate(order):
                angle[k] += turned[wheel] * share
                if quantum[wheel] > reading[k]:  # false for NaN; errors of the ticks between cancel
                    reading[k] = quantum[wheel]
            left = turned[order[0]] * share * radius[0]
            right = turned[order[1]] * share * radius[1]
            travels.append((left + right) / 2)
            turns.append((right - left) / track_m)
            duration += share * tick.dt_s
            gyro += share * (tick.yaw_rate_radps * tick.dt_s)
        front = (
            self._front_residuals(shares, travels, turns, angle, reading, radius)
            if len(order) == 4
            else (None, None)
        )
        distance_m = sum(travels)
        accel_per_turn = distance_m / max(duration, 1e-3) ** 2
        reading_roll_m = math.hypot(reading[0] * radius[0], reading[1] * radius[1])
        return Block(
            duration_s=max(duration, 1e-3),
            informative=all(flag for _, flag, _ in self._ticks),
            angle_rad=np.array(angle),
            distance_m=distance_m,
            doppler_distance_m=travel,
            heading_change_rad=sum(turns),
            accel_mps2=sum(a for _, _, a in self._ticks) / len(self._ticks),
            speed_change_mps=change,
            speed_noise=noise,
            speed_swing_mps=swing,
            reading_distance_m=reading_roll_m / 2,
            front=front,
            at_radii=radii.copy(),
            gyro_heading_change_rad=gyro,
            load_per_turn=-accel_per_turn * (angle[0] + angle[1]) / track_m,
            reading_heading_change_rad=reading_roll_m / track_m,
            ticks=len(ticks),
        )

    def _front_residuals(
        self,
        shares: list[float],
        travels: list[float],
        turns: list[float],
        angle: list[float],
        reading: list[float],
        radius: list[float],
    ) -> tuple[FrontResidual | None, FrontResidual | None]:
        """Return the residual of either front wheel, None where its rotation is missing; distances (m), turns
        (rad) and shares of n ticks, the rest by wheel."""
        # The hub's lateral part enters squared, so quantisation noise in a short tick's turn would bias it:
        # there the turn is smoothed.
        size = max(round(SETTINGS.front_smoothing_s / self._ticks[0][0].dt_s), 1)
        whole = [
            turn / max(share, 1e-9) if share > 0.0 else 0.0 for turn, share in zip(turns, shares, strict=True)
        ]
        smooth_m = [
            mean * share * self._geometry.wheelbase_m
            for mean, share in zip(moving_mean(whole, size), shares, strict=True)
        ]
        half_m = self._geometry.track_front_m / 2
        out: list[FrontResidual | None] = []
        ratio = self._geometry.track_front_m / self._geometry.track_rear_m
        for column, side in ((2, -1.0), (3, 1.0)):
            if not math.isfinite(angle[column]) or angle[column] <= 0.0:
                out.append(None)
                continue
            # As `kinematics.wheel_speeds`, the hub's lateral part by the smoothed turn.
            path_m = 0.0
            for travel, turn, lateral in zip(travels, turns, smooth_m, strict=True):
                along = travel + side * turn * half_m
                path_m += math.copysign(math.hypot(along, lateral), along)
            # path ~ way + side * turn * track_front / 2; the hub's lateral part is second order.
            to_left, to_right = (1 - side * ratio) / 2, (1 + side * ratio) / 2
            by_rear = np.array([to_left * angle[0], to_right * angle[1]])
            rear_m = math.hypot(reading[0] * to_left, reading[1] * to_right) * radius[0]
            noise = math.hypot(reading[column] * radius[column], rear_m)
            residual = path_m - angle[column] * radius[column]
            by_own = -float(by_rear @ radius[:2]) / radius[column]
            out.append(FrontResidual(residual, by_rear, by_own, side * half_m, noise))
        return out[0], out[1]


def moving_mean(values: list[float], size: int) -> list[float]:
    """Return the (n,) mean over `size` neighbours of each value, of which one more lies before than behind if
    `size` is even; beyond the ends the first and the last value go on."""
    before = size // 2
    padded = [values[0]] * before + values + [values[-1]] * (size - 1 - before)
    return [sum(padded[k : k + size]) / size for k in range(len(values))]


def _doppler_motion(fixes: list[Fix]) -> tuple[float, float, float, float]:
    """Return distance and change of speed by the receiver's speed, its noise and its greatest swing.

    Distance (m) between the first fix and the last (NaN with too long a gap), change (m/s), noise over the
    usual one, swing (m/s).
    """
    steps = [(a.speed_mps, b.speed_mps, b.time_s - a.time_s) for a, b in pairwise(fixes)]
    travel = sum((before + after) / 2 * span_s for before, after, span_s in steps)
    change = fixes[-1].speed_mps - fixes[0].speed_mps
    noise = math.sqrt(sum(fix.speed_noise**2 for fix in fixes) / len(fixes))
    swing = max((abs(after - before) for before, after, _ in steps), default=0.0) + abs(change)
    if max((span_s for *_, span_s in steps), default=0.0) > SETTINGS.block_max_s:
        travel = math.nan
    return travel, change, noise, swing
