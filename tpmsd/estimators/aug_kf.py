"""AUG-KF: extended and unscented Kalman filters over the augmented state of paper 000, (25)-(29).

In: `Tick`s. Out: `RadiusEstimate`s.

State: east, north, heading, mu_rl, mu_rr, Sigma_rl, Sigma_rr; its motion is that of `aug_pf`. The EKF
linearises it; the UKF sends points through it, drawn from the state and the radius noise w together.

What a Kalman filter cannot do here: Sigma enters the motion only as the size of a noise, so the state's
covariance with it stays zero and no fix ever changes it. Its own variance would grow with (28) for ever and
is held at what the first minutes make of it. So the first Sigma is a tuning parameter.

What was added: fixes that do not fit lose influence, as in `batched_kalman`.
"""

from __future__ import annotations

import math
from abc import abstractmethod

import numpy as np

from tpmsd.config.model import FilterConfig, GnssConfig, VehicleConfig
from tpmsd.estimators.aug_pf import SIGMA_STEP_STD
from tpmsd.estimators.batched_kalman import Weights, scalar_update, square_weights, symmetrise
from tpmsd.estimators.gnss_likelihood import position_variance
from tpmsd.estimators.pose_keeper import COAST_YAW_STD, Pose
from tpmsd.estimators.pose_start import PoseStart
from tpmsd.estimators.position_filter import PRIOR_RADIUS_STD, PositionFilter
from tpmsd.timeline.tick import Fix, Tick
from tpmsd.wheels import FloatArray

E, N, PSI, MU, SIGMA = 0, 1, 2, 3, 5
SIZE = 7
"""Places in the state; MU and SIGMA take two each, rl before rr."""
DRIFT_STD_M = 0.02e-3
"""Square root of Q over a second, m per sqrt(s); particles need a longer walk to explore at all."""
FIXED_NOISE_STD_M = 0.001
"""Square root of the first and only Sigma; 3 mm, right for one tick, is far too much for the sum of many: a
counter's reading error does not add up."""
SIGMA_STD_LIMIT = 0.3
"""The variance of Sigma is held at this share of its square."""


class AugKalman(PositionFilter):
    """Base of both; `step` takes one tick and gives one estimate."""

    def __init__(
        self,
        vehicle: VehicleConfig,
        gnss: GnssConfig,
        settings: FilterConfig,
        rng: np.random.Generator,
        front: bool,
        drift_std_m: float = DRIFT_STD_M,
        noise_std_m: float = FIXED_NOISE_STD_M,
        weights: Weights = square_weights,
    ) -> None:
        """`front`: whether the bus has the front wheels. `rng` is not drawn from. `drift_std_m`: random walk
        of mu over a second; `noise_std_m`: square root of Sigma; `weights` of fixes by how they fit."""
        super().__init__(vehicle, gnss, settings, front)
        self._fix_weights = weights
        self._drift = drift_std_m
        self._mean = np.zeros(SIZE)
        self._mean[SIGMA:] = noise_std_m**2
        spread = (PRIOR_RADIUS_STD * self._nominal[:2]) ** 2
        self._cov = np.diag([0.0, 0.0, 0.0, *spread, 0.0, 0.0])
        self._last = (0.0, 0.0)
        """Way and turn of the last tick."""

    @abstractmethod
    def _predict(self, rear_rad: FloatArray, curvature: float | None) -> tuple[float, float]:
        """Move mean and covariance by a tick's rotation; `curvature` by the steering, where it replaces the
        wheels' turn. Mean way and turn."""

    def _motion(
        self, state: FloatArray, noise: FloatArray, rear_rad: FloatArray, curvature: float | None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(7, n) states after the tick, ways and turns (n,), for states (7, n) and noise (2, n) of unit
        size, eqs (26a), (26b) with the heading at mid-step."""
        radius = self._nominal[:2, None] + state[MU:SIGMA]
        radius = radius + np.sqrt(np.maximum(state[SIGMA:], 0.0)) * noise
        left, right = rear_rad[:, None] * radius
        way = (left + right) / 2
        turn = (right - left) / self._geometry.track_rear_m if curvature is None else way * curvature
        out = state.copy()
        middle = state[PSI] + turn / 2
        out[E] += way * np.cos(middle)
        out[N] += way * np.sin(middle)
        out[PSI] += turn
        return out, way, turn

    def _advance(self, tick: Tick, rear_rad: FloatArray, teaches: bool) -> tuple[float, float]:
        curvature = None if teaches else self._steered_curvature(tick)
        way, turn = self._last = self._predict(rear_rad, curvature)
        if teaches:
            for k in (MU, MU + 1):
                self._cov[k, k] += self._drift**2 * tick.dt_s
            for k in (SIGMA, SIGMA + 1):  # eq. (28) as variance; E[Sigma^2] = mean^2 + variance
                square = self._mean[k] ** 2
                grown = self._cov[k, k] + SIGMA_STEP_STD**2 * (square + self._cov[k, k])
                self._cov[k, k] = min(grown, SIGMA_STD_LIMIT**2 * square)
        return way, turn

    def _stand(self) -> None:
        self._last = (0.0, 0.0)

    def _drift_on(self, dt_s: float) -> None:
        speed, yaw_rate = self._rate[0], self._steady_yaw_rate
        self._last = (speed * dt_s, yaw_rate * dt_s)
        self._mean[E] += speed * dt_s * math.cos(self._mean[PSI])
        self._mean[N] += speed * dt_s * math.sin(self._mean[PSI])
        self._mean[PSI] += yaw_rate * dt_s
        self._cov[[E, N], [E, N]] += dt_s**2 + (speed * dt_s * 0.1) ** 2
        self._cov[PSI, PSI] += COAST_YAW_STD**2 * dt_s

    # -- fixes ----------------------------------------------------------------------------------------------

    def _antenna_at(self, fix: Fix) -> tuple[FloatArray, FloatArray]:
        """Expected east and north (2,) of a fix, and their rows (2, 7)."""
        behind = 1.0 - fix.fraction
        way, turn = (behind * part for part in self._last)
        psi = float(self._mean[PSI])
        cos, sin = math.cos(psi - turn), math.sin(psi - turn)
        forward, left = self._antenna
        east = forward * cos - left * sin - way * math.cos(psi - turn / 2)
        north = forward * sin + left * cos - way * math.sin(psi - turn / 2)
        rows = np.zeros((2, SIZE))
        rows[0, E] = rows[1, N] = 1.0
        rows[:, PSI] = [-north, east]
        return self._mean[:2] + np.array([east, north]), rows

    def _distance(self, fix: Fix) -> tuple[float, float]:
        at, _ = self._antenna_at(fix)
        own = float(self._cov[E, E] + self._cov[N, N])
        return math.hypot(fix.east_m - at[0], fix.north_m - at[1]), own + fix.position_std_m**2

    def _weigh(self, fix: Fix) -> None:
        for axis, seen_m in enumerate((fix.east_m, fix.north_m)):
            at, rows = self._antenna_at(fix)
            off = np.array([seen_m - at[axis]])
            variance = position_variance(fix)
            # One filter is a batch of one; what is changed in place is this filter's own.
            scalar_update(
                self._mean[None], self._cov[None], off, rows[axis], variance, weights=self._fix_weights
            )
        symmetrise(self._cov[None])

    def _place(self, start: PoseStart, tick: Tick) -> None:
        fix = start.fix
        forward, left = self._antenna
        ahead = (1.0 - fix.fraction) * tick.dt_s * self._rate[0] - forward
        cos, sin = math.cos(start.heading_rad), math.sin(start.heading_rad)
        self._mean[:MU] = [
            fix.east_m + ahead * cos + left * sin,
            fix.north_m + ahead * sin - left * cos,
            start.heading_rad,
        ]
        self._cov[:MU] = 0.0
        self._cov[:, :MU] = 0.0
        self._cov[[E, N], [E, N]] = position_variance(fix)
        self._cov[PSI, PSI] = start.heading_std_rad**2

    # -- out ------------------------------------------------------------------------------------------------

    def _rear_moments(self) -> tuple[FloatArray, FloatArray]:
        return self._mean[MU:SIGMA].copy(), self._cov[MU:SIGMA, MU:SIGMA].copy()

    def _rear_noise(self) -> FloatArray:
        return self._mean[SIGMA:].copy()

    def _take_radii(self, mean_m: FloatArray, covariance_m2: FloatArray, noise_m2: FloatArray) -> None:
        self._cov[MU:] = 0.0
        self._cov[:, MU:] = 0.0
        self._mean[MU:SIGMA], self._mean[SIGMA:] = mean_m, noise_m2
        self._cov[MU:SIGMA, MU:SIGMA] = covariance_m2

    def _mean_pose(self) -> Pose:
        variance = np.maximum(np.diag(self._cov), 0.0)
        return Pose(
            east_m=float(self._mean[E]),
            north_m=float(self._mean[N]),
            heading_rad=math.remainder(float(self._mean[PSI]), 2 * math.pi),
            position_std_m=math.sqrt((variance[E] + variance[N]) / 2),
            heading_std_rad=math.sqrt(variance[PSI]),
        )


class AugEkf(AugKalman):
    """AUG-KF with the motion linearised at the mean."""

    def _predict(self, rear_rad: FloatArray, curvature: float | None) -> tuple[float, float]:
        moved, ways, turns = self._motion(self._mean[:, None], np.zeros((2, 1)), rear_rad, curvature)
        way, turn = float(ways[0]), float(turns[0])
        middle = float(self._mean[PSI]) + turn / 2
        cos, sin = math.cos(middle), math.sin(middle)
        by_way = rear_rad / 2
        track = self._geometry.track_rear_m
        by_turn = rear_rad * [-1.0, 1.0] / track if curvature is None else by_way * curvature
        by_radius = np.array([by_way * cos - way * sin * by_turn / 2, by_way * sin + way * cos * by_turn / 2])
        by_radius = np.vstack([by_radius, by_turn])
        jacobian = np.eye(SIZE)
        jacobian[E, PSI], jacobian[N, PSI] = -way * sin, way * cos
        jacobian[:MU, MU:SIGMA] = by_radius
        self._cov = jacobian @ self._cov @ jacobian.T
        self._cov[:MU, :MU] += (by_radius * self._mean[SIGMA:]) @ by_radius.T
        self._mean = moved[:, 0]
        return way, turn


class AugUkf(AugKalman):
    """AUG-KF with sigma points: 2 n of them, n = 9 with the noise, all of the same weight."""

    def _predict(self, rear_rad: FloatArray, curvature: float | None) -> tuple[float, float]:
        size = SIZE + 2
        root = _root(self._cov)
        spread = np.zeros((size, 2 * size))
        spread[:SIZE, :SIZE] = root
        spread[SIZE:, SIZE:size] = np.eye(2)
        spread[:, size:] = -spread[:, :size]
        spread *= math.sqrt(size)
        points = self._mean[:, None] + spread[:SIZE]
        moved, ways, turns = self._motion(points, spread[SIZE:], rear_rad, curvature)
        self._mean = moved.mean(axis=1)
        away = moved - self._mean[:, None]
        self._cov = away @ away.T / (2 * size)
        return float(ways.mean()), float(turns.mean())


def _root(covariance: FloatArray) -> FloatArray:
    """(n, n) R with R R' = covariance; places of no variance are left out.

    The states differ by many orders of size, so the root is taken of the correlations.
    """
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(std > 0.0, std, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))
