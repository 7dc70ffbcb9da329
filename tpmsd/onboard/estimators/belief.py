"""Beliefs about pose and radii, which a `RadiusFilter` delegates to, and the records between them.

In: movements and fixes. Out: `Moments`. A belief is made of pieces (`table`): the filter decides *whether* a
tick is informative and a fix is used, the belief *what follows* from it. Wheels are in the filter's order,
rl, rr[, fl, fr], in all arrays here; d is their number.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.base import NIGHT_S, RadiusStatement
from tpmsd.onboard.estimators.odometry_block import Block
from tpmsd.onboard.estimators.pose_start import PoseStart
from tpmsd.onboard.timeline.tick import Fix, Tick

Saved = Mapping[str, Any]
"""Contents of a state file for an estimator: anything at all, until it was checked."""


@dataclass(frozen=True, slots=True)
class FilterCar:
    """Car as a belief knows it."""

    order: tuple[int, ...]
    """Places of the filter's wheels in arrays of four."""
    nominal_m: FloatArray
    """(d,) nominal radii."""
    geometry: WheelPositions
    antenna_m: tuple[float, float]
    """Forward and left of the middle of the rear axle."""
    driven_front: bool = False
    driven_rear: bool = False

    def virtual_motion(self, left_rad: float, right_rad: float) -> tuple[float, float]:
        """Return distance (m) and turn (rad) of a tick by nominal radii: [Lundquist 2013, eq. 4] times T."""
        left_m, right_m = self.nominal_m[:2].tolist()
        left, right = left_rad * left_m, right_rad * right_m
        return (left + right) / 2, (right - left) / self.geometry.track_rear_m


class Pose(NamedTuple):
    """Pose of the middle of the rear axle, with its uncertainty."""

    east_m: float
    north_m: float
    heading_rad: float
    position_std_m: float
    heading_std_rad: float


def wrapped(heading_rad: float) -> float:
    """Return the heading wrapped to within half a turn of east, rad; NaN for one that is not finite."""
    return math.remainder(heading_rad, 2 * math.pi) if math.isfinite(heading_rad) else math.nan


class Moments(NamedTuple):
    """Moments that a belief states."""

    mean_m: FloatArray
    """(d,) posterior mean of radius minus nominal."""
    covariance_m2: FloatArray
    """(d, d)"""
    noise_std_m: FloatArray
    """(d,) standard deviation of one tick's radius error."""
    pose: Pose
    effective: float
    """Effective number of particles or hypotheses; 1 where there are none."""
    ancestors: float = math.nan
    """See `RadiusEstimate`, for the next two as well."""
    between_std_m: float = math.nan
    stated: RadiusStatement | None = None


class GatedTick(NamedTuple):
    """A tick with the gates' decisions on it."""

    tick: Tick
    informative: bool
    """True if radii may be learned from it."""
    speed_mps: float
    """Smoothed."""
    accel_mps2: float
    """Smoothed."""
    gyro_trusted: bool


class RolledTick(NamedTuple):
    """Rotation of the wheels within a tick, and the motion that nominal radii make of it."""

    gated: GatedTick
    angle_rad: FloatArray
    """(d,) rotation; finite for the rear pair."""
    distance_m: float
    """Distance by nominal radii (`FilterCar.virtual_motion`)."""
    heading_change_rad: float
    """Turn by nominal radii."""
    curvature: float | None
    """Curvature by the steering, where it replaces the wheels' turn [Lundquist 2013, eq. 38c]."""
    judged: bool
    """True if fixes come that can judge a jump hypothesis."""


@dataclass(frozen=True, slots=True)
class Standstill:
    """The rear wheels did not turn."""


@dataclass(frozen=True, slots=True)
class Extrapolation:
    """Motion without rear rotation: extrapolated at the last speed and yaw rate."""

    dt_s: float
    speed_mps: float
    yaw_rate_radps: float


Movement = RolledTick | Standstill | Extrapolation


class FixMeasurement(NamedTuple):
    """A fix, and the motion in which it came."""

    fix: Fix
    tick: Tick
    speed_mps: float
    yaw_rate_radps: float
    interval_s: float
    """Since the last one that was used."""
    by_position: bool = True
    """True if its position is a measurement, and not its course alone."""


class Belief(Protocol):
    """Beliefs differ in representation, models and likelihoods; the verbs are the same."""

    takes_blocks: bool
    """True if `correct_by_block` does anything."""

    def predict(self, movement: Movement) -> tuple[float, float]:
        """Move by one tick, learning from it if it is informative; return the expected distance (m) and turn
        (rad)."""
        ...

    def distance(self, measurement: FixMeasurement) -> tuple[float, float]:
        """Return the distance (m) of a fix from its expected position, and the variance (m2) of that."""
        ...

    def update(self, measurement: FixMeasurement) -> None:
        """Correct by a fix that is used as a measurement."""
        ...

    def correct_by_block(self, block: Block, bias_rad2: float) -> None:
        """Correct by an informative block's Doppler distance and turn by the gyro, where the belief makes no
        blocks of its own; `bias_rad2`: variance of the turn that the gyro's bias leaves."""
        ...

    def finish_tick(self, gated: GatedTick) -> None:
        """Do the work that follows the fixes of a tick, used or not: resampling, blocks of odometry."""
        ...

    def moments(self) -> Moments:
        """Return the posterior moments of radii and pose."""
        ...

    def set_pose(self, start: PoseStart, measurement: FixMeasurement) -> None:
        """Set the pose to one that fixes determine; the radii stay."""
        ...

    def forget_pose(self) -> None:
        """Drop the state that belongs to a pose that was given up; the radii stay."""
        ...

    def snapshot(self) -> dict[str, Any]:
        """Return what was learned as plain numbers: `mean_m` and `covariance_m2` of the radii, and entries of
        its own."""
        ...

    def restore(self, saved: Saved, since_s: float = NIGHT_S) -> None:
        """Restore a snapshot of `since_s` seconds of driving ago; ValueError, and nothing changed, if it does
        not fit."""
        ...


def saved_numbers(saved: Saved, key: str, shape: tuple[int, ...], limit: float) -> FloatArray:
    """Return the finite numbers under a key of a snapshot, of this shape and at most `limit` in magnitude;
    ValueError otherwise."""
    try:
        values = np.asarray(saved[key], dtype=np.float64)
    except (KeyError, TypeError, OverflowError, ValueError) as error:
        raise ValueError(f"the saved {key} cannot be read: {type(error).__name__}") from error
    if values.shape != shape:
        raise ValueError(f"the saved {key} has another shape: {values.shape}, not {shape}")
    if not np.all(np.abs(values) <= limit):  # false for NaN
        raise ValueError(f"the saved {key} is not finite or beyond {limit:g}")
    return values


def saved_covariance(saved: Saved, key: str, size: int, limit: float) -> FloatArray:
    """Return the (size, size) covariance under a key of a snapshot; ValueError if it is none (rounding is
    allowed for)."""
    matrix = saved_numbers(saved, key, (size, size), limit)
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-30))
    correlations = matrix / np.outer(scale, scale)
    if np.any(np.diag(matrix) < 0.0) or not np.allclose(correlations, correlations.T, atol=1e-6):
        raise ValueError(f"the saved {key} is no covariance")
    if np.linalg.eigvalsh(correlations).min() < -1e-6:
        raise ValueError(f"the saved {key} is no covariance")
    return matrix


RADIUS_LIMIT = 0.1
"""Saved radii further off nominal than this share are absurd: no tyre of that size fits the rim."""


def saved_radii(saved: Saved, nominal_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean (d,) and covariance (d, d) of the radii of a snapshot; ValueError if absent or absurd."""
    limit = RADIUS_LIMIT * float(nominal_m.max())
    mean = saved_numbers(saved, "mean_m", nominal_m.shape, limit)
    return mean, saved_covariance(saved, "covariance_m2", nominal_m.size, limit**2)
