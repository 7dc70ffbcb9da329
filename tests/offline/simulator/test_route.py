"""Routes: bounded, lively, of the kind asked for, and the same for the same seed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tpmsd.car.physics.motion import Motion
from tpmsd.foundation.errors import ConfigError
from tpmsd.offline.simulator.road import ROUTE_KINDS
from tpmsd.offline.simulator.route import Driver, make_route


def route(kind: str, seed: int = 3, duration_s: float = 900.0, flat: bool = False) -> Motion:
    """A quarter of an hour of this kind."""
    return make_route(kind, duration_s, np.random.default_rng(seed), flat=flat)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("kind", ROUTE_KINDS)
def test_accelerations_are_those_of_a_car(kind: str, seed: int) -> None:
    """Bends below 3 m/s2, braking and speeding up below 2.5, jerk below 6 m/s3; nobody drives backwards."""
    motion = route(kind, seed)

    assert np.abs(motion.accel_lat_mps2).max() < 3.0
    assert np.abs(motion.accel_long_mps2).max() < 2.5
    assert np.abs(np.gradient(motion.accel_long_mps2, motion.time_s)).max() < 6.0
    assert motion.speed_mps.min() >= 0.0


@pytest.mark.parametrize(
    ("kind", "slowest", "fastest"),
    [
        ("city", 4, 12),
        ("rural", 12, 28),
        ("motorway", 20, 36),
        ("mixed", 9, 26),
        ("oval", 9, 22),
        ("test-track", 8, 17),
        ("hills", 12, 28),
    ],
)
def test_mean_speed_is_that_of_the_road(kind: str, slowest: float, fastest: float) -> None:
    """A quarter of an hour's mean speed in m/s lies where such roads have it."""
    assert slowest < route(kind).speed_mps.mean() < fastest


def test_a_route_lasts_as_long_as_asked() -> None:
    """100 Hz from zero to the duration, both included."""
    motion = route("mixed", duration_s=123.0)

    assert (12301, 0.0, 123.0) == (len(motion), motion.time_s[0], motion.time_s[-1])


def test_every_drive_sets_off_from_a_standstill() -> None:
    """The first seconds stand still, as in a recording; later the car moves."""
    for kind in ROUTE_KINDS:
        motion = route(kind, duration_s=60.0)
        assert 0.0 == motion.speed_mps[:150].max()
        assert motion.speed_mps.max() > 5.0


def test_the_city_has_stops() -> None:
    """After setting off a city drive stands still several times."""
    standing = route("city").speed_mps < 1e-6
    halts = int(np.sum(np.diff(standing.astype(int)) == 1))

    assert halts >= 3


def test_both_directions_of_turn_are_driven() -> None:
    """A rural road turns left and right by radians each."""
    steps = route("rural").yaw_rate_radps / 100.0

    assert steps[steps > 0].sum() > 1.0
    assert steps[steps < 0].sum() < -1.0


def test_an_oval_turns_to_one_side_by_half_circles() -> None:
    """Each bend of the oval turns by pi, so that its straights are parallel."""
    motion = route("oval", duration_s=900.0)
    on_straight = (np.abs(motion.yaw_rate_radps) < 0.01) & (motion.speed_mps > 5)
    relative = (motion.heading_rad[on_straight] - motion.heading_rad[0]) / math.pi

    assert np.quantile(np.abs(relative - np.rint(relative)), 0.95) < 0.05
    assert np.abs(relative).max() > 8


def test_hills_are_steeper_than_other_roads_and_level_is_level() -> None:
    """Hills reach 5 % and stay below 12 %; a test track and `flat` have no slope at all."""
    steepest = np.tan(np.abs(route("hills").grade_rad).max())

    assert 0.05 < steepest < 0.12
    assert 0.0 == np.abs(route("test-track").grade_rad).max()
    assert 0.0 == np.abs(route("hills", flat=True).grade_rad).max()


def test_a_gentler_driver_takes_bends_slower() -> None:
    """The driver's lateral acceleration bounds the bends of the same road."""
    gentle = make_route("rural", 300.0, np.random.default_rng(5), driver=Driver(lateral_mps2=1.0))
    brisk = make_route("rural", 300.0, np.random.default_rng(5), driver=Driver(lateral_mps2=2.5))

    assert np.abs(gentle.accel_lat_mps2).max() < 1.3 < np.abs(brisk.accel_lat_mps2).max()


def test_the_same_seed_gives_the_same_route_and_another_another() -> None:
    """Routes are functions of their generator."""
    first, again, other = route("mixed", 7), route("mixed", 7), route("mixed", 8)

    assert first.speed_mps.tolist() == again.speed_mps.tolist()
    assert first.speed_mps.tolist() != other.speed_mps.tolist()


@pytest.mark.parametrize(
    ("kind", "duration", "message"),
    [
        (
            "sea",
            100.0,
            r"unknown route 'sea' \(routes: city rural motorway mixed oval test-track hills\)",
        ),
        ("city", 1.0, "duration 1 s is outside 10 to 86400 s"),
        ("city", float("nan"), "duration nan s is outside 10 to 86400 s"),
    ],
)
def test_routes_that_cannot_be(kind: str, duration: float, message: str) -> None:
    """An unknown kind or an impossible duration is one line."""
    with pytest.raises(ConfigError, match=f"^{message}$"):
        make_route(kind, duration, np.random.default_rng(1))
