"""Noise of a MEMS gyro by its Allan variance.

In: the five coefficients of IEEE Std 952, a sampling step. Out: an array of rates. Angle random walk N is
white noise of the rate, bias instability B is flicker noise, rate random walk K a random walk of the rate,
quantization Q the derivative of a white angle error, rate ramp R a straight drift.

Sources: IEEE Std 952-1997 (2008), annex C (the five terms and their Allan deviations); El-Sheimy, Hou and
Niu (2008), IEEE Trans. Instrum. Meas. 57(1). The ranges span data sheets of yaw-rate sensors, from 0.004
(chassis control) to 0.05 deg/s/sqrt(Hz) (the cheapest), with bias instabilities of 3 to 60 deg/h.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.worlds.instruments import markov

Array = NDArray[np.float64]
DEG = math.pi / 180.0
FLICKER_TAUS_S = tuple(0.3 * 4.0**k for k in range(8))
"""Time constants whose equal first-order processes add up to flicker noise from 0.3 s to an hour."""
FLICKER_SHARE = 0.68
"""Standard deviation of each of them per B, so that the plateau is B sqrt(2 ln 2 / pi)."""


@dataclass(frozen=True)
class AllanNoise:
    """Coefficients, SI units."""

    angle_random_walk: float
    """N, rad/s/sqrt(Hz)."""
    bias_instability: float
    """B, rad/s."""
    rate_random_walk: float = 0.0
    """K, rad/s2/sqrt(Hz)."""
    quantization: float = 0.0
    """Q, rad."""
    rate_ramp: float = 0.0
    """R, rad/s2."""

    def deviation(self, tau_s: Array) -> Array:
        """Allan deviation over averaging times: IEEE Std 952, eq. (C.26); of B its plateau."""
        squares = (
            3.0 * self.quantization**2 / tau_s**2
            + self.angle_random_walk**2 / tau_s
            + (2.0 * math.log(2.0) / math.pi) * self.bias_instability**2
            + self.rate_random_walk**2 * tau_s / 3.0
            + self.rate_ramp**2 * tau_s**2 / 2.0
        )
        return np.asarray(np.sqrt(squares))

    def drawn(self, n: int, step_s: float, rng: np.random.Generator) -> Array:
        """(n,) errors of the rate, each the mean over its step."""
        rate = rng.normal(0.0, self.angle_random_walk / math.sqrt(step_s), n)
        # overlapping processes; their sum is flat at 0.664 B to within a tenth up to some minutes
        for tau in FLICKER_TAUS_S:
            rate += markov(rng, n, step_s, FLICKER_SHARE * self.bias_instability, tau)
        rate += np.cumsum(rng.normal(0.0, self.rate_random_walk * math.sqrt(step_s), n))
        angle = rng.normal(0.0, self.quantization, n + 1)
        rate += np.diff(angle) / step_s
        return np.asarray(rate + self.rate_ramp * step_s * np.arange(n))


def zeroed(noise: AllanNoise) -> Callable[[int, float, np.random.Generator], Array]:
    """The noise less its mean over the drive: a constant bias is an effect of the catalogue, no noise."""

    def drawn(n: int, step_s: float, rng: np.random.Generator) -> Array:
        rate = noise.drawn(n, step_s, rng)
        return np.asarray(rate - rate.mean())

    return drawn


def draw(rng: np.random.Generator, cheap: bool = False) -> AllanNoise:
    """A sensor, from good to cheap, without a ramp: a straight drift is an effect of the catalogue."""

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    return AllanNoise(
        angle_random_walk=between(0.02 if cheap else 0.004, 0.05) * DEG,
        bias_instability=between(15.0 if cheap else 3.0, 60.0) * DEG / 3600.0,
        rate_random_walk=between(0.2, 5.0) * DEG / 3600.0 / 60.0,
    )


def allan_deviation(rate: Array, step_s: float, tau_s: Array) -> Array:
    """Overlapping Allan deviation of a series, for averaging times (m,): IEEE Std 952, eq. (C.6)."""
    angle = np.concatenate([[0.0], np.cumsum(rate) * step_s])
    out = []
    for tau in tau_s:
        m = max(round(float(tau) / step_s), 1)
        second = angle[2 * m :] - 2.0 * angle[m:-m] + angle[: -2 * m]
        out.append(math.sqrt(float(np.mean(second**2)) / 2.0) / (m * step_s))
    return np.array(out)
