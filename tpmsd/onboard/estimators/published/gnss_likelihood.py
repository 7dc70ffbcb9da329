"""Likelihoods of positions for sampled beliefs.

In: a `Fix` and how far the particles are from it. Out: a log-likelihood per particle.

[Lundquist 2013, eq. 10d] has white Gaussian errors of one known size. Here the size is what the receiver
states of each fix; the tails are Gaussian as printed, or heavy (multipath): Student-t, so that one outlier
cannot select the particles. That errors of real receivers are correlated over tens of seconds is left out as
in the paper, which makes the posterior too narrow; the Gaussian-sum filter carries them as a state.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from tpmsd.car.physics.priors import FIX_AGE_S, GYRO_SCALE, SPEED_AGE_S
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.belief import FixMeasurement
from tpmsd.onboard.estimators.odometry_block import Block
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Fix

PositionLog = Callable[[FloatArray, int], FloatArray]
"""Squared Mahalanobis distances (N,) and dimension -> log density up to a constant."""


def student_t_log(squared: FloatArray, dimension: int) -> FloatArray:
    """Return the log density, up to a constant, of a multivariate Student-t; `squared` is the squared
    Mahalanobis distance."""
    dof = SETTINGS.position_dof
    out: FloatArray = -0.5 * (dof + dimension) * np.log1p(squared / dof)
    return out


def gaussian_log(squared: FloatArray, dimension: int) -> FloatArray:
    """Return the log-likelihood of a Gaussian, the paper's (10d), up to a constant; `squared` as for
    `student_t_log`."""
    return -0.5 * squared


def position_variance(fix: Fix, floor_m: float = SETTINGS.position_floor_m) -> float:
    """Return the variance per axis of a position, m2, not below the floor's."""
    return max(fix.position_std_m, floor_m) ** 2


class CourseMeasurement(NamedTuple):
    """A receiver's course as a heading of the car at the end of its tick."""

    heading_rad: float
    variance_rad2: float


def course_measurement(
    measurement: FixMeasurement, antenna_m: tuple[float, float]
) -> CourseMeasurement | None:
    """Return the heading by a fix's course, with the usual lag of positions and speeds; None where it has no
    course or the car is slow. The model is that of `measurements.course`, with each state of that at its
    mean."""
    fix, rate = measurement.fix, measurement.yaw_rate_radps
    if not (math.isfinite(fix.heading_rad) and measurement.speed_mps > SETTINGS.course_speed_mps):
        return None
    behind_s = (1.0 - fix.fraction) * measurement.tick.dt_s + FIX_AGE_S.mean + SPEED_AGE_S.mean
    forward, left = antenna_m
    swing = math.atan2(rate * forward, max(measurement.speed_mps - rate * left, 0.1))
    doppler = (fix.speed_noise * SETTINGS.doppler_mps / measurement.speed_mps) ** 2
    repeated = max(1.0, 2 * SETTINGS.doppler_tau_s / min(measurement.interval_s, 2.0))
    age = (SETTINGS.timing_s**2 + FIX_AGE_S.std**2 + SPEED_AGE_S.std**2) * rate**2
    return CourseMeasurement(
        fix.heading_rad + rate * behind_s - swing, doppler * repeated + age + SETTINGS.course_floor_rad**2
    )


class BlockMeasurement(NamedTuple):
    """A measurement that is linear in the rear radii."""

    residual: float
    """Measured minus what nominal radii make of the rotation."""
    by_radius: FloatArray
    """(2,) derivative by the radii of rl and rr."""
    variance: float
    variance_sampled: float
    """Variance with the floor below which a bootstrap proposal would starve."""


def block_measurements(
    block: Block, bias_rad2: float, nominal_m: FloatArray, track_m: float
) -> Iterator[BlockMeasurement]:
    """Yield the Doppler distance and the turn by the gyro of a block of the rear pair at nominal radii, where
    it has them; the models are those of `measurements.doppler_distance` and `gyro_turn`."""
    angle = block.angle_rad[:2]
    if math.isfinite(block.doppler_distance_m):
        variance = (
            (block.speed_noise * SETTINGS.doppler_mps) ** 2 * 2 * SETTINGS.doppler_tau_s * block.duration_s
        )
        age_s2 = SETTINGS.timing_s**2 + FIX_AGE_S.std**2 + SPEED_AGE_S.std**2
        variance += age_s2 * block.speed_swing_mps**2 + block.reading_distance_m**2
        late_m = (FIX_AGE_S.mean + SPEED_AGE_S.mean) * block.speed_change_mps
        residual = block.doppler_distance_m + late_m - float(angle @ nominal_m) / 2
        yield BlockMeasurement(residual, angle / 2, variance, max(variance, SETTINGS.distance_floor_m**2))
    if math.isfinite(block.gyro_heading_change_rad):
        variance = (
            SETTINGS.gyro_noise_radps**2 * block.duration_s + block.reading_heading_change_rad**2 + bias_rad2
        )
        variance += ((SETTINGS.gyro_relative + GYRO_SCALE.std) * block.gyro_heading_change_rad) ** 2
        turn = float(angle[1] * nominal_m[1] - angle[0] * nominal_m[0]) / track_m
        residual = block.gyro_heading_change_rad - turn
        # What both radii have in common acts by the gyro's turn, as in `gyro_turn`: the wheels' has the
        # residual's reading error, and would pull them down without end.
        rolled_m = float(angle @ nominal_m)
        misread_rad = 0.0 if rolled_m == 0.0 else -0.5 * track_m * residual * float(angle.sum()) / rolled_m
        by_radius = (np.array([-angle[0], angle[1]]) - misread_rad) / track_m
        yield BlockMeasurement(residual, by_radius, variance, max(variance, SETTINGS.turn_floor_rad**2))
