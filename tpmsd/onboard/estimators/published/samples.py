"""Representation by samples: weighted particles that are poses, each with its own radii.

In: movements and fixes. Out: a `Belief` of the rear pair. The pieces hold parameters alone; all that changes
is in `Particles`, which they are given. Per tick, [Lundquist 2013, Table I]:

    the motion model moves the poses by drawn radius errors      lines 9 to 11, 13
    weights are multiplied by p(fix | particle)                  line 12
    resampling                                                   lines 15 to 17

A particle's heading is never wrapped, and all start about one value, so means of headings need no circle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from tpmsd.foundation.wheels import FloatArray
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
    saved_numbers,
    saved_radii,
    wrapped,
)
from tpmsd.onboard.estimators.odometry_block import Block
from tpmsd.onboard.estimators.pose_start import PoseStart
from tpmsd.onboard.estimators.published.changes import ChangeModel
from tpmsd.onboard.estimators.published.gnss_likelihood import (
    PositionLog,
    block_measurements,
    course_measurement,
    position_variance,
    student_t_log,
)
from tpmsd.onboard.estimators.published.position_noise import PositionNoise
from tpmsd.onboard.estimators.published.radius_models import NIW, RadiusModel
from tpmsd.onboard.estimators.published.sampled_motion import (
    MID_STEP,
    WHEELS_IN,
    Particles,
    SampledMotion,
    move_poses,
)
from tpmsd.onboard.estimators.resampling import SYSTEMATIC, Lineage, Systematic, between_std, effective_number
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Fix


@dataclass(frozen=True, slots=True)
class SampledPieces:
    """Pieces of a sampled belief."""

    motion: SampledMotion = WHEELS_IN
    radii: RadiusModel = NIW
    likelihood: PositionLog = student_t_log
    resampling: Systematic = SYSTEMATIC
    changes: ChangeModel | None = None
    positions_alone: bool = False
    """True if courses, Doppler speeds and the gyro are no measurements, as in the paper."""
    heading_after: float = MID_STEP
    """Share of a tick's turn after which its heading is taken; 0 is psi_k, as (3) and (7) are printed."""
    position_floor_m: float = SETTINGS.position_floor_m
    """Least position error; at the resolution of a position the receiver's word is taken, the known R of
    (10d)."""
    position_noise: PositionNoise | None = None
    """Unknown variances of positions (32f); None: the receiver's word, and `likelihood`."""


class SampledBelief:
    """A `Belief`; draws from the generator it was given."""

    takes_blocks = True

    def __init__(self, car: FilterCar, pieces: SampledPieces, count: int, rng: np.random.Generator) -> None:
        self._car, self._pieces, self._rng = car, pieces, rng
        self.particles = Particles.uniform(count, pieces.radii.begin(count, car.nominal_m[:2], rng))
        self._lineage = Lineage(count)

    def predict(self, movement: Movement) -> tuple[float, float]:
        """Move all poses by one tick; return the mean distance (m) and turn (rad)."""
        particles, rng = self.particles, self._rng
        if isinstance(movement, RolledTick):
            pieces = self._pieces
            if movement.gated.informative:
                particles.radii = pieces.radii.forget(particles.radii, movement.gated.tick.dt_s, rng)
                if pieces.changes is not None and movement.judged:
                    pieces.changes.propose_changes(particles, pieces.radii, movement, self._car, rng)
            travel, turn, log = pieces.motion.advance(particles, pieces.radii, movement, self._car, rng)
            if log is not None:
                particles.multiply(log)
            return move_poses(particles, travel, turn, pieces.heading_after)
        particles.motion = None
        if isinstance(movement, Extrapolation):
            dt_s = movement.dt_s
            speeds = movement.speed_mps + SETTINGS.extrapolation_speed_std_mps * rng.standard_normal(
                particles.count
            )
            swing = SETTINGS.extrapolation_yaw_std * math.sqrt(dt_s) * rng.standard_normal(particles.count)
            return move_poses(particles, dt_s * speeds, dt_s * movement.yaw_rate_radps + swing)
        particles.moved[:] = 0.0
        return 0.0, 0.0

    def _fix_offsets(self, fix: Fix) -> tuple[FloatArray, FloatArray]:
        """Return the east and north offsets (N,), m, of a fix from each particle's antenna at the time of the
        fix."""
        east, north, heading = self.particles.pose - (1.0 - fix.fraction) * self.particles.moved
        forward, left = self._car.antenna_m
        if forward != 0.0 or left != 0.0:
            cos, sin = np.cos(heading), np.sin(heading)
            east, north = east + forward * cos - left * sin, north + forward * sin + left * cos
        return fix.east_m - east, fix.north_m - north

    def _position_variance(self, fix: Fix) -> float:
        return position_variance(fix, self._pieces.position_floor_m)

    def distance(self, measurement: FixMeasurement) -> tuple[float, float]:
        """Return the distance from the mean; the variance has the spread of the particles, and a share for
        the receiver's slow errors in it."""
        off = np.stack(self._fix_offsets(measurement.fix))
        weights = self.particles.weights
        mean = off @ weights
        spread = float(np.square(off - mean[:, None]).sum(axis=0) @ weights)
        slow = self._position_variance(measurement.fix) / 9.0
        return math.hypot(*mean.tolist()), measurement.fix.position_std_m**2 + slow + spread

    def update(self, measurement: FixMeasurement) -> None:
        """Multiply the weights by the likelihoods of position (22) and course."""
        particles, pieces = self.particles, self._pieces
        if measurement.by_position:
            east, north = self._fix_offsets(measurement.fix)
            particles.multiply(self._position_log_likelihood(measurement, east, north))
        if (
            not pieces.positions_alone
            and (seen := course_measurement(measurement, self._car.antenna_m)) is not None
        ):
            off = np.remainder(seen.heading_rad - particles.pose[2] + math.pi, 2 * math.pi) - math.pi
            variance = max(seen.variance_rad2, SETTINGS.course_floor_sampled_rad**2)
            particles.multiply(pieces.likelihood(off * off / variance, 1))

    def _position_log_likelihood(
        self, measurement: FixMeasurement, east: FloatArray, north: FloatArray
    ) -> FloatArray:
        """Return the log-likelihood (N,) of a position with these offsets: (22), or (34) where its variances
        are unknown."""
        particles, pieces = self.particles, self._pieces
        if pieces.position_noise is None:
            return pieces.likelihood(
                (east * east + north * north) / self._position_variance(measurement.fix), 2
            )
        if particles.position_noise is None:
            stated_m = measurement.fix.position_std_m
            particles.position_noise = pieces.position_noise.begin(particles.count, stated_m)
        error_m = np.stack([east, north])
        return pieces.position_noise.weigh(particles.position_noise, error_m, measurement.interval_s)

    def correct_by_block(self, block: Block, bias_rad2: float) -> None:
        """Multiply the weights by the likelihoods of Doppler distance and turn, given each particle's radii;
        the noise of single ticks averages out over the block."""
        pieces = self._pieces
        if pieces.positions_alone:
            return
        location, scale, _ = pieces.radii.marginals(self.particles.radii)
        track_m = self._car.geometry.track_rear_m
        for seen in block_measurements(block, bias_rad2, self._car.nominal_m[:2], track_m):
            noise = np.square(seen.by_radius) @ scale / max(block.ticks, 1)
            squared = np.square(seen.residual - seen.by_radius @ location) / (seen.variance_sampled + noise)
            self.particles.multiply(pieces.likelihood(squared, 1))

    def finish_tick(self, gated: GatedTick) -> None:
        """Resample if the effective number is too small."""
        particles, pieces = self.particles, self._pieces
        self._lineage.elapse(gated.tick.dt_s)
        chosen = pieces.resampling(particles.weights, self._rng)
        if chosen is not None:
            self._lineage.keep(chosen)
            particles.keep(chosen)
            particles.radii = pieces.radii.select(particles.radii, chosen)

    def moments(self) -> Moments:
        """Return the weighted mean and covariance; (24a), (24b) for the radii."""
        particles, radii = self.particles, self._pieces.radii
        weights = particles.weights
        mean_m, covariance_m2 = radii.moments(particles.radii, weights)
        noise_m = np.sqrt(radii.noise(particles.radii, weights))
        mean = particles.pose @ weights
        away = particles.pose - mean[:, None]
        spread = np.square(away, out=away) @ weights
        pose = Pose(
            east_m=float(mean[0]),
            north_m=float(mean[1]),
            heading_rad=wrapped(float(mean[2])),
            position_std_m=math.sqrt((spread[0] + spread[1]) / 2),
            heading_std_rad=math.sqrt(spread[2]),
        )
        between = between_std(radii.marginals(particles.radii)[0], weights)
        drawn = effective_number(weights), float(self._lineage.ancestors), between
        return Moments(mean_m, covariance_m2, noise_m, pose, *drawn)

    def set_pose(self, start: PoseStart, measurement: FixMeasurement) -> None:
        """Spread the particles about a pose that fixes determine."""
        fix, particles, rng = start.fix, self.particles, self._rng
        count = particles.count
        heading = start.heading_rad + start.heading_std_rad * rng.standard_normal(count)
        forward, left = self._car.antenna_m
        ahead = (1.0 - fix.fraction) * measurement.tick.dt_s * measurement.speed_mps - forward
        cos, sin = np.cos(heading), np.sin(heading)
        std = math.sqrt(self._position_variance(fix))
        particles.pose[0] = fix.east_m + std * rng.standard_normal(count) + ahead * cos + left * sin
        particles.pose[1] = fix.north_m + std * rng.standard_normal(count) + ahead * sin - left * cos
        particles.pose[2] = heading
        particles.moved[:] = 0.0
        particles.motion = None
        particles.reset_weights()

    def forget_pose(self) -> None:
        """Do nothing: no state belongs to the pose but the poses themselves, which are placed again."""

    def snapshot(self) -> dict[str, Any]:
        """Return the moments of the radii, and the variances of one tick's radius errors, as plain
        numbers."""
        particles, radii = self.particles, self._pieces.radii
        mean, covariance = radii.moments(particles.radii, particles.weights)
        noise = radii.noise(particles.radii, particles.weights)
        return {
            "mean_m": mean.tolist(),
            "covariance_m2": covariance.tolist(),
            "noise_m2": noise.tolist(),
        }

    def restore(self, saved: Saved, since_s: float = NIGHT_S) -> None:
        """Draw the radii from the saved moments."""
        mean, covariance = saved_radii(saved, self._car.nominal_m[:2])
        noise = saved_noise(saved)
        radii = self._pieces.radii
        self.particles.radii = radii.draw_from_moments(
            self.particles.radii, mean, covariance, noise, self._rng
        )


def saved_noise(saved: Saved) -> FloatArray:
    """Return the (2,) variances of one tick's radius error of a snapshot; ValueError if they are none."""
    noise = saved_numbers(saved, "noise_m2", (2,), 1.0)
    if np.any(noise <= 0.0):
        raise ValueError("the saved noise_m2 is not two positive variances")
    return noise
