"""A ring of `counts` per revolution on a wheel, and the first harmonic of its pitch errors.

In: counts per revolution, rolling radii, speeds. Out: lengths, rates and shares of counts; angles that an
uneven ring shows. Every formula that ties counts to revolutions and to distance stands here; monitor,
diagnosis, discovery and the catalogue of effects use it.

No ring is cut, glued or mounted perfectly. The pitch errors of its teeth, random or not, repeat with every
revolution, so they are harmonics of the wheel's angle. A control unit reads whole counts some times per
revolution, and the first harmonic is what stays: an eccentric ring makes it, and the higher ones average out
between teeth.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np

from tpmsd.foundation.wheels import FloatArray

Number = TypeVar("Number", float, FloatArray)
"""A number, or an array of some."""

REVOLUTION_RAD = 2.0 * math.pi


def harmonic_rad(angle_rad: FloatArray, amplitude_rad: float, phase_rad: float) -> FloatArray:
    """Return amplitude * sin(angle + phase): shown angle minus true angle, rad, same shape."""
    return np.asarray(amplitude_rad * np.sin(angle_rad + phase_rad))


def amplitude_and_phase(sine: float, cosine: float) -> tuple[float, float]:
    """Return amplitude (rad) and phase (rad) of sine * sin(angle) + cosine * cos(angle)."""
    return math.hypot(sine, cosine), math.atan2(cosine, sine)


def count_length_m(radius_m: Number, counts: Number) -> Number:
    """Return 2 pi r / counts: the distance from one count to the next, m."""
    return REVOLUTION_RAD * radius_m / counts


def counts_per_m(counts: float, radius_m: float) -> float:
    """Return counts / (2 pi r), 1/m."""
    return counts / (REVOLUTION_RAD * radius_m)


def counts_per_revolution(per_m: float, radius_m: float) -> float:
    """Return 2 pi r * (counts per metre): the counts per revolution of a wheel of this rolling radius."""
    return REVOLUTION_RAD * radius_m * per_m


def radius_from_counts_m(counts: float, per_m: float) -> float:
    """Return counts / (2 pi * counts per metre): the rolling radius, m, by the counts per revolution."""
    return counts / (REVOLUTION_RAD * per_m)


def turns_hz(speed_mps: Number, radius_m: Number) -> Number:
    """Return v / (2 pi r): turns per second."""
    return speed_mps / (REVOLUTION_RAD * radius_m)


def fraction_of_counts(rate_per_s: float, counts: float, turns_per_s: Number) -> Number:
    """Return rate / (counts * turns per second): the fraction of a wheel's counts that is lost or added."""
    return rate_per_s / (counts * turns_per_s)
