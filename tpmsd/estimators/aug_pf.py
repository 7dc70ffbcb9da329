"""AUG-PF: a bootstrap particle filter over the state augmented with its parameters, paper 000, (25)-(29).

In: `Tick`s. Out: `RadiusEstimate`s. Vectorised over particles, seeded.

State of each particle: east, north, heading, mu_rl, mu_rr, Sigma_rl, Sigma_rr. Per tick that teaches

    mu    += N(0, Q)                                                 (26d)
    Sigma ~ inverse-gamma, mean kept, standard deviation 5 %         (27), (28)

and in every tick the pose moves by w = mu + sqrt(Sigma) N(0, 1), (26a)-(26b).

From E = beta / (alpha - 1) = Sigma and Std = E / sqrt(alpha - 2) = 0.05 E follow alpha = 402 and beta = 401
Sigma. Such steps keep the mean but not the median, which falls by 0.125 % a tick; where the fixes say little
of Sigma it would fall to nothing within the hour, so it is held between a floor and a ceiling.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tpmsd.config.model import FilterConfig, GnssConfig, VehicleConfig
from tpmsd.estimators.gnss_likelihood import PositionLog, student_t_log
from tpmsd.estimators.pose_particles import PoseParticles
from tpmsd.estimators.position_filter import NOISE_FLOOR_M, NOISE_STD_M, PRIOR_RADIUS_STD
from tpmsd.timeline.tick import Tick
from tpmsd.wheels import FloatArray

DRIFT_STD_M = 0.06e-3
"""Square root of Q over a second: random walk of mu, m per sqrt(s)."""
SIGMA_STEP_STD = 0.05
"""Standard deviation of one step of Sigma, relative, eqs (28c), (28d)."""
NOISE_CEILING_M = 0.02
_ALPHA = 2.0 + SIGMA_STEP_STD**-2


def step_sigma(sigma: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draw the next Sigma from (27), of any shape."""
    return (_ALPHA - 1.0) * sigma / rng.standard_gamma(_ALPHA, sigma.shape)


class AugPf(PoseParticles):
    """The estimator; `step` takes one tick and gives one estimate."""

    def __init__(
        self,
        vehicle: VehicleConfig,
        gnss: GnssConfig,
        settings: FilterConfig,
        rng: np.random.Generator,
        front: bool,
        drift_std_m: float = DRIFT_STD_M,
        noise_std_m: float = NOISE_STD_M,
        position_log: PositionLog = student_t_log,
    ) -> None:
        """`front`: whether the bus has the front wheels; `drift_std_m`: random walk of mu over a second;
        `noise_std_m`: square root of the first Sigma."""
        super().__init__(vehicle, gnss, settings, rng, front, position_log)
        self._drift = drift_std_m
        spread = PRIOR_RADIUS_STD * self._nominal[:2, None]
        self._mu = rng.standard_normal((2, self._count)) * spread
        self._sigma = np.full((2, self._count), noise_std_m**2)

    def _advance(self, tick: Tick, rear_rad: FloatArray, teaches: bool) -> tuple[float, float]:
        rng = self._rng
        if teaches:
            self._mu += self._drift * math.sqrt(tick.dt_s) * rng.standard_normal(self._mu.shape)
            self._sigma = np.clip(step_sigma(self._sigma, rng), NOISE_FLOOR_M**2, NOISE_CEILING_M**2)
        noise = rng.standard_normal(self._mu.shape)
        noise *= np.sqrt(self._sigma)
        noise += self._mu
        way, turn = self._roll(rear_rad, noise)
        if not teaches and (curvature := self._steered_curvature(tick)) is not None:
            turn = way * curvature
        return self._go(way, turn)

    def _select(self, index: NDArray[np.intp]) -> None:
        self._mu = self._mu[:, index]
        self._sigma = self._sigma[:, index]

    def _rear_moments(self) -> tuple[FloatArray, FloatArray]:
        mean = self._mu @ self._weights
        away = self._mu - mean[:, None]
        return mean, (away * self._weights) @ away.T

    def _rear_noise(self) -> FloatArray:
        return np.asarray(self._sigma @ self._weights)

    def _take_radii(self, mean_m: FloatArray, covariance_m2: FloatArray, noise_m2: FloatArray) -> None:
        spread = covariance_m2 + np.eye(2) * 1e-10
        self._mu = self._rng.multivariate_normal(mean_m, spread, self._count).T.copy()
        self._sigma = np.repeat(noise_m2[:, None], self._count, axis=1)
