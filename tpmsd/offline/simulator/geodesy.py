"""Conversion of motion over ground to latitude and longitude on the WGS-84 ellipsoid.

In: horizontal velocity in the plane in which the car's heading was integrated. Out: geodetic positions and
the velocity towards true east and north.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.motion import integrate
from tpmsd.foundation.wheels import FloatArray

_A_M = 6_378_137.0
_E2 = 0.0066943799901413165


@dataclass(frozen=True, slots=True)
class GeodeticTrack:
    """(n,) positions in degrees and velocities in m/s."""

    latitude_deg: FloatArray
    longitude_deg: FloatArray
    east_mps: FloatArray
    north_mps: FloatArray


def radii_of_curvature(latitude_rad: FloatArray | float) -> tuple[FloatArray, FloatArray]:
    """Return (M, N): meridian and prime-vertical radius of curvature in metres."""
    w2 = 1.0 - _E2 * np.sin(latitude_rad) ** 2
    return np.asarray(_A_M * (1 - _E2) / w2**1.5), np.asarray(_A_M / np.sqrt(w2))


def on_ellipsoid(
    time_s: FloatArray,
    east_mps: FloatArray,
    north_mps: FloatArray,
    height_m: FloatArray,
    latitude_deg: float,
    longitude_deg: float,
) -> GeodeticTrack:
    """Return the track on the ellipsoid of a plane velocity integrated from a starting point.

    A car that steers straight follows a geodesic, along which the direction of true north turns against it by
    v_east * tan(latitude) / N per second. Solved by fixed-point iteration, which gains five digits per round
    on drives of less than some hundred kilometres.
    """
    lat = np.full_like(time_s, np.radians(latitude_deg))
    turned = np.zeros_like(time_s)
    plane = east_mps + 1j * north_mps
    for _ in range(4):
        velocity = plane * np.exp(1j * turned)
        meridian, prime = radii_of_curvature(lat)
        lat = np.radians(latitude_deg) + integrate(velocity.imag / (meridian + height_m), time_s)
        turned = -integrate(velocity.real * np.tan(lat) / (prime + height_m), time_s)
    velocity = plane * np.exp(1j * turned)
    _, prime = radii_of_curvature(lat)
    lon_step = integrate(velocity.real / ((prime + height_m) * np.cos(lat)), time_s)
    lon = longitude_deg + np.degrees(lon_step)
    return GeodeticTrack(
        np.degrees(lat), (lon + 180.0) % 360.0 - 180.0, velocity.real.copy(), velocity.imag.copy()
    )
