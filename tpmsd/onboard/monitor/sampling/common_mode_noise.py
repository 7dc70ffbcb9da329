"""Error of the level of all wheels: reflections of the receiver, and wheels that all spin.

In: samples of a drive. Out: the variance that each adds to what all wheels have in common.

What all wheels have in common rests on the receiver's speed. Between high houses it is that of reflected
signals, for some seconds or a minute, and the estimate does not know. A tyre that lost air does not gain it
again: so a level that jumps to and fro says little for as long as it jumps. There are two states, clear and
reflected, the errors of the latter new in each sample. This is the filter of a hidden Markov model [Rabiner
1989, eqs (19) and (20)] over differences of neighbouring samples, which a slow loss leaves small.
"""

from __future__ import annotations

import math

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.baseline.reference import GROWTH, RadiusReference
from tpmsd.onboard.monitor.settings import JUDGE, LEVEL, REFERENCE


class CommonModeNoise:
    """Noise of the level of one drive. Radii are relative to nominal throughout."""

    def __init__(self, reference: RadiusReference) -> None:
        self._mean, self._covariance = reference.mean.copy(), reference.covariance.copy()
        self._reflected = LEVEL.reflected_share
        """Probability that the last sample was."""
        self._last: tuple[float, FloatArray, float, float] | None = None
        """Level, features (SIZE,), variance, and the variance of a reflected one beside it."""

    @property
    def reflected(self) -> float:
        """Probability that the last sample is of reflected signals."""
        return self._reflected

    def update(self, deviation: FloatArray, noise: FloatArray, features: FloatArray) -> float:
        """Update by a sample: radius over nominal less one (d,), its covariance (d, d) and features (d,
        SIZE). Return the variance that reflections add to that of its level."""
        d = len(deviation)
        level, h, variance = float(deviation.mean()), features.mean(axis=0), float(noise.sum()) / d**2
        speed_mps = math.sqrt(max(float(h[GROWTH]) * REFERENCE.per_speed2, LEVEL.slowest_mps**2))
        error2 = (LEVEL.reflected_mps / speed_mps) ** 2
        leave, enter = 1.0 / LEVEL.reflected_samples, LEVEL.reflected_share / LEVEL.reflected_samples
        before = np.array([1.0 - self._reflected, self._reflected])
        chances = before[:, None] * np.array([[1.0 - enter, enter], [leave, 1.0 - leave]])
        if self._last is not None:
            last, last_h, last_variance, last_error2 = self._last
            step = h - last_h
            jump = level - last - float(step @ self._mean)
            spread = variance + last_variance + 2.0 * JUDGE.nuisance.common**2
            spread += float(step @ self._covariance @ step)
            spreads = spread + np.array([[0.0, error2], [last_error2, last_error2 + error2]])
            log_chances = np.log(chances) - 0.5 * (np.log(spreads) + jump**2 / spreads)
            chances = np.exp(log_chances - log_chances.max())
            chances /= chances.sum()
        self._reflected = float(chances[:, 1].sum())
        self._last = level, h, variance, error2
        precision = (1.0 - self._reflected) / variance + self._reflected / (variance + error2)
        return 1.0 / precision - variance
