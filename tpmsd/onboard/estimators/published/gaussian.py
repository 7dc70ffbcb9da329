"""Representation by one Gaussian: Kalman filters over the augmented state of [Lundquist 2013, eqs 25-29].

In: movements and fixes. Out: a `Belief` of the rear pair.

State: east, north, heading, mu_rl, mu_rr, Sigma_rl, Sigma_rr. A `Transform` sends mean and covariance through
the motion: linearised (AUG-EKF), or by points drawn from state and radius noise together (AUG-UKF).

What a Kalman filter cannot do here: Sigma enters the motion only as the size of a noise, so the state's
covariance with it stays zero and no fix ever changes it. Its own variance would grow with (28) for ever and
is held at what the first minutes make of it. So the first Sigma is a tuning parameter.

What was added: fixes that do not fit lose influence, as in `batched_kalman`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.bank.batched_kalman import Weights, scalar_update, square_weights, symmetrise
from tpmsd.onboard.estimators.base import NIGHT_S
from tpmsd.onboard.estimators.belief import (
    Extrapolation,
    FilterCar,
    FixMeasurement,
    GatedTick,
    Moments,
    Movement,
    Pose,
    RolledTick,
    Saved,
    saved_radii,
    wrapped,
)
from tpmsd.onboard.estimators.odometry_block import Block
from tpmsd.onboard.estimators.pose_start import PoseStart
from tpmsd.onboard.estimators.published.gnss_likelihood import (
    block_measurements,
    course_measurement,
    position_variance,
)
from tpmsd.onboard.estimators.published.samples import saved_noise
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Fix

E, N, PSI, MU, SIGMA = 0, 1, 2, 3, 5
SIZE = 7
"""Places in the state; MU and SIGMA take two each, rl before rr."""


@dataclass(frozen=True, slots=True)
class Roll:
    """Motion of the state in a tick."""

    rear_rad: FloatArray
    """(2,)"""
    nominal_m: FloatArray
    """(2,)"""
    track_rear_m: float
    curvature: float | None
    """Curvature by the steering, where it replaces the wheels' turn."""


def move(state: FloatArray, noise: FloatArray, roll: Roll) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the states (7, n) after the tick with distances and turns (n,), for states (7, n) and noise (2,
    n) of unit size, eqs (26a), (26b) with the heading at mid-step."""
    radius = roll.nominal_m[:, None] + state[MU:SIGMA]
    radius = radius + np.sqrt(np.maximum(state[SIGMA:], 0.0)) * noise
    left, right = roll.rear_rad[:, None] * radius
    travel = (left + right) / 2
    turn = (right - left) / roll.track_rear_m if roll.curvature is None else travel * roll.curvature
    out = state.copy()
    middle = state[PSI] + turn / 2
    out[E] += travel * np.cos(middle)
    out[N] += travel * np.sin(middle)
    out[PSI] += turn
    return out, travel, turn


Moved = tuple[FloatArray, FloatArray, float, float]
"""Mean (7,), covariance (7, 7), expected way and turn."""


class Transform(Protocol):
    """Sends a Gaussian through `move`."""

    def __call__(self, mean: FloatArray, covariance: FloatArray, roll: Roll) -> Moved:
        """Return mean and covariance after the tick."""
        ...


def linearised(mean: FloatArray, covariance: FloatArray, roll: Roll) -> Moved:
    """Transform by the Jacobian at the mean: the extended Kalman filter."""
    moved, travels, turns = move(mean[:, None], np.zeros((2, 1)), roll)
    travel, turn = float(travels[0]), float(turns[0])
    middle = float(mean[PSI]) + turn / 2
    cos, sin = math.cos(middle), math.sin(middle)
    by_travel = roll.rear_rad / 2
    if roll.curvature is None:
        by_turn = roll.rear_rad * [-1.0, 1.0] / roll.track_rear_m
    else:
        by_turn = by_travel * roll.curvature
    by_radius = np.array(
        [by_travel * cos - travel * sin * by_turn / 2, by_travel * sin + travel * cos * by_turn / 2]
    )
    by_radius = np.vstack([by_radius, by_turn])
    jacobian = np.eye(SIZE)
    jacobian[E, PSI], jacobian[N, PSI] = -travel * sin, travel * cos
    jacobian[:MU, MU:SIGMA] = by_radius
    out = jacobian @ covariance @ jacobian.T
    out[:MU, :MU] += (by_radius * mean[SIGMA:]) @ by_radius.T
    return moved[:, 0], out, travel, turn


def unscented(mean: FloatArray, covariance: FloatArray, roll: Roll) -> Moved:
    """Transform by sigma points: 2 n of them, n = 9 with the noise, all of the same weight."""
    size = SIZE + 2
    spread = np.zeros((size, 2 * size))
    spread[:SIZE, :SIZE] = _square_root(covariance)
    spread[SIZE:, SIZE:size] = np.eye(2)
    spread[:, size:] = -spread[:, :size]
    spread *= math.sqrt(size)
    moved, travels, turns = move(mean[:, None] + spread[:SIZE], spread[SIZE:], roll)
    centre = moved.mean(axis=1)
    away = moved - centre[:, None]
    return centre, away @ away.T / (2 * size), float(travels.mean()), float(turns.mean())


def _square_root(covariance: FloatArray) -> FloatArray:
    """Return R (n, n) with R R' = covariance; a state without variance has a row of zeros.

    The states differ by many orders of size, so the root is taken of the correlations.
    """
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(std > 0.0, std, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


@dataclass(frozen=True, slots=True)
class GaussianPieces:
    """Pieces of a Gaussian belief."""

    transform: Transform
    weights: Weights = square_weights
    """Weights of fixes, by how they fit."""
    drift_std_m: float = SETTINGS.walk_gaussian_m
    """Random walk of mu over a second."""
    noise_std_m: float = SETTINGS.sigma_first_m
    """Square root of Sigma."""


class GaussianBelief:
    """A `Belief`."""

    takes_blocks = True

    def __init__(self, car: FilterCar, pieces: GaussianPieces) -> None:
        self._car, self._pieces = car, pieces
        self.mean = np.zeros(SIZE)
        self.mean[SIGMA:] = pieces.noise_std_m**2
        spread = (SETTINGS.radius_prior * car.nominal_m[:2]) ** 2
        self.covariance = np.diag([0.0, 0.0, 0.0, *spread, 0.0, 0.0])
        self._last = (0.0, 0.0)
        """Way and turn of the last tick."""

    def predict(self, movement: Movement) -> tuple[float, float]:
        """Move by one tick; return its expected distance (m) and turn (rad)."""
        if isinstance(movement, RolledTick):
            return self._predict_rolling(movement)
        self._last = (0.0, 0.0)
        if isinstance(movement, Extrapolation):
            dt_s, mean, covariance = movement.dt_s, self.mean, self.covariance
            travel, turn = self._last = (movement.speed_mps * dt_s, movement.yaw_rate_radps * dt_s)
            mean[E] += travel * math.cos(mean[PSI])
            mean[N] += travel * math.sin(mean[PSI])
            mean[PSI] += turn
            own = (SETTINGS.extrapolation_speed_std_mps * dt_s) ** 2 + (
                travel * SETTINGS.extrapolation_speed_share
            ) ** 2
            covariance[[E, N], [E, N]] += own
            covariance[PSI, PSI] += SETTINGS.extrapolation_yaw_std**2 * dt_s
        return self._last

    def _predict_rolling(self, rolling: RolledTick) -> tuple[float, float]:
        """Transform the Gaussian by the wheels' rotation; return the expected distance (m) and turn (rad)."""
        car, mean = self._car, self.mean
        roll = Roll(rolling.angle_rad[:2], car.nominal_m[:2], car.geometry.track_rear_m, rolling.curvature)
        self.mean, self.covariance, travel, turn = self._pieces.transform(mean, self.covariance, roll)
        self._last = (travel, turn)
        if rolling.gated.informative:
            mean, covariance = self.mean, self.covariance
            for k in (MU, MU + 1):
                covariance[k, k] += self._pieces.drift_std_m**2 * rolling.gated.tick.dt_s
            for k in (SIGMA, SIGMA + 1):  # eq. (28) as variance; E[Sigma^2] = mean^2 + variance
                square = mean[k] ** 2
                grown = covariance[k, k] + SETTINGS.sigma_step**2 * (square + covariance[k, k])
                covariance[k, k] = min(grown, SETTINGS.sigma_std_limit**2 * square)
        return self._last

    def _expected_antenna(self, fix: Fix) -> tuple[FloatArray, FloatArray]:
        """Return the expected east and north (2,) of the antenna at a fix, and their rows (2, 7)."""
        behind = 1.0 - fix.fraction
        travel, turn = (behind * part for part in self._last)
        psi = float(self.mean[PSI])
        cos, sin = math.cos(psi - turn), math.sin(psi - turn)
        forward, left = self._car.antenna_m
        east = forward * cos - left * sin - travel * math.cos(psi - turn / 2)
        north = forward * sin + left * cos - travel * math.sin(psi - turn / 2)
        rows = np.zeros((2, SIZE))
        rows[0, E] = rows[1, N] = 1.0
        rows[:, PSI] = [-north, east]
        return self.mean[:2] + np.array([east, north]), rows

    def distance(self, measurement: FixMeasurement) -> tuple[float, float]:
        """Return the distance from the mean; its variance is this filter's and the fix's."""
        fix = measurement.fix
        at, _ = self._expected_antenna(fix)
        own = float(self.covariance[E, E] + self.covariance[N, N])
        return math.hypot(fix.east_m - at[0], fix.north_m - at[1]), own + fix.position_std_m**2

    def update(self, measurement: FixMeasurement) -> None:
        """Correct by the fix: by its east, its north and its course, one after the other."""
        fix = measurement.fix
        for axis, seen_m in enumerate((fix.east_m, fix.north_m)):
            if measurement.by_position:
                at, rows = self._expected_antenna(fix)
                self._correct(seen_m - at[axis], rows[axis], position_variance(fix))
        if (seen := course_measurement(measurement, self._car.antenna_m)) is not None:
            row = np.zeros(SIZE)
            row[PSI] = 1.0
            self._correct(
                math.remainder(seen.heading_rad - self.mean[PSI], 2 * math.pi), row, seen.variance_rad2
            )
        symmetrise(self.covariance[None])

    def _correct(self, innovation: float, row: FloatArray, variance: float) -> None:
        """Correct by one scalar innovation with its measurement row and variance."""
        # One filter is a batch of one; what is changed in place is this filter's own.
        scalar_update(
            *(self.mean[None], self.covariance[None], np.array([innovation]), row, variance),
            weights=self._pieces.weights,
        )

    def correct_by_block(self, block: Block, bias_rad2: float) -> None:
        """Correct by the Doppler distance of the block, then by the turn of the gyro."""
        track_m = self._car.geometry.track_rear_m
        for seen in block_measurements(block, bias_rad2, self._car.nominal_m[:2], track_m):
            row = np.zeros(SIZE)
            row[MU:SIGMA] = seen.by_radius
            self._correct(seen.residual - float(row @ self.mean), row, seen.variance)
        symmetrise(self.covariance[None])

    def finish_tick(self, gated: GatedTick) -> None:
        """Do nothing: this belief has no work left after the fixes."""

    def forget_pose(self) -> None:
        """Do nothing: no state belongs to the pose but the pose itself."""

    def set_pose(self, start: PoseStart, measurement: FixMeasurement) -> None:
        """Set the pose again, uncorrelated with the radii."""
        fix = start.fix
        forward, left = self._car.antenna_m
        ahead = (1.0 - fix.fraction) * measurement.tick.dt_s * measurement.speed_mps - forward
        cos, sin = math.cos(start.heading_rad), math.sin(start.heading_rad)
        self.mean[:MU] = [
            fix.east_m + ahead * cos + left * sin,
            fix.north_m + ahead * sin - left * cos,
            start.heading_rad,
        ]
        self.covariance[:MU] = 0.0
        self.covariance[:, :MU] = 0.0
        self.covariance[[E, N], [E, N]] = position_variance(fix)
        self.covariance[PSI, PSI] = start.heading_std_rad**2

    def moments(self) -> Moments:
        """Return the moments of this one Gaussian."""
        mean = self.mean
        variance = np.maximum(np.diag(self.covariance), 0.0)
        pose = Pose(
            east_m=float(mean[E]),
            north_m=float(mean[N]),
            heading_rad=wrapped(float(mean[PSI])),
            position_std_m=math.sqrt((variance[E] + variance[N]) / 2),
            heading_std_rad=math.sqrt(variance[PSI]),
        )
        radii = self.covariance[MU:SIGMA, MU:SIGMA].copy()
        return Moments(mean[MU:SIGMA].copy(), radii, np.sqrt(mean[SIGMA:]), pose, 1.0)

    def snapshot(self) -> dict[str, Any]:
        """Return the moments of the radii, and Sigma, as plain numbers."""
        return {
            "mean_m": self.mean[MU:SIGMA].tolist(),
            "covariance_m2": self.covariance[MU:SIGMA, MU:SIGMA].tolist(),
            "noise_m2": self.mean[SIGMA:].tolist(),
        }

    def restore(self, saved: Saved, since_s: float = NIGHT_S) -> None:
        """Restore radii and Sigma, uncorrelated with the pose."""
        mean, covariance = saved_radii(saved, self._car.nominal_m[:2])
        noise = saved_noise(saved)
        self.covariance[MU:] = 0.0
        self.covariance[:, MU:] = 0.0
        self.mean[MU:SIGMA], self.mean[SIGMA:] = mean, noise
        self.covariance[MU:SIGMA, MU:SIGMA] = covariance
