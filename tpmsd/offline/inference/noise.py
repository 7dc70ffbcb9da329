"""The noise of a drive's instruments and road, as parameters.

In: nothing (plain records). Out: `Noise`, the limits within which it is estimated and what is known of it
beforehand. A noise is an argument everywhere: nothing that whitens or fits holds one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from tpmsd.foundation.wheels import FloatArray

MIN_READING_M = 1e-4
"""Least noise of a wheel's distance at an instant, where speeds are read instead of counts."""


@dataclass(frozen=True)
class Noise:
    """Standard deviations of what the instruments and the road add."""

    reading_m: tuple[float, float, float, float]
    """Noise of a wheel's distance at an instant: quantisation and time stamps."""
    rough_m: float = 4e-4
    """Noise of a wheel's distance per square root of a metre: the road."""
    floor_m: float = 1e-4
    """Noise of a wheel's distance per window, whatever the speed."""
    stamp_s: float = 2e-4
    """Noise of the time stamps between wheels."""
    gyro_radps: float = 1e-3
    gyro_drift_radps: float = 2e-6
    """Growth of the gyro's bias per square root of a second."""
    speed_white_mps: float = 0.02
    speed_mps: float = 0.05
    speed_memory: float = 0.4
    """Correlation of the receiver's speed error from window to window."""
    cross_white_mps: float = 0.02
    cross_mps: float = 0.05
    course_floor_rad: float = 5e-4
    white_m: float = 0.2
    slow_m: float = 1.5
    slow_tau_s: float = 30.0
    clock_s: float = 2e-3
    """Random drift of the receiver's clock against the bus's, which a constant latency does not hold."""
    clock_tau_s: float = 8.0
    age_s: float = 5e-4
    """Growth of the fixes' age per square root of a second, where it is a random walk."""
    radius_drift: float = 2e-5
    """Drift of a tyre's radius, relative: load, temperature and the road's crossfall change it slowly."""
    radius_drift_tau_s: float = 60.0
    left_right_drift: float = 3e-5
    """Slow difference of left and right radii, relative: slant of the road, side wind."""
    left_right_drift_tau_s: float = 15.0
    side_slip_rad: float = 2e-3
    """Wandering angle between the rear axle's course and the car's heading."""
    side_slip_tau_s: float = 8.0

    @classmethod
    def first(cls, quantum_rad: FloatArray, radius_m: FloatArray) -> Noise:
        """Return the initial values of a noise fit: quantisation of a tick's reading (4,), typical
        instruments.
        """
        fl, fr, rl, rr = np.maximum(quantum_rad / np.sqrt(2.0) * radius_m, MIN_READING_M).tolist()
        return cls(reading_m=(fl, fr, rl, rr))


LIMITS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "rough_m": (2e-5, 2e-2),
        "floor_m": (1e-5, 0.3),
        "stamp_s": (1e-6, 5e-3),
        "gyro_radps": (2e-5, 5e-2),
        "gyro_drift_radps": (1e-8, 1e-3),
        "speed_white_mps": (1e-3, 2.0),
        "speed_mps": (1e-3, 2.0),
        "speed_memory": (0.01, 0.97),
        "cross_white_mps": (1e-3, 2.0),
        "cross_mps": (1e-3, 2.0),
        "course_floor_rad": (1e-5, 3e-2),
        "white_m": (2e-3, 20.0),
        "slow_m": (5e-3, 50.0),
        "slow_tau_s": (3.0, 300.0),
        "clock_s": (1e-4, 0.3),
        "clock_tau_s": (0.5, 60.0),
        "age_s": (1e-6, 2e-2),
        "radius_drift": (1e-6, 3e-3),
        "radius_drift_tau_s": (10.0, 600.0),
        "left_right_drift": (1e-6, 5e-4),
        "left_right_drift_tau_s": (3.0, 25.0),
        "side_slip_rad": (1e-5, 5e-2),
    }
)
"""Least and greatest value of each parameter that is estimated; what real instruments and roads have lies
well inside. Which of them matter, a drive's layout of states says."""
PRIORS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "slow_m": (1.2, 1.0),
        "slow_tau_s": (40.0, 0.2),
        "gyro_drift_radps": (2e-6, 0.7),
        "radius_drift": (2e-5, 1.0),
        "radius_drift_tau_s": (60.0, 0.5),
    }
)
"""Median and logarithmic spread of what a drive hardly determines."""


def with_usual_drift(noise: Noise) -> Noise:
    """Return the noise with the radius drift of most tyres and roads."""
    return replace(
        noise, radius_drift=PRIORS["radius_drift"][0], radius_drift_tau_s=PRIORS["radius_drift_tau_s"][0]
    )
