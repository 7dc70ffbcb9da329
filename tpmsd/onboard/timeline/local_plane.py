"""Lays a drive out in a plane, true to the millimetre in its distances however long it is.

In: WGS-84 latitude, longitude, height. Out: east and north in metres, and headings that fit them.

No plane fits the whole earth, but a car needs only the way from fix to fix. So the plane touches the
ellipsoid at an anchor, and rolls on (a new anchor, placed and rotated so that positions and headings run on
without a seam) as soon as the car has gone `radius_m` from it or climbed `climb_m`. A drive that returns
after a hundred kilometres meets its start only to within the earth's curvature; a drive within one anchor's
radius meets it exactly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tpmsd.foundation.wheels import FloatArray

Vector = tuple[float, float, float]

WGS84_A_M = 6378137.0
WGS84_F = 1.0 / 298.257223563
WGS84_E2 = WGS84_F * (2.0 - WGS84_F)
_MEAN_RADIUS_M = 6371008.8
RADIUS_M = 2000.0
"""Scale error at this distance: (d / R)^2 / 6 = 1.6e-8 across the line to the anchor, none along it."""
CLIMB_M = 5.0
"""Scale error of a height this far from the anchor's: 8e-7."""
_MIN_HEIGHT_M, _MAX_HEIGHT_M = -500.0, 9000.0
_NEAR_M = 20e3


class _Horizon(NamedTuple):
    """A point's horizon: its latitude's sine, and the unit vectors there, earth-centred."""

    sin_latitude: float
    east: Vector
    north: Vector
    up: Vector

    def earth_centred(self, height_m: float) -> Vector:
        """Return the earth-centred coordinates (m) of the point at a height above the ellipsoid."""
        normal = WGS84_A_M / math.sqrt(1.0 - WGS84_E2 * self.sin_latitude**2)
        across = normal + height_m
        return (
            across * self.up[0],
            across * self.up[1],
            (normal * (1.0 - WGS84_E2) + height_m) * self.up[2],
        )


@dataclass(frozen=True, slots=True)
class _Anchor:
    """Point at which the plane touches the ellipsoid (raised to the car's height), and its coordinates in the
    plane."""

    point: _Horizon
    height_m: float
    origin_m: Vector
    east_m: float
    north_m: float
    rotation_rad: float
    """Angle from the plane's axes to true east and north at the anchor, counter-clockwise."""


class LocalPlane:
    """The plane of one drive; the first fix is its origin, and true east there is its first axis."""

    def __init__(self, radius_m: float = RADIUS_M, climb_m: float = CLIMB_M) -> None:
        self._radius_m = radius_m
        self._climb_m = climb_m
        self._anchor: _Anchor | None = None
        self._here: _Horizon | None = None
        self.anchors = 0
        """Number of times that the plane was laid on, the first time included."""

    @property
    def rotation_rad(self) -> float:
        """Angle from the plane's axes to true east and north at the present position; NaN before the first.

        Carries the anchor's axes to the present position by the smallest rotation, and measures true east
        there.
        """
        anchor, here = self._anchor, self._here
        if anchor is None or here is None:
            return math.nan
        east = _rotate_to_vertical(anchor.point.east, anchor.point.up, here.up)
        north = _rotate_to_vertical(anchor.point.north, anchor.point.up, here.up)
        return anchor.rotation_rad + math.atan2(_dot(here.east, north), _dot(here.east, east))

    def to_plane(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> tuple[float, float]:
        """Return east and north (m) of a fix; (NaN, NaN) without a position. The fix becomes the present
        position.

        An altitude of NaN, or one where no road is, leaves the scale at the last height.
        """
        if not (math.isfinite(latitude_deg) and math.isfinite(longitude_deg)):
            return math.nan, math.nan
        here = _horizon(math.radians(latitude_deg), math.radians(longitude_deg))
        known_height = _MIN_HEIGHT_M < altitude_m < _MAX_HEIGHT_M
        if self._anchor is None:
            self._set_anchor(here, altitude_m if known_height else 0.0, 0.0, 0.0, 0.0)
        anchor = self._anchor
        assert anchor is not None
        # At the anchor's height, not its own: seen from the anchor, a climb would tilt into the plane as
        # motion.
        x, y, z = here.earth_centred(anchor.height_m)
        ox, oy, oz = anchor.origin_m
        offset = (x - ox, y - oy, z - oz)
        east, north = _dot(offset, anchor.point.east), _dot(offset, anchor.point.north)
        square_m2 = _dot(offset, offset)
        stretch = _arc_per_projection(math.hypot(east, north), math.sqrt(square_m2), anchor.height_m)
        east, north = east * stretch, north * stretch
        cos, sin = math.cos(anchor.rotation_rad), math.sin(anchor.rotation_rad)
        plane_east = anchor.east_m + cos * east - sin * north
        plane_north = anchor.north_m + sin * east + cos * north
        self._here = here
        height = altitude_m if known_height else anchor.height_m
        if square_m2 > self._radius_m**2 or abs(height - anchor.height_m) > self._climb_m:
            self._set_anchor(here, height, plane_east, plane_north, self.rotation_rad)
        return plane_east, plane_north

    def to_plane_array(
        self, latitude_deg: FloatArray, longitude_deg: FloatArray, altitude_m: FloatArray
    ) -> FloatArray:
        """Return (n, 2) east and north (m) of (n,) fixes in the order of the drive: n calls of `to_plane`.

        Not vectorised inside: where the plane rolls on depends on all fixes before, at some 5 us each.
        """
        points = zip(latitude_deg.tolist(), longitude_deg.tolist(), altitude_m.tolist(), strict=True)
        return np.array([self.to_plane(*point) for point in points], dtype=np.float64).reshape(-1, 2)

    def heading_from_course(self, course_rad: float) -> float:
        """Return the plane heading (counter-clockwise from the plane's east, in (-pi, pi]) of a course at the
        present position.

        The course is clockwise from true north, as NMEA has it. NaN before the first position or without a
        course.
        """
        heading = math.pi / 2 - course_rad + self.rotation_rad
        return math.pi - (math.pi - heading) % (2 * math.pi) if math.isfinite(heading) else math.nan

    def _set_anchor(
        self, here: _Horizon, height_m: float, east_m: float, north_m: float, rotation_rad: float
    ) -> None:
        """Make this point the anchor, with these coordinates in the plane, and the present position."""
        self._anchor = _Anchor(here, height_m, here.earth_centred(height_m), east_m, north_m, rotation_rad)
        self._here = here
        self.anchors += 1


def _horizon(latitude_rad: float, longitude_rad: float) -> _Horizon:
    """Return the horizon of a point: unit vectors east, north and up, earth-centred."""
    sin_lat, cos_lat = math.sin(latitude_rad), math.cos(latitude_rad)
    sin_lon, cos_lon = math.sin(longitude_rad), math.cos(longitude_rad)
    return _Horizon(
        sin_lat,
        east=(-sin_lon, cos_lon, 0.0),
        north=(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat),
        up=(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat),
    )


def _arc_per_projection(flat: float, chord: float, height_m: float) -> float:
    """Return arc length over projected length `flat` of a chord from the anchor at this height.

    The arc runs along the curved earth, the projection into the tangent plane (azimuthal equidistant).
    """
    radius = _MEAN_RADIUS_M + height_m
    if chord < _NEAR_M:
        return 1.0 + (flat / radius) ** 2 / 6.0
    # A leap (a wrong fix, a ferry): keep it far away, also where the tangent plane would fold it back.
    return 2.0 * radius * math.asin(min(chord / (2.0 * radius), 1.0)) / max(flat, 1.0)


def _rotate_to_vertical(vector: Vector, from_up: Vector, to_up: Vector) -> Vector:
    """Return a vector turned by the smallest rotation that takes one vertical to the other (Rodrigues)."""
    axis, cos = _cross(from_up, to_up), _dot(from_up, to_up)
    if cos < -0.999999:
        return vector  # the other side of the earth: any way is as short as any other
    once = _cross(axis, vector)
    twice = _cross(axis, once)
    return (
        vector[0] + once[0] + twice[0] / (1.0 + cos),
        vector[1] + once[1] + twice[1] / (1.0 + cos),
        vector[2] + once[2] + twice[2] / (1.0 + cos),
    )


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
