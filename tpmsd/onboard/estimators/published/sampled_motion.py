"""Motion models of sampled beliefs, and their particles.

In: the rotation of the rear wheels. Out: way and turn of each particle, and where the wheels are measurements
their log-likelihood. With a_i the angle wheel i has turned [Lundquist 2013, eq. 37, so T omega] and w the
radius errors of a particle:

    way     = (a_rl (r_rl + w_rl) + a_rr (r_rr + w_rr)) / 2          (6a)
    turn    = (a_rr (r_rr + w_rr) - a_rl (r_rl + w_rl)) / track      (6b)
    east   += way cos(heading), north likewise                       (7)
    heading += turn                                                  (7)

`move_poses` takes the heading at mid-step, heading + turn/2, or as printed, at the tick's start.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.belief import FilterCar, RolledTick
from tpmsd.onboard.estimators.published.position_noise import PositionStatistics
from tpmsd.onboard.estimators.published.radius_models import RadiusModel
from tpmsd.onboard.estimators.settings import SETTINGS


@dataclass(slots=True)
class Particles:
    """All that changes in a sampled belief; N particles."""

    pose: FloatArray
    """(3, N) east, north, heading."""
    moved: FloatArray
    """(3, N) how the last tick changed the pose."""
    log_weights: FloatArray
    """(N,)"""
    weights: FloatArray
    """(N,) normalised."""
    radii: Any
    """State of the radius model."""
    motion: FloatArray | None = None
    """(2, N) yaw rate and speed, where they are states that go on from the tick before."""
    position_noise: PositionStatistics | None = None
    """Belief about the variances of positions, where these are unknown and a fix has been taken."""

    @classmethod
    def uniform(cls, count: int, radii: Any) -> Particles:
        """Return particles at the origin with the same weight."""
        weights = np.full(count, 1.0 / count)
        return cls(np.zeros((3, count)), np.zeros((3, count)), np.zeros(count), weights, radii)

    @property
    def count(self) -> int:
        """Number N of particles."""
        return self.log_weights.size

    def multiply(self, log_likelihood: FloatArray) -> None:
        """Multiply the weights by the likelihoods of a measurement (22) and normalise them."""
        self.log_weights += log_likelihood
        self.log_weights -= self.log_weights.max()
        weights = np.exp(self.log_weights)
        self.weights = weights / weights.sum()

    def reset_weights(self) -> None:
        """Set the weights of all particles to 1 / N."""
        self.log_weights[:] = 0.0
        self.weights = np.full(self.count, 1.0 / self.count)

    def keep(self, index: NDArray[np.intp]) -> None:
        """Keep the particles of these indices, with equal weights; the radii are their model's to select."""
        self.pose, self.moved = self.pose[:, index], self.moved[:, index]
        if self.motion is not None:
            self.motion = self.motion[:, index]
        if self.position_noise is not None:
            self.position_noise = self.position_noise.select(index)
        self.reset_weights()


MID_STEP = 0.5
"""Share of a tick's turn after which the heading is taken: exact to second order in the turn."""


def move_poses(
    particles: Particles, travel: FloatArray, turn: FloatArray, heading_after: float = MID_STEP
) -> tuple[float, float]:
    """Move the poses by distance and turn (N,) of each (7), with the heading after this share of the turn;
    return mean distance (m) and turn (rad)."""
    middle = turn * heading_after
    middle += particles.pose[2]
    particles.moved[0] = travel * np.cos(middle)
    particles.moved[1] = travel * np.sin(middle)
    particles.moved[2] = turn
    particles.pose += particles.moved
    return float(travel.mean()), float(turn.mean())


class SampledMotion(Protocol):
    """A motion model; frozen, its parameters alone."""

    def advance(
        self,
        particles: Particles,
        radii: RadiusModel,
        rolling: RolledTick,
        car: FilterCar,
        rng: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray, FloatArray | None]:
        """Return distance and turn (N,) of a tick, radii learned if it is informative, and the log-likelihood
        (N,) of the wheels where they are measurements, else None."""
        ...


@dataclass(frozen=True, slots=True)
class WheelsIn:
    """The wheels are inputs: a draw of the radius errors makes distance and turn (6a), (6b)."""

    def advance(
        self,
        particles: Particles,
        radii: RadiusModel,
        rolling: RolledTick,
        car: FilterCar,
        rng: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray, FloatArray | None]:
        """Draw radius errors and return the motion by them: Table I, lines 10, 11 and 13."""
        noise = radii.draw(particles.radii, rng)
        left = rolling.angle_rad[0] * (car.nominal_m[0] + noise[0])
        right = rolling.angle_rad[1] * (car.nominal_m[1] + noise[1])
        travel, turn = (left + right) * 0.5, (right - left) * (1.0 / car.geometry.track_rear_m)
        if rolling.gated.informative:
            particles.radii = radii.learn(particles.radii, noise)
        if rolling.curvature is not None:
            turn = travel * rolling.curvature
        return travel, turn, None


WHEELS_IN = WheelsIn()


@dataclass(frozen=True, slots=True)
class WheelsMeasured:
    """Yaw rate and speed walk at random (31); the wheels' virtual ones are measurements of them, off by
    D delta (32).

    D is square and regular while the wheels turn, so its pseudo-inverse (35) is its inverse, and the realised
    errors are delta_i = path_i / a_i - r_i with path = T (v -+ yaw_rate track / 2). The weights take the
    predictive of delta (34), the statistics delta itself (19). Order and signs are those of (32a) and (6).

    Realised errors are of no use where the wheels barely turn: in ticks that are not informative the paths
    are weighed instead, with a counter's quantum as their least error.
    """

    yaw_accel_std_radps2: float = SETTINGS.walk_yaw_radps2
    accel_std_mps2: float = SETTINGS.walk_speed_mps2

    def advance(
        self,
        particles: Particles,
        radii: RadiusModel,
        rolling: RolledTick,
        car: FilterCar,
        rng: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray, FloatArray | None]:
        """Move yaw rate and speed by a random walk, and return their motion with the log-likelihood (N,) of
        the wheels."""
        dt, track = rolling.gated.tick.dt_s, car.geometry.track_rear_m
        kick = rng.standard_normal((2, particles.count))
        if particles.motion is not None:
            walk = np.array([[self.yaw_accel_std_radps2], [self.accel_std_mps2]])
            particles.motion += kick * (walk * dt)
        else:
            rolled, turned = rolling.distance_m, rolling.heading_change_rad
            spread = np.array(SETTINGS.start_motion)[:, None]
            particles.motion = np.array([[turned / dt], [rolled / dt]]) + kick * spread
        yaw_rate, speed = particles.motion
        travel, turn = speed * dt, yaw_rate * dt
        paths = np.stack([travel - turn * (track / 2), travel + turn * (track / 2)])
        rear = rolling.angle_rad[:2, None]
        if rolling.gated.informative and float(rear.min()) > 0.0:
            realised = paths / rear - car.nominal_m[:2, None]
            log = radii.log_predictive(particles.radii, realised)
            particles.radii = radii.learn(particles.radii, realised)
            return travel, turn, log
        log = self._path_log_likelihood(particles, radii, paths, rear, car)
        if rolling.curvature is not None:
            turn = travel * rolling.curvature
            particles.motion[0] = turn / dt
        return travel, turn, log

    def _path_log_likelihood(
        self, particles: Particles, radii: RadiusModel, paths: FloatArray, rear: FloatArray, car: FilterCar
    ) -> FloatArray:
        """Return the log-likelihood (N,) of the wheels' paths (2, N) in a tick that is not informative."""
        mean, scale, dof = radii.marginals(particles.radii)
        off = paths - rear * (car.nominal_m[:2, None] + mean)
        squared = (off**2 / (scale * rear**2 + SETTINGS.path_quantum_m**2)).sum(axis=0)
        return np.asarray(-0.5 * (dof + 2.0) * np.log1p(squared / dof))
