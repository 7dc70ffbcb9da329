"""Extended and unscented Kalman filters of the vehicle state, the latter also in robust form.

In: `StepInputs` and readings (3,), NaN where a sensor is silent. Out: `GaussianState`. The unscented steps
below work on any number of Gaussians at once; the particle filters take their proposals from them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tpmsd.car.vehicle_state import model
from tpmsd.car.vehicle_state.adaptive import RobustSettings
from tpmsd.car.vehicle_state.car import CarDynamics
from tpmsd.car.vehicle_state.linear import advance_jacobian, measurement_jacobian
from tpmsd.car.vehicle_state.model import StepInputs
from tpmsd.car.vehicle_state.unscented import cross, moments, sigma_points, sigma_weights
from tpmsd.foundation.wheels import FloatArray

SIGMA = sigma_weights(3)


@dataclass(frozen=True, slots=True)
class FilterNoise:
    """Standard deviations of process and readings that the filters assume."""

    process: tuple[float, float, float] = (0.30, 0.10, 0.15)
    """Random walk of v, u (m/s) and r (rad/s) per square root of a second: what tyres and sensors' inputs
    leave."""
    readings: tuple[float, float, float] = (0.30, 0.006, 0.15)
    """Lateral acceleration (m/s2), yaw rate (rad/s), speed by the wheels (m/s)."""

    def process_covariance(self, dt_s: float) -> FloatArray:
        """Return the (3, 3) growth of the covariance over a step of `dt_s`."""
        return np.diag(np.square(self.process)) * dt_s

    def measurement_covariance(self) -> FloatArray:
        """Return the (3, 3) covariance of the readings."""
        return np.diag(np.square(self.readings))


@dataclass(frozen=True, slots=True)
class GaussianState:
    """The state (v, u, r) with its covariance."""

    mean: FloatArray
    """(3,)"""
    covariance: FloatArray
    """(3, 3)"""


class StateFilter(Protocol):
    """A filter of the vehicle state."""

    def step(self, inputs: StepInputs, reading: FloatArray) -> GaussianState:
        """Advance by one tick and update with its readings (3,); NaN is left out."""
        ...


class Ekf:
    """The extended Kalman filter, with analytic derivatives."""

    def __init__(self, car: CarDynamics, noise: FilterNoise, start: GaussianState) -> None:
        self._car, self._noise, self._belief = car, noise, start

    def step(self, inputs: StepInputs, reading: FloatArray) -> GaussianState:
        """Advance by one tick and update with its readings (3,); NaN is left out."""
        mean, by_state = advance_jacobian(self._car, self._belief.mean, inputs)
        covariance = by_state @ self._belief.covariance @ by_state.T
        covariance += self._noise.process_covariance(inputs.dt_s)
        seen = np.isfinite(reading)
        if seen.any():
            rows = measurement_jacobian(self._car, mean, inputs)[seen]
            innovation = (reading - model.measurements(self._car, mean, inputs))[seen]
            noise = self._noise.measurement_covariance()[np.ix_(seen, seen)]
            gain = np.linalg.solve(rows @ covariance @ rows.T + noise, rows @ covariance).T
            mean = mean + gain @ innovation
            # Joseph's form: stays positive whatever rounding does.
            rest = np.eye(3) - gain @ rows
            covariance = rest @ covariance @ rest.T + gain @ noise @ gain.T
        self._belief = GaussianState(mean, covariance)
        return self._belief


@dataclass(frozen=True, slots=True)
class Corrected:
    """N Gaussians after their readings."""

    mean: FloatArray
    """(N, 3)"""
    covariance: FloatArray
    """(N, 3, 3)"""
    noise: FloatArray
    """(k, k) covariance of the readings that were there, after their equivalent weights."""
    weights: FloatArray
    """(3,) equivalent weights; 1 without robustness, NaN where there was no reading."""
    factor: float
    """Adaptive factor."""


def predict(
    car: CarDynamics, mean: FloatArray, covariance: FloatArray, inputs: StepInputs, noise: FilterNoise
) -> tuple[FloatArray, FloatArray]:
    """Return means (N, 3) and covariances (N, 3, 3) after the tick, eq. (16)."""
    points = model.advance(car, sigma_points(mean, covariance, SIGMA), inputs)
    ahead, spread, _ = moments(points, SIGMA)
    return ahead, spread + noise.process_covariance(inputs.dt_s)


def correct(
    car: CarDynamics,
    mean: FloatArray,
    covariance: FloatArray,
    inputs: StepInputs,
    reading: FloatArray,
    noise: FilterNoise,
    robust: RobustSettings | None,
) -> Corrected:
    """Return the N Gaussians after a reading (3,), eqs (17), (18), K = P_xz inv(P_zz); `robust`: also
    (19)-(21).

    Whether a reading is an outlier is a matter of the reading: weights and factor are judged once, by all N
    together, and are the same for each.
    """
    seen = np.isfinite(reading)
    weights = np.where(seen, 1.0, np.nan)
    base = noise.measurement_covariance()[np.ix_(seen, seen)]
    if not seen.any():
        return Corrected(mean, covariance, base, weights, 1.0)
    plain = _Update(car, mean, covariance, inputs, reading, seen)
    if robust is None:
        return Corrected(*plain.apply(base), base, weights, 1.0)
    weights[seen] = robust.weights(*plain.joint_innovation(base))
    trusted = base / weights[seen][:, None]  # diagonal
    moved, spread = plain.apply(trusted)
    factor = robust.factor((moved - mean).mean(axis=0), joint_variance(mean, covariance))
    if factor < 1.0:
        again = _Update(car, mean, covariance / factor, inputs, reading, seen)
        moved, spread = again.apply(trusted)
    return Corrected(moved, spread, trusted, weights, factor)


def joint_variance(mean: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the (n,) variances of the equal mixture of N Gaussians, means (N, n)."""
    own = np.diagonal(covariance, axis1=-2, axis2=-1).mean(axis=0)
    return np.asarray(own + mean.var(axis=0))


class _Update:
    """The unscented update of N Gaussians, ready for any noise of the readings."""

    def __init__(
        self,
        car: CarDynamics,
        mean: FloatArray,
        covariance: FloatArray,
        inputs: StepInputs,
        reading: FloatArray,
        seen: FloatArray,
    ) -> None:
        points = sigma_points(mean, covariance, SIGMA)
        expected, self._spread, centred = moments(model.measurements(car, points, inputs)[..., seen], SIGMA)
        self._cross = cross(points - mean[..., None, :], centred, SIGMA)
        self._innovation = reading[seen] - expected
        self._expected = expected
        self._mean, self._covariance = mean, covariance

    def joint_innovation(self, noise: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the (k,) mean innovation of the N Gaussians, and the standard deviation of their mixture."""
        variance = joint_variance(self._expected, self._spread) + np.diag(noise)
        return self._innovation.mean(axis=0), np.sqrt(variance)

    def apply(self, noise: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return means (N, 3) and covariances (N, 3, 3) after the update."""
        total = self._spread + noise
        gain = np.swapaxes(np.linalg.solve(total, np.swapaxes(self._cross, -1, -2)), -1, -2)
        mean = self._mean + np.einsum("...nk,...k->...n", gain, self._innovation)
        covariance = self._covariance - gain @ total @ np.swapaxes(gain, -1, -2)
        return mean, 0.5 * (covariance + np.swapaxes(covariance, -1, -2))


class Ukf:
    """The unscented Kalman filter; with `robust` it is the adaptive robust one with a single Gaussian."""

    def __init__(
        self, car: CarDynamics, noise: FilterNoise, start: GaussianState, robust: RobustSettings | None = None
    ) -> None:
        self._car, self._noise, self._robust = car, noise, robust
        self._belief = start
        self.weights = np.ones(3)
        """(3,) equivalent weights of the last readings."""
        self.factor = 1.0

    def step(self, inputs: StepInputs, reading: FloatArray) -> GaussianState:
        """Advance by one tick and update with its readings (3,); NaN is left out."""
        mean, covariance = self._belief.mean[None], self._belief.covariance[None]
        mean, covariance = predict(self._car, mean, covariance, inputs, self._noise)
        done = correct(self._car, mean, covariance, inputs, reading, self._noise, self._robust)
        self.weights, self.factor = done.weights, done.factor
        self._belief = GaussianState(done.mean[0], done.covariance[0])
        return self._belief
