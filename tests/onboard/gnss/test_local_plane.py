from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.onboard.timeline.local_plane import LocalPlane, _rotate_to_vertical

A_M = 6378137.0
F = 1.0 / 298.257223563
B_M = A_M * (1.0 - F)
E2 = F * (2.0 - F)
LATITUDES = (-79.0, -33.5, 0.0, 40.4, 80.0)


def meridian_arc_m(latitude_deg: float) -> float:
    """Distance from the equator along the meridian (Helmert's series in the third flattening)."""
    n, phi = F / (2.0 - F), math.radians(latitude_deg)
    terms = (
        (-3 / 2 * n + 9 / 16 * n**3) * math.sin(2 * phi)
        + (15 / 16 * n**2 - 15 / 32 * n**4) * math.sin(4 * phi)
        - 35 / 48 * n**3 * math.sin(6 * phi)
        + 315 / 512 * n**4 * math.sin(8 * phi)
    )
    return A_M / (1.0 + n) * (1.0 + n**2 / 4 + n**4 / 64) * (phi + terms)


def vincenty_direct(
    latitude: float, longitude: float, azimuth: float, distance_m: float
) -> tuple[float, float, float]:
    """Where a geodesic ends (rad), and its azimuth there (Vincenty, Survey Review 23, 1975: direct)."""
    u1 = math.atan((1 - F) * math.tan(latitude))
    sigma1 = math.atan2(math.tan(u1), math.cos(azimuth))
    sin_alpha = math.cos(u1) * math.sin(azimuth)
    cos2_alpha = 1 - sin_alpha**2
    u2 = cos2_alpha * (A_M**2 - B_M**2) / B_M**2
    a = 1 + u2 / 16384 * (4096 + u2 * (-768 + u2 * (320 - 175 * u2)))
    b = u2 / 1024 * (256 + u2 * (-128 + u2 * (74 - 47 * u2)))
    sigma = distance_m / (B_M * a)
    for _ in range(20):
        m = math.cos(2 * sigma1 + sigma)
        inner = math.cos(sigma) * (-1 + 2 * m**2) - b / 6 * m * (-3 + 4 * math.sin(sigma) ** 2) * (
            -3 + 4 * m**2
        )
        sigma = distance_m / (B_M * a) + b * math.sin(sigma) * (m + b / 4 * inner)
    s, c = math.sin(sigma), math.cos(sigma)
    x = math.sin(u1) * s - math.cos(u1) * c * math.cos(azimuth)
    end = math.atan2(
        math.sin(u1) * c + math.cos(u1) * s * math.cos(azimuth), (1 - F) * math.hypot(sin_alpha, x)
    )
    lam = math.atan2(s * math.sin(azimuth), math.cos(u1) * c - math.sin(u1) * s * math.cos(azimuth))
    k = F / 16 * cos2_alpha * (4 + F * (4 - 3 * cos2_alpha))
    m = math.cos(2 * sigma1 + sigma)
    wide = lam - (1 - k) * F * sin_alpha * (sigma + k * s * (m + k * c * (-1 + 2 * m**2)))
    return end, longitude + wide, math.atan2(sin_alpha, -x)


def wrapped(degrees: float) -> float:
    return (degrees + 180.0) % 360.0 - 180.0


def length_m(places: np.ndarray) -> float:
    return float(np.hypot(*np.diff(places, axis=0).T).sum())


@pytest.mark.parametrize("latitude", LATITUDES)
def test_a_hundred_kilometres_along_the_meridian(latitude: float):
    """A hundred kilometres north in steps of 50 m have the meridian arc's length, to 1 mm."""
    latitudes = np.linspace(latitude, latitude + 0.9, 2001)
    places = LocalPlane().to_plane_array(latitudes, np.full(2001, 11.0), np.zeros(2001))
    expected = meridian_arc_m(latitudes[-1]) - meridian_arc_m(latitudes[0])
    assert pytest.approx(expected, abs=1e-3) == length_m(places)
    assert pytest.approx((0.0, expected), abs=1e-3) == tuple(places[-1])


@pytest.mark.parametrize("height", [0.0, 2000.0, -430.0])
@pytest.mark.parametrize("latitude", LATITUDES)
def test_a_hundred_kilometres_along_a_parallel(latitude: float, height: float):
    """A hundred kilometres east at height, over the date line, have the parallel's length, to 1 mm."""
    phi = math.radians(latitude)
    circle_m = (A_M / math.sqrt(1 - E2 * math.sin(phi) ** 2) + height) * math.cos(phi)
    turns = np.arange(0, 100e3, 20.0) / circle_m
    longitudes = np.array([wrapped(179.7 + math.degrees(turn)) for turn in turns])
    plane = LocalPlane()
    places = plane.to_plane_array(np.full_like(turns, latitude), longitudes, np.full_like(turns, height))
    assert pytest.approx(circle_m * turns[-1], abs=1e-3) == length_m(places)
    # Headings turn by the meridian convergence, lambda sin(phi), relative to true north.
    assert pytest.approx(turns[-1] * math.sin(phi), abs=2e-9) == plane.rotation_rad


@settings(derandomize=True, deadline=None, max_examples=25)
@given(st.floats(-80, 80), st.floats(-180, 180), st.floats(0, 2 * math.pi), st.floats(1.0, 200.0))
def test_a_geodesic_is_a_straight_line(latitude: float, longitude: float, azimuth: float, step_m: float):
    """Driving straight on (by Vincenty's solution) is straight in the plane: length, direction, heading."""
    plane = LocalPlane()
    steps = min(400, int(100e3 / step_m))
    places, heading = [], math.nan
    start = math.pi / 2 - azimuth
    for i in range(steps + 1):
        phi, lam, course = vincenty_direct(
            math.radians(latitude), math.radians(longitude), azimuth, i * step_m
        )
        places.append(plane.to_plane(math.degrees(phi), wrapped(math.degrees(lam)), 0.0))
        heading = plane.heading_from_course(course % (2 * math.pi))
        assert pytest.approx(0.0, abs=1e-8) == math.remainder(heading - start, 2 * math.pi)
    distance = steps * step_m
    assert pytest.approx(distance, abs=1e-3) == length_m(np.array(places))
    assert pytest.approx((distance * math.cos(start), distance * math.sin(start)), abs=2e-3) == places[-1]


@pytest.mark.parametrize("grade", [0.1, -0.1])
def test_a_pass_road(grade: float):
    """Up and down a pass the distance is taken at the road's own height, within 1e-6."""
    latitudes = np.linspace(46.0, 46.18, 1001)
    arc_m = meridian_arc_m(latitudes[-1]) - meridian_arc_m(latitudes[0])
    heights = 2000.0 + grade * np.linspace(0, arc_m, 1001)
    places = LocalPlane().to_plane_array(latitudes, np.full(1001, 8.0), heights)
    # Each element of the arc is longer by height over the meridian's radius, that is by height * d(latitude).
    expected = arc_m + np.trapezoid(heights, np.radians(latitudes))
    assert pytest.approx(expected, rel=1e-6) == length_m(places)
    assert expected - arc_m > 1.0


def test_height_noise_moves_nothing():
    """Standing still, a height that jumps by tens of metres moves the position by less than 0.1 mm."""
    plane = LocalPlane()
    plane.to_plane(48.0, 11.0, 0.0)
    rng = np.random.default_rng(1)
    n = 500
    places = plane.to_plane_array(np.full(n, 48.01), np.full(n, 11.01), 500.0 + rng.normal(0, 20, n))
    assert np.ptp(places[1:], axis=0).max() < 1e-4


def test_closed_circuit_within_one_anchor():
    """A test track within the anchor's radius closes exactly, lap after lap."""
    turn = np.linspace(0, 20 * 2 * math.pi, 2001)
    latitudes, longitudes = 48.0 + 0.005 * np.sin(turn), 11.0 + 0.007 * (np.cos(turn) - 1)
    plane = LocalPlane()
    places = plane.to_plane_array(latitudes, longitudes, np.full(2001, 500.0))
    assert 1 == plane.anchors
    assert pytest.approx(0.0, abs=1e-9) == np.abs(places[1900:] - places[:101]).max()


def test_no_seam_where_the_plane_rolls_on():
    """At the new anchor the path stays smooth: no step and no kink in an even drive."""
    plane = LocalPlane()
    fixes = [vincenty_direct(1.0, 2.0, 0.7, 10.0 * i) for i in range(700)]
    places = np.array([plane.to_plane(math.degrees(f[0]), math.degrees(f[1]), 300.0) for f in fixes])
    assert 4 == plane.anchors
    assert np.linalg.norm(np.diff(places, n=2, axis=0), axis=1).max() < 1e-6


def test_first_fix_is_the_origin():
    """The first fix is 0/0, and east and north there are the axes."""
    plane = LocalPlane()
    assert (0.0, 0.0) == plane.to_plane(48.0, 11.0, 0.0)
    assert pytest.approx(math.pi / 2) == plane.heading_from_course(0.0)
    assert pytest.approx(0.0) == plane.heading_from_course(math.pi / 2)
    assert pytest.approx(math.pi) == plane.heading_from_course(1.5 * math.pi)
    assert pytest.approx(-math.pi / 2) == plane.heading_from_course(math.pi)


def test_nothing_known():
    """Without a position there is none in the plane, and what was known stays."""
    plane = LocalPlane()
    assert all(math.isnan(value) for value in plane.to_plane(math.nan, 11.0, 0.0))
    assert math.isnan(plane.heading_from_course(1.0))
    plane.to_plane(48.0, 11.0, math.nan)
    place = plane.to_plane(48.001, 11.0, 500.0)
    assert all(math.isnan(value) for value in plane.to_plane(48.0, math.inf, 0.0))
    assert math.isnan(plane.heading_from_course(math.nan))
    assert pytest.approx(place, abs=1e-12) == plane.to_plane(48.001, 11.0, math.nan)


@pytest.mark.parametrize("away", [(48.03, 11.0), (48.0, 12.0), (-48.0, -169.0), (90.0, 0.0)])
def test_a_wrong_fix_leaves_no_trace(away: tuple[float, float]):
    """One fix far away, be it the other side of the earth, is far in the plane; the next is home again."""
    plane = LocalPlane()
    plane.to_plane(48.0, 11.0, 0.0)
    home = plane.to_plane(48.001, 11.001, 500.0)
    assert math.hypot(*plane.to_plane(*away, 500.0)) > 3000.0
    assert math.isfinite(plane.heading_from_course(1.0))
    if away != (-48.0, -169.0):  # from the antipode every way back is as good
        assert pytest.approx(home, abs=20.0 if away[0] == 90.0 else 0.02) == plane.to_plane(
            48.001, 11.001, 500.0
        )


@pytest.mark.parametrize(
    ("height", "is_road"), [(-499.9, True), (-500.1, False), (8999.9, True), (9000.1, False)]
)
def test_heights_of_no_road_leave_the_scale(height: float, is_road: bool):
    """From 500 m below the ellipsoid to 9000 m above it a height sets the scale: arc = angle (a + h)."""
    plane = LocalPlane()
    plane.to_plane(0.0, 0.0, height)
    arc_m = math.radians(0.01) * (A_M + (height if is_road else 0.0))
    assert pytest.approx((arc_m, 0.0), abs=1e-3) == plane.to_plane(0.0, 0.01, height)


@pytest.mark.parametrize("degrees", [1e-3, 1.0, 40.0, 90.0, 170.0])
def test_axes_are_carried_by_the_rotation_that_takes_one_vertical_to_the_other(degrees: float) -> None:
    """The vertical comes to lie on the other; lengths and angles stay."""
    rng = np.random.default_rng(round(1e3 * degrees))
    up, side = (vector / np.linalg.norm(vector) for vector in rng.normal(size=(2, 3)))
    side -= up * (up @ side)
    side /= np.linalg.norm(side)
    to = math.cos(math.radians(degrees)) * up + math.sin(math.radians(degrees)) * side
    axis = np.cross(up, side)
    tilted = math.cos(math.radians(degrees)) * side - math.sin(math.radians(degrees)) * up

    for vector, carried in ((up, to), (axis, axis), (side, tilted)):
        found = _rotate_to_vertical(tuple(vector.tolist()), tuple(up.tolist()), tuple(to.tolist()))
        assert np.allclose(carried, found, atol=1e-12)


@pytest.mark.parametrize(("distance_m", "anchors"), [(1999.5, 1), (2000.5, 2)])
def test_the_plane_rolls_on_two_kilometres_from_where_it_touches(distance_m: float, anchors: int) -> None:
    """The scale error across the line to the anchor is (d / R)^2 / 6: 1.6e-8 at the bound of 2 km."""
    plane = LocalPlane()
    plane.to_plane(48.0, 11.0, 0.0)
    latitude, longitude, _ = vincenty_direct(math.radians(48.0), math.radians(11.0), 0.7, distance_m)
    plane.to_plane(math.degrees(latitude), math.degrees(longitude), 0.0)
    assert anchors == plane.anchors


@pytest.mark.parametrize(("climb_m", "anchors"), [(4.99, 1), (5.01, 2), (-4.99, 1), (-5.01, 2)])
def test_the_plane_rises_with_the_road_by_five_metres(climb_m: float, anchors: int) -> None:
    """Up and down: the scale error of a height this far from the anchor's is 8e-7."""
    plane = LocalPlane()
    plane.to_plane(48.0, 11.0, 100.0)
    plane.to_plane(48.0001, 11.0, 100.0 + climb_m)
    assert anchors == plane.anchors


@pytest.mark.parametrize("longitude", [180.0, -180.0])
def test_a_fix_on_the_very_other_side_of_the_earth_is_borne(longitude: float) -> None:
    """From there any way back is as short as any other: headings stay, nothing is divided by zero."""
    plane = LocalPlane()
    plane.to_plane(0.0, 0.0, 0.0)
    assert all(map(math.isfinite, plane.to_plane(0.0, longitude, 0.0)))
    assert math.isfinite(plane.heading_from_course(1.0))
    up, east = (1.0, 0.0, 0.0), (0.0, 0.6, 0.8)
    assert east == _rotate_to_vertical(east, up, (-1.0, 0.0, 0.0))
    nearly = math.radians(179.95)
    assert east == _rotate_to_vertical(east, up, (math.cos(nearly), math.sin(nearly), 0.0))
