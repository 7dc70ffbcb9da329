"""Radius models of sampled beliefs: what particles know of the rear radii.

In: drawn radius errors w (2, N), rl before rr. Out: draws, moments, predictives. A model is frozen and holds
parameters alone; its functions take the state of all N particles, may reuse its arrays, and give it back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.published.niw import NormalInverseWishart
from tpmsd.onboard.estimators.settings import SETTINGS


class RadiusModel(Protocol):
    """A model of the radius errors of rl and rr."""

    def remembering(self, forgetting: float) -> RadiusModel:
        """Return the model with this forgetting factor per tick; [filter] window_s sets it."""
        ...

    def begin(self, count: int, nominal_m: FloatArray, rng: np.random.Generator) -> Any:
        """Return the state of N particles before the first tick; nominal_m (2,)."""
        ...

    def forget(self, state: Any, dt_s: float, rng: np.random.Generator) -> Any:
        """Return the state after the time update of an informative tick."""
        ...

    def draw(self, state: Any, rng: np.random.Generator) -> FloatArray:
        """Return the (2, N) radius errors drawn for one tick."""
        ...

    def learn(self, state: Any, noise_m: FloatArray) -> Any:
        """Return the state after the measurement update with the realised errors (2, N)."""
        ...

    def shift(self, state: Any, wheel: NDArray[np.intp], who: NDArray[np.intp], by_m: FloatArray) -> None:
        """Shift the mean of one wheel in each of these particles, in place."""
        ...

    def select(self, state: Any, index: NDArray[np.intp]) -> Any:
        """Return the state of the particles of these indices."""
        ...

    def moments(self, state: Any, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean (2,) and covariance (2, 2) of the mean radius errors."""
        ...

    def noise(self, state: Any, weights: FloatArray) -> FloatArray:
        """Return the (2,) variances of one tick's radius error."""
        ...

    def draw_from_moments(
        self, state: Any, mean_m: FloatArray, covariance_m2: FloatArray, noise_m2: FloatArray,
        rng: np.random.Generator,
    ) -> Any:  # fmt: skip
        """Return a state of radii drawn from saved moments, noise (2,) as saved."""
        ...

    def log_predictive(self, state: Any, noise_m: FloatArray) -> FloatArray:
        """Return the (N,) log density of realised errors (2, N), up to a constant of all particles."""
        ...

    def marginals(self, state: Any) -> tuple[FloatArray, FloatArray, float]:
        """Return location (2, N), squared scale (2, N) and degrees of freedom of each wheel's predictive."""
        ...


@dataclass(frozen=True, slots=True)
class Floors:
    """Least noise that the statistics may learn, m."""

    noise_m: float = SETTINGS.noise_floor_m
    """Noise of each wheel."""
    apart: bool = False
    """Also of left against right, as two wheels at their floor that err apart.

    The floor of the variances alone does not hold it. A receiver's slow errors along the way are learned as
    an error that both wheels share, 10 mm and more, and under it that of the difference falls to 0.2 mm in
    two hours. The headings are then too stiff to follow the receiver's slow errors sideways, and the few
    particles that assume a change of radius, whose paths bend, win by default.
    """


FLOORS = Floors()


@dataclass(frozen=True, slots=True)
class NiwRadii:
    """Normal-inverse-Wishart statistics per particle [Lundquist 2013, eqs 18-21]."""

    forgetting: float = 1.0
    """lambda of (20); 1 keeps everything."""
    floors: Floors | None = FLOORS
    """None: the paper's, without."""
    known: NormalInverseWishart | None = None
    """Statistics before the first tick; None: a wide prior."""

    def remembering(self, forgetting: float) -> NiwRadii:
        """Return the model with this forgetting factor, lambda."""
        return replace(self, forgetting=forgetting)

    def begin(self, count: int, nominal_m: FloatArray, rng: np.random.Generator) -> NormalInverseWishart:
        """Return the prior: the spread of a radius is in the particles' means, not in gamma."""
        if self.known is not None:
            known = self.known
            return NormalInverseWishart(known.gamma, known.mean.copy(), known.nu, known.scale.copy())
        sigma = np.eye(2) * SETTINGS.noise_m**2
        return NormalInverseWishart(
            gamma=SETTINGS.niw_gamma,
            mean=rng.standard_normal((count, 2)) * SETTINGS.radius_prior * nominal_m,
            nu=SETTINGS.niw_nu,
            scale=np.tile(sigma * (SETTINGS.niw_nu - 3.0), (count, 1, 1)),
        )

    def forget(
        self, state: NormalInverseWishart, dt_s: float, rng: np.random.Generator
    ) -> NormalInverseWishart:
        """Apply the time update, eqs (20a)-(20d)."""
        state.forget(self.forgetting)
        return state

    def draw(self, state: NormalInverseWishart, rng: np.random.Generator) -> FloatArray:
        """Return draws (2, N) from the predictive (21)."""
        return state.sample(rng, 2).T

    def learn(self, state: NormalInverseWishart, noise_m: FloatArray) -> NormalInverseWishart:
        """Apply the measurement update, eqs (19a)-(19d), and the floors."""
        state.learn(noise_m.T)
        if self.floors is not None:
            floor = self.floors.noise_m**2 * (state.nu - 3.0)
            for k in range(2):
                np.maximum(state.scale[:, k, k], floor, out=state.scale[:, k, k])
            if self.floors.apart:
                floor_difference_variance(state, floor)
        return state

    def shift(
        self, state: NormalInverseWishart, wheel: NDArray[np.intp], who: NDArray[np.intp], by_m: FloatArray
    ) -> None:
        """Shift mu_hat of one wheel in each of these particles."""
        state.mean[who, wheel] += by_m

    def select(self, state: NormalInverseWishart, index: NDArray[np.intp]) -> NormalInverseWishart:
        """Keep the particles of these indices."""
        state.select(index)
        return state

    def moments(self, state: NormalInverseWishart, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean (2,) and covariance (2, 2) of mu: eq. (24a) and its spread."""
        return state.mean_moments(weights)

    def noise(self, state: NormalInverseWishart, weights: FloatArray) -> FloatArray:
        """Return the diagonal (2,) of (24b)."""
        return np.diag(state.noise_covariance(weights))

    def draw_from_moments(
        self,
        state: NormalInverseWishart,
        mean_m: FloatArray,
        covariance_m2: FloatArray,
        noise_m2: FloatArray,
        rng: np.random.Generator,
    ) -> NormalInverseWishart:
        """Return a state whose mu_hat is drawn from saved moments; gamma and nu are those of a filter that
        begins."""
        count = state.mean.shape[0]
        mean = rng.multivariate_normal(mean_m, covariance_m2 + np.eye(2) * 1e-10, count)
        scale = np.tile(np.diag(noise_m2) * (state.nu - 3.0), (count, 1, 1))
        return NormalInverseWishart(state.gamma, mean, state.nu, scale)

    def log_predictive(self, state: NormalInverseWishart, noise_m: FloatArray) -> FloatArray:
        """Return the (N,) log density by eq. (21) in its exact form."""
        return state.log_predictive(noise_m.T)

    def marginals(self, state: NormalInverseWishart) -> tuple[FloatArray, FloatArray, float]:
        """Return location, squared scale and degrees of freedom of the predictive of each wheel (21)."""
        scale = np.diagonal(state.predictive_scale(), axis1=1, axis2=2)
        return state.mean.T, scale.T, state.predictive_dof


NIW = NiwRadii()


def floor_difference_variance(state: NormalInverseWishart, floor: float) -> None:
    """Hold var(left - right) = S11 + S22 - 2 S12 above 2 floor, in place.

    The off-diagonals only ever come nearer to 0, so the matrix stays positive.
    """
    most = (state.scale[:, 0, 0] + state.scale[:, 1, 1]) / 2 - floor
    shared = np.minimum(state.scale[:, 0, 1], most)
    state.scale[:, 0, 1] = state.scale[:, 1, 0] = shared


@dataclass(slots=True)
class WalkingRadiiState:
    """Mean and variance (m, m2) of both rear radii in each of N particles of `WalkingRadii`."""

    mu: FloatArray
    """(2, N) m."""
    sigma: FloatArray
    """(2, N) m2."""


_ALPHA = 2.0 + SETTINGS.sigma_step**-2
"""E = beta / (alpha - 1) = Sigma and Std = E / sqrt(alpha - 2) = 0.05 E: alpha = 402, beta = 401 Sigma."""


def step_sigma(sigma: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draw the next Sigma from (27), of any shape: mean kept, standard deviation 5 %.

    Such steps keep the mean but not the median, which falls by 0.125 % a tick; where fixes say little of
    Sigma it would fall to nothing within the hour, so `WalkingRadii` holds it between a floor and a ceiling.
    """
    return (_ALPHA - 1.0) * sigma / rng.standard_gamma(_ALPHA, sigma.shape)


@dataclass(frozen=True, slots=True)
class WalkingRadii:
    """mu and Sigma are states of the particles [Lundquist 2013, eqs 26-28]: mu walks at random, Sigma by
    inverse-gamma steps."""

    drift_std_m: float = SETTINGS.walk_particles_m
    """Random walk of mu over a second."""
    noise_std_m: float = SETTINGS.noise_m
    """Square root of the first Sigma."""

    def remembering(self, forgetting: float) -> WalkingRadii:
        """Return this model: these radii forget by their random walk."""
        return self

    def begin(self, count: int, nominal_m: FloatArray, rng: np.random.Generator) -> WalkingRadiiState:
        """Return the state with mu spread by the prior."""
        mu = rng.standard_normal((2, count)) * (SETTINGS.radius_prior * nominal_m[:, None])
        return WalkingRadiiState(mu, np.full((2, count), self.noise_std_m**2))

    def forget(self, state: WalkingRadiiState, dt_s: float, rng: np.random.Generator) -> WalkingRadiiState:
        """Return mu and Sigma after a step of their random walk, eqs (26d) and (27)."""
        state.mu += self.drift_std_m * math.sqrt(dt_s) * rng.standard_normal(state.mu.shape)
        least, most = SETTINGS.noise_floor_m**2, SETTINGS.noise_ceiling_m**2
        state.sigma = np.clip(step_sigma(state.sigma, rng), least, most)
        return state

    def draw(self, state: WalkingRadiiState, rng: np.random.Generator) -> FloatArray:
        """Return draws (2, N) of mu + sqrt(Sigma) N(0, 1), (26a), (26b)."""
        noise = rng.standard_normal(state.mu.shape)
        noise *= np.sqrt(state.sigma)
        noise += state.mu
        return noise

    def learn(self, state: WalkingRadiiState, noise_m: FloatArray) -> WalkingRadiiState:
        """Do nothing: the weights alone change."""
        return state

    def shift(
        self, state: WalkingRadiiState, wheel: NDArray[np.intp], who: NDArray[np.intp], by_m: FloatArray
    ) -> None:
        """Add the change to mu."""
        state.mu[wheel, who] += by_m

    def select(self, state: WalkingRadiiState, index: NDArray[np.intp]) -> WalkingRadiiState:
        """Keep the particles of these indices."""
        return WalkingRadiiState(state.mu[:, index], state.sigma[:, index])

    def moments(self, state: WalkingRadiiState, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean (2,) and covariance (2, 2) of mu."""
        mean = state.mu @ weights
        away = state.mu - mean[:, None]
        return mean, (away * weights) @ away.T

    def noise(self, state: WalkingRadiiState, weights: FloatArray) -> FloatArray:
        """Return the mean (2,) of Sigma."""
        return np.asarray(state.sigma @ weights)

    def draw_from_moments(
        self,
        state: WalkingRadiiState,
        mean_m: FloatArray,
        covariance_m2: FloatArray,
        noise_m2: FloatArray,
        rng: np.random.Generator,
    ) -> WalkingRadiiState:
        """Return a state with mu drawn from the saved moments."""
        count = state.mu.shape[1]
        mu = rng.multivariate_normal(mean_m, covariance_m2 + np.eye(2) * 1e-10, count).T.copy()
        return WalkingRadiiState(mu, np.repeat(noise_m2[:, None], count, axis=1))

    def log_predictive(self, state: WalkingRadiiState, noise_m: FloatArray) -> FloatArray:
        """Return the (N,) log density, up to a constant, of each particle's radius error under N(mu,
        sigma)."""
        squared = (noise_m - state.mu) ** 2 / state.sigma
        return np.asarray(-0.5 * (squared + np.log(state.sigma)).sum(axis=0))

    def marginals(self, state: WalkingRadiiState) -> tuple[FloatArray, FloatArray, float]:
        """Return mean, variance and degrees of freedom of the radii: for a Gaussian, practically infinite."""
        return state.mu, state.sigma, 1e9
