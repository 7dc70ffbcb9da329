"""The unscented particle filter (UPF) and its adaptive robust form (ARUPF) of Liu et al. (2022).

In: `StepInputs` and readings (3,). Out: `GaussianState`. Every particle carries a Gaussian of its own; an
unscented Kalman step moves it and takes the readings, the particle's new place is drawn from the result, and
its weight is likelihood times transition density over that proposal (eq. 21). Systematic resampling at every
step.

With `RobustSettings` the readings' variances are divided by their equivalent weights and the prediction's
covariance by the adaptive factor, in the proposal, in the transition density and in the likelihood alike.
Particles and sigma points are axes of the same arrays; there is no loop over either.

As published a particle keeps its Gaussian's covariance after it was drawn from it. So the next proposal is as
wide as the whole uncertainty, the transition density as narrow as one step's noise, few particles keep any
weight, and the cloud shrinks by chance alone where no reading holds it apart. With `carry` off a drawn
particle is a point again, and the unscented step starts from the process noise alone: the near-optimal
proposal of Doucet, Godsill and Andrieu 2000 (Statistics and Computing 10), with weights that hardly vary.
"""

from __future__ import annotations

import numpy as np

from tpmsd.car.vehicle_state import model
from tpmsd.car.vehicle_state.adaptive import RobustSettings
from tpmsd.car.vehicle_state.car import CarDynamics
from tpmsd.car.vehicle_state.kalman import SIGMA, FilterNoise, GaussianState, correct
from tpmsd.car.vehicle_state.model import StepInputs
from tpmsd.car.vehicle_state.unscented import moments, sigma_points
from tpmsd.foundation.wheels import FloatArray

DEFAULT_PARTICLES = 100


class UnscentedParticleFilter:
    """UPF; with `robust`, ARUPF."""

    def __init__(
        self,
        car: CarDynamics,
        noise: FilterNoise,
        start: GaussianState,
        rng: np.random.Generator,
        robust: RobustSettings | None = None,
        particles: int = DEFAULT_PARTICLES,
        carry: bool = True,
    ) -> None:
        """`carry`: whether particles keep a covariance from step to step, as published."""
        if particles < 1:
            raise ValueError(f"{particles} particles are too few")
        self._car, self._noise, self._robust, self._rng = car, noise, robust, rng
        self._states = _draw(rng, np.tile(start.mean, (particles, 1)), start.covariance[None])
        self._covariance = np.tile(start.covariance, (particles, 1, 1)) if carry else None
        self.weights = np.ones(3)
        """(3,) equivalent weights of the last readings."""
        self.factor = 1.0
        self.effective = float(particles)
        """Effective number of particles before the last resampling."""

    def step(self, inputs: StepInputs, reading: FloatArray) -> GaussianState:
        """Advance by one tick and update with its readings (3,); NaN is left out."""
        car, process = self._car, self._noise.process_covariance(inputs.dt_s)
        if self._covariance is None:
            own = ahead = model.advance(car, self._states, inputs)
            spread = np.zeros((len(own), 3, 3))
        else:
            points = model.advance(car, sigma_points(self._states, self._covariance, SIGMA), inputs)
            own = points[:, 0]  # where the particle itself goes
            ahead, spread, _ = moments(points, SIGMA)
        done = correct(car, ahead, spread + process, inputs, reading, self._noise, self._robust)
        self.weights, self.factor = done.weights, done.factor
        states = _draw(self._rng, done.mean, done.covariance)
        log = _log_density(states - own, process / done.factor)
        log -= _log_density(states - done.mean, done.covariance)
        seen = np.isfinite(reading)
        if seen.any():
            off = reading[seen] - model.measurements(car, states, inputs)[:, seen]
            log += _log_density(off, done.noise)
        weights = np.exp(log - log.max())
        weights /= weights.sum()
        self.effective = float(1.0 / np.sum(weights**2))
        mean = weights @ states
        centred = states - mean
        belief = GaussianState(mean, (centred * weights[:, None]).T @ centred)
        chosen = _systematic_resampling(self._rng, weights)
        self._states = states[chosen]
        if self._covariance is not None:
            self._covariance = done.covariance[chosen]
        return belief


def _draw(rng: np.random.Generator, mean: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return one draw from each of N Gaussians, (N, n)."""
    root = np.linalg.cholesky(covariance)
    return np.asarray(mean + np.einsum("...ij,...j->...i", root, rng.standard_normal(mean.shape)))


def _log_density(off: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the (N,) log normal density at deviations `off` (N, n), less a constant; covariance (n, n) or
    (N, n, n)."""
    root = np.linalg.cholesky(covariance)
    white = np.linalg.solve(root, off[..., None])[..., 0]
    volume = np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1)
    return np.asarray(-0.5 * np.square(white).sum(axis=-1) - volume)


def _systematic_resampling(rng: np.random.Generator, weights: FloatArray) -> FloatArray:
    """Return (N,) indices, each as often as its weight times N, rounded up or down."""
    count = weights.size
    rungs = (np.arange(count) + rng.random()) / count
    return np.minimum(np.searchsorted(np.cumsum(weights), rungs), count - 1)
