"""Check whether the first ten minutes of driving contradict the configuration.

In: ticks. Out: what is contradicted, in one sentence, or nothing. It is the part of `tpmsd check --drive`
that costs next to nothing: the sign of turns and the level of radii.

Turns: in each interval between two fixes, the change of course by the receiver against what the pair of an
axle, and the gyro, say of it. Exchanged sides and a wrong sign turn the correlation over. Radii: the
receiver's speed over the wheels' turns against the nominal radius; teeth, units and scales are off by more
than any tyre.
"""

from __future__ import annotations

import math

import numpy as np

from tpmsd.car.config.model import VehicleConfig
from tpmsd.foundation.median import median
from tpmsd.foundation.wheels import FL, FR, RL, RR, FloatArray
from tpmsd.onboard.monitor.settings import CONFIGURATION
from tpmsd.onboard.timeline.tick import Fix, Tick

AXLES = {"front": (FL, FR), "rear": (RL, RR)}


class _YawCorrelation:
    """Partial correlation of one source of yaw with the receiver's course.

    Given a third quantity in which the source is off by nature: the way, for tyres of unequal radius show a
    turn that grows with it; the time, for a gyro has a zero error.
    """

    def __init__(self) -> None:
        self._sums = np.zeros((3, 3))
        self._intervals = 0
        self.right = False

    def add(self, course_rad: float, other_rad: float, given: float) -> None:
        """Add an interval's turns by the receiver and by the source; `given`: the distance (m) or the time
        (s)."""
        if math.isfinite(other_rad) and not self.right:
            row = np.array([course_rad, other_rad, given])
            self._sums += np.outer(row, row)
            self._intervals += 1

    def is_reversed(self) -> bool:
        """Return whether this source turns against the receiver's course, its sign being wrong."""
        if self.right or self._intervals < CONFIGURATION.min_intervals:
            return False
        with_given = self._sums[:2, 2]
        left = self._sums[:2, :2] - np.outer(with_given, with_given) / self._sums[2, 2]
        if left[0, 0] < CONFIGURATION.min_turns_rad2 or left[1, 1] <= 0.0:
            return False
        correlation = left[0, 1] / math.sqrt(left[0, 0] * left[1, 1])
        self.right = bool(correlation > CONFIGURATION.min_correlation)
        return bool(correlation < -CONFIGURATION.min_correlation)


class ConfigurationWatch:
    """Compares the first minutes of one run of the program with the configuration."""

    def __init__(self, vehicle: VehicleConfig, wheels: list[int]) -> None:
        self._radius = np.array(vehicle.wheel_radius_m)
        self._track = {"front": vehicle.track_front_m, "rear": vehicle.track_rear_m}
        self._turns = {name: _YawCorrelation() for name, pair in AXLES.items() if set(pair) <= set(wheels)}
        self._gyro = _YawCorrelation()
        self._wheels = wheels
        self._before: Fix | None = None
        self._rotation: FloatArray = np.zeros(4)
        self._yaw_rad = 0.0
        self._driven_s = 0.0
        self._ratios: list[float] = []
        self.contradiction = ""

    def update(self, tick: Tick) -> str:
        """Update by one tick; return the contradiction in one sentence, empty while there is none."""
        if self.contradiction or self._driven_s > CONFIGURATION.look_s:
            return self.contradiction
        self._rotation = self._rotation + tick.rotation_rad
        self._yaw_rad += tick.yaw_rate_radps * tick.dt_s
        for fix in tick.fixes:
            self._add_interval(fix)
        return self.contradiction

    def _add_interval(self, fix: Fix) -> None:
        """Add the interval from the last fix to this one, if it is of a suitable length and speed."""
        before, rotation, yaw = self._before, self._rotation, self._yaw_rad
        if not math.isfinite(fix.speed_mps):
            return
        if before is not None and fix.time_s - before.time_s < CONFIGURATION.step_s[0]:
            return
        self._before, self._rotation, self._yaw_rad = fix, np.zeros(4), 0.0
        if before is None or fix.time_s - before.time_s > CONFIGURATION.step_s[1]:
            return
        if min(fix.speed_mps, before.speed_mps) < CONFIGURATION.slowest_mps:
            return
        step_s = fix.time_s - before.time_s
        self._driven_s += step_s
        self._check_radius(0.5 * (fix.speed_mps + before.speed_mps) * step_s, rotation)
        turn = math.remainder(fix.heading_rad - before.heading_rad, math.tau)
        if not abs(turn) > CONFIGURATION.min_turn_radps * step_s:  # also where there is no course
            return
        for name, turns in self._turns.items():
            left, right = AXLES[name]
            shown = float(rotation[right] - rotation[left]) * self._radius[left] / self._track[name]
            turns.add(turn, shown, 0.5 * (fix.speed_mps + before.speed_mps) * step_s)
        self._gyro.add(turn, yaw, step_s)
        self._find_contradiction()

    def _find_contradiction(self) -> None:
        """Set `contradiction` if axles or the gyro turn against the receiver's course."""
        wrong = [name for name, turns in self._turns.items() if turns.is_reversed()]
        if wrong:
            axles = " and ".join(wrong)
            self.contradiction = (
                f"left and right of the {axles} wheels seem exchanged: they turn against the receiver"
            )
        elif self._gyro.is_reversed():
            self.contradiction = "the yaw rate turns against the receiver's course: its sign seems wrong"

    def _check_radius(self, distance_m: float, rotation: FloatArray) -> None:
        """Add an interval's ratio of radii; set `contradiction` once the median of all is far from the
        nominal radius."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = distance_m / (rotation * self._radius)
        seen = ratio[self._wheels]
        if not np.all(np.isfinite(seen)) or len(self._ratios) >= CONFIGURATION.radius_intervals:
            return
        # The wheel that is least off: one soft, spinning or locked wheel is no configuration.
        self._ratios.append(float(seen[np.argmin(np.abs(np.log(np.maximum(seen, 1e-6))))]))
        if len(self._ratios) == CONFIGURATION.radius_intervals:
            ratio_all = float(median(np.array(self._ratios)))
            if abs(math.log(ratio_all)) > CONFIGURATION.radius_share:
                radius = float(np.mean(self._radius[self._wheels]))
                self.contradiction = (
                    f"by the receiver the wheels' radius would be {ratio_all * radius:.3f} m for "
                    f"{radius:.3f} m: teeth, unit or scale of the wheels' signals seem wrong"
                )
