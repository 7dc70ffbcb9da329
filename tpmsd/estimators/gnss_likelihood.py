"""How probable a GNSS fix is for each particle, for receivers whose errors are neither white nor Gaussian.

In: a `Fix` and the particles' predicted antenna position, speed and heading. Out: a log-likelihood per
particle.

Two departures from paper 000, eq. (10d), and why:
- Errors of real receivers are correlated over tens of seconds (position) or about a second (Doppler). Taken
  as
  white, a 10 Hz receiver would be believed hundreds of times over. A white error of variance R every T
  seconds has the low-frequency power R*T; a correlated one 2*sigma^2*tau. Matching them gives R = sigma^2 *
  max(1, 2 tau / T).
- Tails are heavy (multipath): Student-t with 4 degrees of freedom in place of the Gaussian, so that one
  outlier
  cannot select the particles, and fixes far outside are refused outright by the caller.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.timeline.tick import Fix
from tpmsd.wheels import FloatArray

TAIL_DOF = 4.0


@dataclass(frozen=True, slots=True)
class GnssNoise:
    """What is assumed of a receiver beyond what its sentences say."""

    position_correlation_s: float = 20.0
    velocity_correlation_s: float = 1.0
    position_floor_m: float = 0.3
    """Below this the bootstrap proposal of Table I would starve; also covers what the clocks leave."""
    speed_std_mps: float = 0.06
    """Doppler speed; receivers do not state it in RMC or VTG."""
    timing_std_s: float = 0.03
    """Jitter of the time stamps, which turns acceleration and yaw rate into errors of speed and course."""


def correlation_inflation(correlation_s: float, interval_s: float) -> float:
    """Factor on a variance that makes white noise every `interval_s` as strong as correlated noise at low
    frequency."""
    return max(1.0, 2.0 * correlation_s / max(interval_s, 1e-3))


def student_t_log(squared: FloatArray, dimension: int) -> FloatArray:
    """Log density, up to a constant, of a multivariate Student-t at the squared Mahalanobis distance
    `squared`."""
    out: FloatArray = -0.5 * (TAIL_DOF + dimension) * np.log1p(squared / TAIL_DOF)
    return out


def position_variance(fix: Fix, interval_s: float, noise: GnssNoise) -> float:
    """Variance per axis of the equivalent white position error, m2."""
    own = max(fix.position_std_m, noise.position_floor_m) ** 2
    return own * correlation_inflation(noise.position_correlation_s, interval_s)


def speed_variance(interval_s: float, accel_mps2: float, quantisation_mps: float, noise: GnssNoise) -> float:
    """Variance of Doppler speed minus one tick's wheel speed, (m/s)2."""
    doppler = noise.speed_std_mps**2 * correlation_inflation(noise.velocity_correlation_s, interval_s)
    return doppler + (noise.timing_std_s * accel_mps2) ** 2 + quantisation_mps**2


def heading_variance(speed_mps: float, interval_s: float, yaw_rate_radps: float, noise: GnssNoise) -> float:
    """Variance of the course over ground, rad2: Doppler's cross-track error over the speed."""
    cross = (noise.speed_std_mps / max(speed_mps, 0.5)) ** 2
    cross *= correlation_inflation(noise.velocity_correlation_s, interval_s)
    return cross + (noise.timing_std_s * yaw_rate_radps) ** 2 + 0.003**2
