"""The ripple of a wheel's ring, once per revolution, in the counts of the wheel: how many counts a turn has.

In: the angle of a wheel by its counts, and what it does rapidly against smooth turning or against the other
wheels. Out: the power of a line at trial frequencies over the noise beside it, and the log-likelihood that
this ripple repeats once per revolution, for each share of the counts that may be missing.

A ring's unevenness goes with the wheel's true angle. Of a larger tyre it comes after as many counts as ever,
of counts that are lost after fewer: this alone tells the two apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True, slots=True)
class LostShares:
    """Shares of a ring's counts that may be missing."""

    largest: float = 1e-2
    """One wheel that loses more is off by a whole tyre size."""
    step: float = 1e-4
    """Between shares that are tried: a tenth of a ripple's width in a minute of 700 turns."""
    ring_error: float = 3e-4
    """Share by which the number of a ring's counts is known no better: 12 of 40,000, as two wheels of one
    van differ on six drives."""

    @property
    def values(self) -> FloatArray:
        """Return the (shares,) tried shares of both signs; a negative best one means that none is lost."""
        count = round(self.largest / self.step)
        return np.linspace(-self.largest, self.largest, 2 * count + 1)


LOST_SHARES = LostShares()
OUTLIER_STDS = 6.0
"""Rapid differences beyond so many standard deviations are kerbs, joints and lost frames, no ripple."""
MIN_STD_RAD = 1e-12
"""Least standard deviation of rapid differences: a simulation without noise has none."""
STD_OF_MEDIAN = 0.6745
"""Median size of normal noise, in standard deviations."""


def robust_std(rapid: FloatArray) -> float:
    """Return the standard deviation of rapid differences by their median size: outliers do not move it."""
    return float(np.median(np.abs(rapid))) / STD_OF_MEDIAN


def line_power(
    phase: FloatArray, rapid: FloatArray | NDArray[np.complex128], frequencies: FloatArray
) -> FloatArray:
    """(k,) |sum of rapid * exp(-i * frequency * phase)|^2 at `frequencies` (k,); `phase` and `rapid` (n,).

    Schuster's periodogram (1898) without its division by the noise.
    """
    return np.asarray(np.square(np.abs(np.exp(-1j * np.outer(frequencies, phase)) @ rapid)))


def noise_power(power: FloatArray) -> FloatArray:
    """(..., 1) mean power of the noise by the median over the last axis, of which a line takes few.

    The median of an exponential distribution is log 2 of its mean.
    """
    return np.asarray(np.median(power, axis=-1, keepdims=True) / math.log(2.0))


def ripple_gain(
    angle_rad: FloatArray,
    ripple_rad: FloatArray | NDArray[np.complex128],
    shares: FloatArray,
    variance_rad2: float,
) -> FloatArray:
    """(shares,) log-likelihood gain of a ripple once per revolution over noise of this variance, if the wheel
    has turned by (1 + share) times the counted angle (n,), at whatever phase.

    The noise is that near one period per revolution where it exceeds the variance: roads and frames make more
    of it there than elsewhere.
    """
    power = line_power(angle_rad, ripple_rad * np.exp(-1j * angle_rad), shares)
    return np.asarray(power / max(len(ripple_rad) * variance_rad2, float(noise_power(power)[0]), 1e-30))


def common_amplitude_gain(gains: FloatArray, blocks: int) -> FloatArray:
    """Return the (...) log-likelihood gain of a ripple of one amplitude in all blocks, any phase in each.

    `gains` (...) are the sums of `ripple_gain` over them. With a size and a phase of its own in each block,
    noise alone gains as many nats as there are blocks, and its greatest sum over many shares far more. Of one
    size, unknown, a block's gain has an exponential distribution, of mean 1 by noise and larger by a ripple:
    n (m - 1 - log m) is the gain of the likeliest mean m over 1.
    """
    mean = np.maximum(np.asarray(gains) / blocks, 1.0)
    return np.asarray(blocks * (mean - 1.0 - np.log(mean)))
