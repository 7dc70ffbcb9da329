"""The particles of MPF-PN, the program's: how their noise parameters move, when radii change, resampling.

In: a bank of Kalman filters with weights. Out: the bank, changed in place. Given the covariance of the noise
and the instants at which a radius changed, pose, radii and nuisances are so nearly linear and Gaussian that
each particle carries them as one Kalman filter (Rao-Blackwellised: Schoen, Gustafsson and Nordlund 2005, IEEE
Trans. Signal Processing 53(7), 2279-2289). What remains is drawn, per particle:

    theta    log of the covariance of the noise: of way and heading, and of the radii's drift, its common
             part and one contrast per wheel
    changes  instant and wheel of sudden changes; how much has changed is left to the Kalman filter

theta walks about its prior (Ornstein-Uhlenbeck), so its diversity never ends. Copies that resampling makes
are moved apart by the kernel of Liu and West (2001, in Doucet, de Freitas and Gordon, Sequential Monte Carlo
Methods in Practice, 197-223), which shrinks towards the mean by as much as it adds: mean and covariance of
theta stay. Changes are proposed in many particles, which share the prior probability of one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.bank.error_state import MU, PSI, initial_state
from tpmsd.onboard.estimators.bank.jump_hypotheses import UNUSED, Bank
from tpmsd.onboard.estimators.resampling import Lineage, systematic
from tpmsd.onboard.estimators.settings import SETTINGS


@dataclass(slots=True)
class ParticleBank(Bank):
    """A bank whose hypotheses were drawn; N particles."""

    theta: FloatArray = field(default_factory=lambda: np.zeros((1, 1)))
    """(2 + d, N) log of the noise of way and heading relative to the usual variance; log level of the drift
    of all radii, and of each against it."""

    def keep(self, index: NDArray[np.intp], free: int) -> None:
        """Keep the particles of these indices with equal weights, in place; the last `free` without any."""
        self.state[:] = self.state[:, index]
        self.spread[:] = self.spread[:, :, index]
        self.theta[:] = self.theta[:, index]
        self.since_s[:] = self.since_s[index]
        self.log_weights[:] = 0.0
        self.log_weights[self.log_weights.size - free :] = UNUSED

    def copy_parents(self, indices: NDArray[np.intp], parents: NDArray[np.intp]) -> None:
        """Overwrite these particles by copies of their parents, except the weights, which the caller sets."""
        self.state[:, indices] = self.state[:, parents]
        self.spread[:, :, indices] = self.spread[:, :, parents]
        self.theta[:, indices] = self.theta[:, parents]
        self.level[indices] = self.level[parents]
        self.since_s[indices] = self.since_s[parents]
        self.noise_factor[indices] = self.noise_factor[parents]

    def set_levels(self) -> None:
        """Set the noise of distance and heading and the radius drift to the values of theta."""
        self.noise_factor[:] = np.exp(self.theta[0])
        self.level[:] = np.exp(self.theta[1] + self.theta[2:]).T


@dataclass(frozen=True, slots=True)
class SampledHypotheses:
    """The proposals of the particles; parameters alone."""

    noise_std: float = SETTINGS.noise_log_std
    level_mean: float = SETTINGS.level_log_mean
    level_std: float = SETTINGS.level_log_std
    contrast_std: float = SETTINGS.level_contrast_std
    tau_s: float = SETTINGS.level_tau_s
    rate_per_s: float = SETTINGS.jump_rate_per_s
    proposed_share: float = SETTINGS.proposed_share
    reserved_share: float = SETTINGS.reserved_share
    std: float = SETTINGS.jump_std
    heading_std_rad: float = SETTINGS.jump_heading_rad
    kernel: float = SETTINGS.shrinkage_kernel
    below: float = SETTINGS.resample_below

    def begin(self, count: int, nominal_m: FloatArray, rng: np.random.Generator) -> ParticleBank:
        """Return particles drawn from the prior."""
        mean, covariance = initial_state(count, nominal_m)
        level, kind = np.ones((count, nominal_m.size)), np.zeros(count, dtype=np.intp)
        theta = self._prior_mean(nominal_m.size) + self._prior_std(nominal_m.size) * rng.standard_normal(
            (2 + nominal_m.size, count)
        )
        bank = ParticleBank(mean, covariance, np.zeros(count), level, kind, theta)
        bank.set_levels()
        bank.log_weights[count - round(self.reserved_share * count) :] = UNUSED
        return bank

    def _prior_mean(self, wheels: int) -> FloatArray:
        """Return the prior mean of theta (2 + d, 1)."""
        return np.array([0.0, self.level_mean] + [0.0] * wheels)[:, None]

    def _prior_std(self, wheels: int) -> FloatArray:
        """Return the prior standard deviation of theta (2 + d, 1)."""
        return np.array([self.noise_std, self.level_std] + [self.contrast_std] * wheels)[:, None]

    def walk(self, bank: ParticleBank, duration_s: float, rng: np.random.Generator) -> None:
        """Move theta by a random step that leaves its prior unchanged."""
        wheels, keep = bank.level.shape[1], math.exp(-duration_s / self.tau_s)
        mean, std = self._prior_mean(wheels), self._prior_std(wheels)
        kick = rng.standard_normal(bank.theta.shape)
        bank.theta[:] = mean + keep * (bank.theta - mean) + math.sqrt(1.0 - keep * keep) * std * kick
        bank.set_levels()

    def propose(
        self,
        bank: ParticleBank,
        lineage: Lineage,
        duration_s: float,
        nominal_m: FloatArray,
        rng: np.random.Generator,
    ) -> None:
        """Propose a change of each wheel in an equal number of copies of particles, which take free places.

        Parents are drawn by their weights, systematically, so that whatever hypothesis leads has children
        within the second. The copies of one wheel share the prior probability of its change within
        `duration_s`, and take the places of the least probable particles: of those that a resampling leaves
        free, and of children that came to nothing.
        """
        count, wheels = bank.log_weights.size, nominal_m.size
        each = max(round(self.proposed_share * duration_s * count / wheels), 1)
        indices = bank.ascending()[: min(each * wheels, count // 2)]
        best = float(bank.log_weights.max())
        relative = np.exp(bank.log_weights - best)
        total = float(relative.sum())
        parents = systematic(relative / total, rng, indices.size)
        bank.copy_parents(indices, parents)
        lineage.copy(indices, parents)
        probability = self.rate_per_s * duration_s / each
        bank.log_weights[indices] = best + math.log(total) + math.log(probability)
        self._widen_radius(bank, indices, np.arange(indices.size) % wheels, nominal_m)

    def assume_changes(
        self, bank: ParticleBank, who: NDArray[np.intp], nominal_m: FloatArray, rng: np.random.Generator
    ) -> None:
        """Let each of these particles assume that a wheel, drawn for each, has changed; weights stay."""
        self._widen_radius(bank, who, rng.integers(nominal_m.size, size=who.size), nominal_m)

    def _widen_radius(
        self, bank: ParticleBank, who: NDArray[np.intp], wheel: NDArray[np.intp], nominal_m: FloatArray
    ) -> None:
        """Widen one wheel's radius in each of these particles by the size of a change, and the heading by the
        error that the change has caused before it was assumed."""
        bank.spread[MU + wheel, MU + wheel, who] += np.square(self.std * nominal_m[wheel])
        bank.spread[PSI, PSI, who] += self.heading_std_rad**2
        bank.since_s[who] = 0.0

    def resample(
        self, bank: ParticleBank, lineage: Lineage, effective: float, rng: np.random.Generator
    ) -> bool:
        """Resample if the effective number is too small; return whether it did. A share of the places is left
        free for changes to be proposed.

        Systematically, in the order of the rear pair's difference: with neighbours alike, the error of the
        drawn mixture is smaller (Kitagawa 1996, J. Comput. Graph. Statist. 5(1), 1-25).
        """
        if not effective <= self.below * bank.log_weights.size:  # true for NaN
            return False
        weights = bank.weights()
        order = np.argsort(bank.state[MU] - bank.state[MU + 1], kind="stable")
        free = round(self.reserved_share * weights.size)
        chosen = order[systematic(weights[order], rng, weights.size - free)]
        chosen = np.concatenate([chosen, chosen[:free]])
        mean, root = mean_and_root(bank.theta, weights)
        bank.keep(chosen, free)
        lineage.keep(chosen)
        bank.theta[:] = shrink_and_jitter(bank.theta, mean, root, self.kernel, rng)
        bank.set_levels()
        return True


def mean_and_root(theta: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the weighted mean (p,) of theta (p, N) and a root (p, p) of its covariance."""
    mean = theta @ weights
    away = theta - mean[:, None]
    values, vectors = np.linalg.eigh((away * weights) @ away.T)
    return mean, vectors * np.sqrt(np.maximum(values, 0.0))


def shrink_and_jitter(
    theta: FloatArray, mean: FloatArray, root: FloatArray, kernel: float, rng: np.random.Generator
) -> FloatArray:
    """Return theta (p, N) moved by the kernel of Liu and West (2001): a theta + (1 - a) mean + h root N(0, 1)
    with a^2 + h^2 = 1, which keeps mean and covariance root root'."""
    keep = math.sqrt(1.0 - kernel * kernel)
    moved = keep * theta + (1.0 - keep) * mean[:, None]
    return np.asarray(moved + kernel * (root @ rng.standard_normal(theta.shape)))
