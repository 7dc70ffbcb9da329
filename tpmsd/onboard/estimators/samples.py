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
    Car,
    Coasting,
    Moment,
    Moments,
    Movement,
    Pose,
    Rolling,
    Saved,
    Sight,
    numbers,
    saved_radii,
    wrapped,
)
from tpmsd.onboard.estimators.changes import ChangeModel
from tpmsd.onboard.estimators.gnss_likelihood import PositionLog, position_variance, student_t_log
from tpmsd.onboard.estimators.pose_start import PoseStart
from tpmsd.onboard.estimators.radius_models import NIW, RadiusModel
from tpmsd.onboard.estimators.resampling import SYSTEMATIC, Systematic, effective_number
from tpmsd.onboard.estimators.sampled_motion import WHEELS_IN, Particles, SampledMotion, go
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Fix


@dataclass(frozen=True, slots=True)
class SampledPieces:
    """What a sampled belief is made of."""

    motion: SampledMotion = WHEELS_IN
    radii: RadiusModel = NIW
    likelihood: PositionLog = student_t_log
    resampling: Systematic = SYSTEMATIC
    changes: ChangeModel | None = None


class SampledBelief:
    """A `Belief`; draws from the generator it was given."""

    def __init__(self, car: Car, pieces: SampledPieces, count: int, rng: np.random.Generator) -> None:
        self._car, self._pieces, self._rng = car, pieces, rng
        self.particles = Particles.even(count, pieces.radii.begin(count, car.nominal_m[:2], rng))

    def predict(self, movement: Movement) -> tuple[float, float]:
        """Move all poses by one tick."""
        particles, rng = self.particles, self._rng
        if isinstance(movement, Rolling):
            pieces = self._pieces
            if movement.moment.informative:
                particles.radii = pieces.radii.forget(particles.radii, movement.moment.tick.dt_s, rng)
                if pieces.changes is not None and movement.judged:
                    pieces.changes.suppose(particles, pieces.radii, movement, self._car, rng)
            way, turn, log = pieces.motion.advance(particles, pieces.radii, movement, self._car, rng)
            if log is not None:
                particles.multiply(log)
            return go(particles, way, turn)
        particles.motion = None
        if isinstance(movement, Coasting):
            dt_s = movement.dt_s
            speeds = movement.speed_mps + SETTINGS.coast_speed_std_mps * rng.standard_normal(particles.count)
            swing = SETTINGS.coast_yaw_std * math.sqrt(dt_s) * rng.standard_normal(particles.count)
            return go(particles, dt_s * speeds, dt_s * movement.yaw_rate_radps + swing)
        particles.moved[:] = 0.0
        return 0.0, 0.0

    def _off(self, fix: Fix) -> tuple[FloatArray, FloatArray]:
        """East and north (N,) of a fix from each particle's antenna at the time of the fix."""
        east, north, heading = self.particles.pose - (1.0 - fix.fraction) * self.particles.moved
        forward, left = self._car.antenna_m
        if forward != 0.0 or left != 0.0:
            cos, sin = np.cos(heading), np.sin(heading)
            east, north = east + forward * cos - left * sin, north + forward * sin + left * cos
        return fix.east_m - east, fix.north_m - north

    def distance(self, sight: Sight) -> tuple[float, float]:
        """Mean distance; the spread of the particles is in it, a share of the variance covers the rest."""
        off = float(self.particles.weights @ np.hypot(*self._off(sight.fix)))
        return off, sight.fix.position_std_m**2 + position_variance(sight.fix) / 9.0

    def update(self, sight: Sight) -> None:
        """Multiply the weights by the likelihood of the position (22)."""
        east, north = self._off(sight.fix)
        squared = (east * east + north * north) / position_variance(sight.fix)
        self.particles.multiply(self._pieces.likelihood(squared, 2))

    def settle(self, moment: Moment) -> None:
        """Resample where the effective number asks for it."""
        particles, pieces = self.particles, self._pieces
        chosen = pieces.resampling(particles.weights, self._rng)
        if chosen is not None:
            particles.keep(chosen)
            particles.radii = pieces.radii.select(particles.radii, chosen)

    def moments(self) -> Moments:
        """Weighted mean and covariance; (24a), (24b) for the radii."""
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
        return Moments(mean_m, covariance_m2, noise_m, pose, effective_number(weights))

    def place(self, start: PoseStart, sight: Sight) -> None:
        """Spread the particles about a pose that fixes tell."""
        fix, particles, rng = start.fix, self.particles, self._rng
        count = particles.count
        heading = start.heading_rad + start.heading_std_rad * rng.standard_normal(count)
        forward, left = self._car.antenna_m
        ahead = (1.0 - fix.fraction) * sight.tick.dt_s * sight.speed_mps - forward
        cos, sin = np.cos(heading), np.sin(heading)
        std = math.sqrt(position_variance(fix))
        particles.pose[0] = fix.east_m + std * rng.standard_normal(count) + ahead * cos + left * sin
        particles.pose[1] = fix.north_m + std * rng.standard_normal(count) + ahead * sin - left * cos
        particles.pose[2] = heading
        particles.moved[:] = 0.0
        particles.motion = None
        particles.level()

    def lose(self) -> None:
        """Nothing belongs to the pose but the poses themselves, which are placed anew."""

    def snapshot(self) -> dict[str, Any]:
        """Moments of the radii, and the variances of one tick's radius errors."""
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
        self.particles.radii = radii.take(self.particles.radii, mean, covariance, noise, self._rng)


def saved_noise(saved: Saved) -> FloatArray:
    """(2,) variances of one tick's radius error of a snapshot; ValueError if they are none."""
    noise = numbers(saved, "noise_m2", (2,), 1.0)
    if np.any(noise <= 0.0):
        raise ValueError("the saved noise_m2 is not two positive variances")
    return noise
