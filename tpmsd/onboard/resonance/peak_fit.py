"""Frequency of the resonance in a spectrum: its likelihood over the frequency.

In: an averaged spectrum. Out: a `Peak`: log likelihood on a fixed grid, mean, standard deviation, or none
found.

The density is taken as a resonance of the rim's speed over a floor, a part that falls with frequency (the
road) and one that rises (rounding of angles, uneven teeth),

    S(f) = a * (2 z f0 f)^2 / ((f0^2 - f^2)^2 + (2 z f0 f)^2) + b + c * (f_low / f)^2 + d * (f / f_high)^2

and the spectrum as K averages of exponentially distributed ordinates (Whittle): log L = -w sum(log S + P /
S), with w = K / 2, because half-overlapped segments say everything twice. For every f0 and damping z the
amplitudes a, b, c, d >= 0 maximise L (multiplicative updates for the Itakura-Saito divergence: Fevotte and
Idier, Neural Computation 23 (2011) 2421); the likelihood is kept over both. Real spectra have more bumps
than the model, which makes a likelihood too sure: it is raised to the power of one over the misfit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.resonance.spectrum import HIGH_HZ, LOW_HZ, OVERLAP_VARIANCE, Spectrum, bins_hz
from tpmsd.onboard.resonance.torsion import MAX_RESONANCE_HZ, MIN_RESONANCE_HZ

LOG_STEP = 0.005
"""Step of the grid in ln f."""
LOG_GRID = np.arange(math.log(MIN_RESONANCE_HZ), math.log(MAX_RESONANCE_HZ), LOG_STEP)
FREQUENCY_HZ = np.exp(LOG_GRID)
DAMPING = np.array([0.06, 0.10, 0.16, 0.25, 0.38])
UPDATES, NULL_UPDATES = 30, 300
RESONANCE_SHARE = 0.2
FOUND_LOG = 15.0
"""Log-likelihood gain by a resonance that is required to find one."""
MIN_HIGHEST_HZ = 30.0
"""Sampling so slow that only lower resonances would be seen is too slow: few tyres have them there."""
MAX_REL_STD = 0.06
"""A baseline that is known no better than this tells no soft tyre from a sound one."""
EDGE = 0.985
BINS_ABOVE = 3
"""Bins above a resonance that are needed to see its far side."""


@dataclass(frozen=True, slots=True)
class Peak:
    """Likelihoods of a torsional resonance in one spectrum, by frequency (Hz) and damping."""

    log_likelihood: FloatArray
    """(len(FREQUENCY_HZ), len(DAMPING)) log likelihood against that of a spectrum without resonance."""
    averages: float
    """Segments behind it."""

    @property
    def gain(self) -> float:
        """Largest log-likelihood gain (nats) of a resonance over a spectrum without one."""
        return float(self.log_likelihood.max())

    @property
    def found(self) -> bool:
        """True if the gain by a resonance exceeds `FOUND_LOG`."""
        return self.gain > FOUND_LOG

    def faded_log_likelihood(self, averages: float) -> FloatArray:
        """Return the (frequencies, dampings) log-likelihood scaled down to fewer averages; never up."""
        return self.log_likelihood * min(averages / self.averages, 1.0)

    def is_usable(self, highest_hz: float) -> bool:
        """Return whether a resonance was found, inside the detectable range, with a small standard deviation.

        `highest_hz`: see `PeakFit.max_frequency_hz`. A peak at either end may be the flank of something
        beyond it.
        """
        mean, std = self.moments()
        inside = mean - 2.0 * std > MIN_RESONANCE_HZ / EDGE and mean + 2.0 * std < EDGE * highest_hz
        return self.found and std < MAX_REL_STD * mean and inside

    def moments(self) -> tuple[float, float]:
        """Return the mean and standard deviation of the frequency, Hz, over the grid."""
        weight = np.exp(self.log_likelihood - self.log_likelihood.max()).sum(axis=1)
        weight /= weight.sum()
        mean = float(weight @ FREQUENCY_HZ)
        # The grid itself is not finer than this.
        fine = (LOG_STEP * mean) ** 2 / 12.0
        return mean, math.sqrt(float(weight @ (FREQUENCY_HZ - mean) ** 2) + fine)


class PeakFit:
    """Fits spectra of one sampling rate."""

    def __init__(self, rate_hz: float) -> None:
        frequency = bins_hz(rate_hz)
        self._reach = _detectable_count(frequency)
        f0 = FREQUENCY_HZ[: self._reach, None, None]
        damped = 2.0 * DAMPING[None, :, None] * f0 * frequency
        resonance = damped**2 / ((f0 * f0 - frequency**2) ** 2 + damped**2)
        self._resonances = resonance.reshape(-1, frequency.size)
        """(models, bins)"""
        slope, rise = (LOW_HZ / np.maximum(frequency, 1.0)) ** 2, (frequency / HIGH_HZ) ** 2
        self._background = np.stack([np.ones_like(frequency), slope, rise])
        """(3, bins): floor, road and rounding, the same in all models."""

    @staticmethod
    def max_frequency_hz(rate_hz: float) -> float:
        """Return the frequency up to which a resonance can be detected, Hz; 0 where sampling is too slow for
        any."""
        reach = _detectable_count(bins_hz(rate_hz))
        return float(FREQUENCY_HZ[reach - 1]) if reach else 0.0

    def fit(self, spectrum: Spectrum) -> Peak:
        """Return the log-likelihood of a resonance in a spectrum by frequency and damping."""
        density = spectrum.mean()
        weight = 0.5 * spectrum.averages
        level, background = float(density.mean()), self._background
        uniform = np.full(len(background), level / len(background))
        none, none_amplitude = _fit_background(background, density, uniform)
        # From there on a resonance has to take its share.
        own = np.full(len(self._resonances), RESONANCE_SHARE * level)
        others = np.tile((1.0 - RESONANCE_SHARE) * none_amplitude, (len(own), 1))
        logs, fits = _fit_resonances(self._resonances, background, density, own, others)
        best = fits[int(np.argmax(logs))]
        misfit = 2.0 * weight * float(np.mean((density / best - 1.0) ** 2)) / OVERLAP_VARIANCE
        weight /= max(misfit, 1.0)
        # Beyond reach a resonance looks like none.
        log_likelihood = np.zeros((LOG_GRID.size, DAMPING.size))
        log_likelihood[: self._reach] = (weight * (logs - none)).reshape(self._reach, DAMPING.size)
        return Peak(log_likelihood, spectrum.averages)


def _detectable_count(frequency: FloatArray) -> int:
    """Return how many frequencies of the grid lie `BINS_ABOVE` bins or more below the spectrum's end; 0 where
    they end below `MIN_HIGHEST_HZ`."""
    top_hz = frequency[-1 - BINS_ABOVE] if frequency.size > BINS_ABOVE else 0.0
    return int(np.searchsorted(FREQUENCY_HZ, top_hz)) if top_hz >= MIN_HIGHEST_HZ else 0


def _fit_background(
    background: FloatArray, density: FloatArray, amplitude: FloatArray
) -> tuple[float, FloatArray]:
    """Return the maximised sum of -(log S + P / S) without a resonance, and the amplitudes (shapes,) of the
    background (shapes, bins); `amplitude`: those to begin with."""
    fitted = amplitude @ background
    for _ in range(NULL_UPDATES):
        inverse = 1.0 / fitted
        amplitude = amplitude * ((background @ (density * inverse * inverse)) / (background @ inverse))
        fitted = amplitude @ background
    return -float(np.sum(np.log(fitted) + density / fitted)), amplitude


def _fit_resonances(
    resonances: FloatArray, background: FloatArray, density: FloatArray, own: FloatArray, others: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the (models,) maximised sums of -(log S + P / S) and (models, bins) fitted densities; `own`
    (models,) and `others` (models, shapes): amplitudes of resonance and background to begin with."""
    across = np.ascontiguousarray(background.T)
    fitted, inverse, scratch = (np.empty_like(resonances) for _ in range(3))

    def fit() -> None:
        np.matmul(others, background, out=fitted)
        np.add(fitted, np.multiply(own[:, None], resonances, out=scratch), out=fitted)

    fit()
    for _ in range(UPDATES):
        np.divide(1.0, fitted, out=inverse)
        np.multiply(np.multiply(inverse, inverse, out=scratch), density, out=scratch)
        own = own * np.einsum("mb,mb->m", resonances, scratch) / np.einsum("mb,mb->m", resonances, inverse)
        others = others * (scratch @ across) / (inverse @ across)
        fit()
    return -np.sum(np.log(fitted) + density / fitted, axis=1), fitted
