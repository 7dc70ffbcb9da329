"""Particles that are poses: what MPF-PN, AUG-PF and MPF-MN share.

In: ways and turns of N particles. Out: their poses, weighed by fixes (22) and resampled (Table I, lines 15 to
18). Position errors have the receiver's stated size and Student-t tails (`gnss_likelihood`) in place of one
known Gaussian (10d).

A particle's heading is never wrapped, and all start about one value, so means of headings need no circle.
"""

from __future__ import annotations

import math
from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray

from tpmsd.config.model import FilterConfig, GnssConfig, VehicleConfig
from tpmsd.estimators.gnss_likelihood import PositionLog, position_variance, student_t_log
from tpmsd.estimators.pose_keeper import COAST_YAW_STD, Pose
from tpmsd.estimators.pose_start import PoseStart
from tpmsd.estimators.position_filter import PositionFilter
from tpmsd.estimators.resampling import effective_number, systematic
from tpmsd.timeline.tick import Fix, Tick
from tpmsd.wheels import FloatArray

DEFAULT_PARTICLES = 500


class PoseParticles(PositionFilter):
    """Base of the filters that sample the pose."""

    def __init__(
        self,
        vehicle: VehicleConfig,
        gnss: GnssConfig,
        settings: FilterConfig,
        rng: np.random.Generator,
        front: bool,
        position_log: PositionLog = student_t_log,
    ) -> None:
        """`front`: whether the bus has the front wheels; `position_log`: how probable a position is."""
        super().__init__(vehicle, gnss, settings, front)
        self._rng = rng
        self._position_log = position_log
        self._count = settings.particles or DEFAULT_PARTICLES
        self._pose = np.zeros((3, self._count))
        """East, north, heading."""
        self._moved = np.zeros((3, self._count))
        """How the last tick changed the pose."""
        self._log_weights = np.zeros(self._count)
        self._even = np.full(self._count, 1.0 / self._count)
        self._weights = self._even
        self.counts["resampled"] = 0

    @abstractmethod
    def _select(self, index: NDArray[np.intp]) -> None:
        """Keep what the method holds of the particles of these indices."""

    def _roll(self, rear_rad: FloatArray, noise_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Way and turn (N,) by realised radius errors (2, N), eqs (6a), (6b)."""
        left = rear_rad[0] * (self._nominal[0] + noise_m[0])
        right = rear_rad[1] * (self._nominal[1] + noise_m[1])
        return (left + right) * 0.5, (right - left) * (1.0 / self._geometry.track_rear_m)

    def _go(self, way: FloatArray, turn: FloatArray) -> tuple[float, float]:
        """Move the poses, eq. (7) with the heading at mid-step; mean way and turn."""
        middle = turn * 0.5
        middle += self._pose[2]
        self._moved[0] = way * np.cos(middle)
        self._moved[1] = way * np.sin(middle)
        self._moved[2] = turn
        self._pose += self._moved
        return float(way.mean()), float(turn.mean())

    def _stand(self) -> None:
        self._moved[:] = 0.0

    def _drift_on(self, dt_s: float) -> None:
        way = dt_s * (self._rate[0] + self._rng.standard_normal(self._count))
        swing = COAST_YAW_STD * math.sqrt(dt_s) * self._rng.standard_normal(self._count)
        self._go(way, dt_s * self._steady_yaw_rate + swing)

    # -- fixes ----------------------------------------------------------------------------------------------

    def _off(self, fix: Fix) -> tuple[FloatArray, FloatArray]:
        """East and north (N,) of a fix from each particle's antenna at the time of the fix."""
        east, north, heading = self._pose - (1.0 - fix.fraction) * self._moved
        forward, left = self._antenna
        if forward != 0.0 or left != 0.0:
            cos, sin = np.cos(heading), np.sin(heading)
            east, north = east + forward * cos - left * sin, north + forward * sin + left * cos
        return fix.east_m - east, fix.north_m - north

    def _distance(self, fix: Fix) -> tuple[float, float]:
        # The spread of the particles is in the mean distance already; a share of the variance covers the
        # rest.
        distance = float(self._weights @ np.hypot(*self._off(fix)))
        return distance, fix.position_std_m**2 + position_variance(fix) / 9.0

    def _weigh(self, fix: Fix) -> None:
        east, north = self._off(fix)
        self._multiply(self._position_log((east * east + north * north) / position_variance(fix), 2))

    def _multiply(self, log_likelihood: FloatArray) -> None:
        """Multiply the weights, eq. (22)."""
        self._log_weights += log_likelihood
        self._log_weights -= self._log_weights.max()
        weights = np.exp(self._log_weights)
        self._weights = weights / weights.sum()

    def _after_fixes(self) -> None:
        if self._weights is self._even or self._effective() > 0.5 * self._count:
            return
        chosen = systematic(self._weights, self._rng)
        self._pose = self._pose[:, chosen]
        self._moved = self._moved[:, chosen]
        self._select(chosen)
        self._level()
        self.counts["resampled"] += 1

    def _level(self) -> None:
        """All weights alike."""
        self._log_weights[:] = 0.0
        self._weights = self._even

    def _effective(self) -> float:
        return effective_number(self._weights)

    def _place(self, start: PoseStart, tick: Tick) -> None:
        """Spread the particles about a pose that the fixes tell."""
        fix, count, rng = start.fix, self._count, self._rng
        heading = start.heading_rad + start.heading_std_rad * rng.standard_normal(count)
        forward, left = self._antenna
        ahead = (1.0 - fix.fraction) * tick.dt_s * self._rate[0] - forward
        cos, sin = np.cos(heading), np.sin(heading)
        std = math.sqrt(position_variance(fix))
        self._pose[0] = fix.east_m + std * rng.standard_normal(count) + ahead * cos + left * sin
        self._pose[1] = fix.north_m + std * rng.standard_normal(count) + ahead * sin - left * cos
        self._pose[2] = heading
        self._moved[:] = 0.0
        self._level()

    # -- out ------------------------------------------------------------------------------------------------

    def _mean_pose(self) -> Pose:
        weights = self._weights
        mean = self._pose @ weights
        away = self._pose - mean[:, None]
        spread = np.square(away, out=away) @ weights
        return Pose(
            east_m=float(mean[0]),
            north_m=float(mean[1]),
            heading_rad=math.remainder(float(mean[2]), 2 * math.pi),
            position_std_m=math.sqrt((spread[0] + spread[1]) / 2),
            heading_std_rad=math.sqrt(spread[2]),
        )
