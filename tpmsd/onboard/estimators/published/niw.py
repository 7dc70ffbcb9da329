"""Normal-inverse-Wishart statistics, one set per particle: [Lundquist 2013], eqs (18)-(21) and (24), in
their exact forms.

In: realised noise vectors. Out: updated statistics, Student-t samples, posterior moments. Vectorised over
particles.

The model: w | mu, Sigma ~ N(mu, Sigma), mu | Sigma ~ N(mu_hat, gamma Sigma), Sigma ~ iW(nu, Lambda), d =
dim(w). gamma and nu follow the same path in every particle (they count samples, whatever these are), so they
are scalars.

Misprints in the paper, derived again: the predictive (21) is Student-t with nu - d + 1 degrees of freedom,
location mu_hat and *scale matrix* (1 + gamma) / (nu - d + 1) * Lambda; and E[Sigma] = Lambda / (nu - d - 1)
in (24b).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray


@dataclass(slots=True)
class NormalInverseWishart:
    """Statistics of N particles over d dimensions; methods change them in place."""

    gamma: float
    mean: FloatArray
    """(N, d) mu_hat."""
    nu: float
    scale: FloatArray
    """(N, d, d) Lambda."""

    @property
    def dimension(self) -> int:
        """Dimension d of the noise vector."""
        return int(self.mean.shape[1])

    def forget(self, forgetting_factor: float) -> None:
        """Apply the time update, eqs (20a)-(20d).

        nu is floored at d + 2: (20c) alone would let it fall to where the mean of Sigma does not exist;
        Lambda is then scaled by the same ratio as nu so that the mean of Sigma stays what it was.
        """
        self.gamma /= forgetting_factor
        nu = max(forgetting_factor * self.nu, self.dimension + 2.0)
        self.scale *= nu / self.nu
        self.nu = nu

    def learn(self, noise: FloatArray) -> None:
        """Apply the measurement update with one realised noise vector per particle, eqs (19a)-(19d); noise is
        (N, d)."""
        difference = noise - self.mean
        shrink = 1.0 / (1.0 + self.gamma)
        self.gamma *= shrink
        self.mean += self.gamma * difference
        self.nu += 1.0
        self.scale += shrink * difference[:, :, None] * difference[:, None, :]

    def predictive_scale(self) -> FloatArray:
        """Return the (N, d, d) scale matrix of the predictive Student-t, eq. (21) in its exact form."""
        return self.scale * ((1.0 + self.gamma) / (self.nu - self.dimension + 1.0))

    @property
    def predictive_dof(self) -> float:
        """Degrees of freedom of the predictive, also of its marginals."""
        return self.nu - self.dimension + 1.0

    def sample(self, rng: np.random.Generator, leading: int) -> FloatArray:
        """Draw the first `leading` (1 or 2) components from the predictive's marginal; (N, leading).

        A marginal of a multivariate Student-t is Student-t with the same degrees of freedom and the sub-block
        of the scale matrix. The Cholesky factor of a 2 x 2 block is written out: it is the hot spot of the
        filter.
        """
        count = self.mean.shape[0]
        block = self.predictive_scale_block(leading)
        dof = self.predictive_dof
        normal = rng.standard_normal((count, leading))
        normal *= np.sqrt(dof / rng.chisquare(dof, count))[:, None]
        l11 = np.sqrt(block[:, 0, 0])
        out = self.mean[:, :leading].copy()
        out[:, 0] += l11 * normal[:, 0]
        if leading == 2:
            l21 = block[:, 1, 0] / l11
            l22 = np.sqrt(np.maximum(block[:, 1, 1] - l21 * l21, 0.0))
            out[:, 1] += l21 * normal[:, 0] + l22 * normal[:, 1]
        return out

    def log_predictive(self, noise: FloatArray) -> FloatArray:
        """Return the log density (N,) of noise (N, d) under the predictive, eq. (21) in its exact form, up to
        a constant that is the same for all particles.

        The Cholesky factor goes down the few columns, over all particles at once.
        """
        size, dof = self.dimension, self.predictive_dof
        rest = self.predictive_scale()
        off = noise - self.mean
        squared, log = np.zeros(off.shape[0]), np.zeros(off.shape[0])
        for k in range(size):
            pivot = rest[:, k, k]
            white = off[:, k] / np.sqrt(pivot)
            squared += white**2
            log -= 0.5 * np.log(pivot)
            column = rest[:, k + 1 :, k] / np.sqrt(pivot)[:, None]
            off[:, k + 1 :] -= column * white[:, None]
            rest[:, k + 1 :, k + 1 :] -= column[:, :, None] * column[:, None, :]
        return np.asarray(log - 0.5 * (dof + size) * np.log1p(squared / dof))

    def predictive_scale_block(self, leading: int) -> FloatArray:
        """Return the (N, leading, leading) scale matrix of the marginal predictive of the first
        components."""
        factor = (1.0 + self.gamma) / (self.nu - self.dimension + 1.0)
        return self.scale[:, :leading, :leading] * factor

    def noise_covariance(self, weights: FloatArray) -> FloatArray:
        """Return the (d, d) posterior mean of Sigma over all particles, eq. (24b) in its exact form."""
        total = np.einsum("i,ijk->jk", weights, self.scale)
        return np.asarray(total / (self.nu - self.dimension - 1.0))

    def mean_moments(self, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the posterior mean (d,) and covariance (d, d) of mu over all particles: eq. (24a) and its
        spread.

        The covariance is the mixture's: the mean of the particles' own gamma * E[Sigma] plus the spread of
        mu_hat.
        """
        mean = weights @ self.mean
        centred = self.mean - mean
        spread = (centred * weights[:, None]).T @ centred
        return mean, spread + self.gamma * self.noise_covariance(weights)

    def select(self, index: NDArray[np.intp]) -> None:
        """Keep the particles of the given indices (resampling)."""
        self.mean = self.mean[index]
        self.scale = self.scale[index]
