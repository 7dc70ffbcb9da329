"""The world: noise, roughness, faults, and the ellipsoid that it lies on."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from tests.offline.simulator.drives import straight, world_of
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import FL, RL, RR
from tpmsd.offline.simulator.faults import Fault
from tpmsd.offline.simulator.geodesy import on_ellipsoid
from tpmsd.offline.simulator.noise import gauss_markov
from tpmsd.offline.simulator.route import make_route
from tpmsd.offline.simulator.world import ROUGHNESS_STD_M

NOMINAL = np.full(4, 0.316)


def test_gauss_markov_noise_is_that_of_a_filter() -> None:
    """To the last bit what `scipy.signal.lfilter` makes of the same numbers."""
    phi = float(np.exp(-0.5 / 5.0))
    white = np.random.default_rng(2).standard_normal((500, 2))
    drive = np.sqrt(1 - phi**2) * white
    drive[:1] = white[:1]
    noise = gauss_markov(np.random.default_rng(2), 500, 0.5, 1.2, 5.0, 2)
    assert np.array_equal(1.2 * np.asarray(lfilter([1.0], [1.0, -phi], drive, axis=0)), noise)


def test_gauss_markov_noise_has_its_size_and_memory() -> None:
    """Standard deviation as given, autocorrelation 1/e at one time constant, stationary from the start."""
    noise = gauss_markov(np.random.default_rng(1), 2000, 0.5, 1.2, 5.0, 300)
    lagged = np.mean(noise[:-10] * noise[10:]) / np.mean(noise**2)

    assert pytest.approx(1.2, rel=0.02) == noise.std()
    assert pytest.approx(1.2, rel=0.1) == noise[0].std()
    assert pytest.approx(math.exp(-1), abs=0.02) == lagged


def test_roughness_averages_out() -> None:
    """Roughness scatters a wheel's speed at 100 Hz; over 200 s its angle is right to 1e-5."""
    motion = straight(20.0, 200.0)
    rough, smooth = world_of(motion, roughness_std_m=ROUGHNESS_STD_M), world_of(motion)
    rates = np.diff(rough.angles_rad[:, RL]) * 100.0 * 0.316 / 20.0

    assert pytest.approx(ROUGHNESS_STD_M / 0.316, rel=0.3) == rates.std()
    assert pytest.approx(1.0, abs=1e-5) == rough.angles_rad[-1, RL] / smooth.angles_rad[-1, RL]


def test_roughness_is_as_large_as_a_real_road_has_it() -> None:
    """Two wheels' ratio over half a second scatters by 0.02 to 0.04 % (a RAV4 in a suburb: 0.023 %)."""
    world = world_of(straight(15.0, 400.0), roughness_std_m=ROUGHNESS_STD_M)
    turned = np.diff(world.angles_rad[::50], axis=0)

    assert 2e-4 < np.log(turned[:, FL] / turned[:, RL]).std() < 4e-4


def test_a_sloping_road_always_shortens_what_the_receiver_sees() -> None:
    """road_grade is nature's, so the world adds it where the road has slopes, and only there."""
    hills = world_of(make_route("hills", 60.0, np.random.default_rng(1)))
    level = world_of(straight(20.0, 10.0))

    assert ["road_grade"] == [effect.name for effect in hills.model]
    assert [] == [effect.name for effect in level.model]


@pytest.mark.parametrize(
    ("fault", "millimetres", "duration"),
    [
        (Fault("puncture", 2.0, "percent", "rl", 300.0), -6.32, 30.0),
        (Fault("leak", 1.5, "mm", "rl", 300.0), -1.5, 600.0),
        (Fault("step", 20.0, "pressure-percent", "rl", 300.0), -1.41 * 316 / 304, 0.0),
        (Fault("puncture", 2.0, "mm", "rl", 300.0, duration_s=12.0), -2.0, 12.0),
    ],
)
def test_faults_have_the_size_asked_for(fault: Fault, millimetres: float, duration: float) -> None:
    """In per cent of radius, millimetres or per cent of pressure; over their kind's time or the one given."""
    (effect,) = fault.effects(NOMINAL)

    assert ("rl", 300.0, duration) == (effect.wheel, effect.onset_s, effect.duration_s)
    assert pytest.approx(millimetres, rel=1e-3) == 1000 * effect.deviation_m


def test_diffusion_takes_all_four() -> None:
    """Diffusion is the same slow ramp on every wheel."""
    effects = Fault("diffusion", 25.0, "pressure-percent").effects(NOMINAL)

    assert ["fl", "fr", "rl", "rr"] == [effect.wheel for effect in effects]
    assert {1800.0} == {effect.duration_s for effect in effects}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("explosion", 1.0), "unknown fault 'explosion' (faults: puncture leak diffusion step)"),
        (("puncture", 1.0), "puncture: wheel None is not one of fl fr rl rr"),
        (("diffusion", 1.0, "mm", "rl"), "diffusion concerns all four wheels and takes none"),
    ],
)
def test_faults_that_make_no_sense(arguments: tuple[str, float], message: str) -> None:
    """One line says what is wrong."""
    with pytest.raises(ConfigError) as caught:
        Fault(*arguments)

    assert message == str(caught.value)


def test_an_unknown_unit_of_size() -> None:
    """A size in inches is refused by name."""
    with pytest.raises(
        ConfigError, match=r"unknown unit of size 'inch' \(units: percent mm pressure-percent\)"
    ):
        Fault("leak", 1.0, "inch", "rl").effects(NOMINAL)


def test_a_mile_north_is_a_minute_of_latitude() -> None:
    """At 45 degrees a minute of latitude is 1852.2 m, whence the nautical mile."""
    time = np.arange(10001) / 10.0
    still = np.zeros_like(time)
    north = on_ellipsoid(time, still, np.full_like(time, 1.8522), still, 45.0, 10.0)

    assert pytest.approx(1.0, abs=2e-4) == 60 * (north.latitude_deg[-1] - 45.0)
    assert 10.0 == north.longitude_deg[-1]


def test_a_degree_of_the_equator_is_111_319_m() -> None:
    """Eastwards along the equator the radius is the ellipsoid's own, 6378137 m."""
    time = np.arange(1001.0)
    still = np.zeros_like(time)
    track = on_ellipsoid(
        time, np.full_like(time, 6378137.0 * math.radians(1.0) / 1000.0), still, still, 0.0, 10.0
    )

    assert pytest.approx((0.0, 11.0), abs=1e-9) == (track.latitude_deg[-1], track.longitude_deg[-1])


def test_straight_ahead_is_a_great_circle() -> None:
    """Setting off east at 60 degrees north, a car that does not steer crosses the parallel southwards.

    On the sphere its latitude after the arc s is asin(sin(60) cos(s)); 100 km make 0.0137 degrees (1.36 km),
    and its course has turned by atan(tan(60) sin(s)) to the right. The ellipsoid differs by less than one per
    cent.
    """
    time = np.arange(10001) / 2.0
    still = np.zeros_like(time)
    track = on_ellipsoid(time, np.full_like(time, 20.0), still, still, 60.0, 10.0)
    arc = 100_000 / 6_390_000.0
    fall = 60.0 - math.degrees(math.asin(math.sin(math.radians(60)) * math.cos(arc)))
    turn = math.atan(math.tan(math.radians(60)) * math.sin(arc))

    assert pytest.approx(fall, rel=0.01) == 60.0 - track.latitude_deg[-1]
    assert pytest.approx(turn, rel=0.01) == -math.atan2(track.north_mps[-1], track.east_mps[-1])
    assert pytest.approx(20.0, rel=1e-12) == np.hypot(track.east_mps, track.north_mps)


def test_the_date_line_is_crossed() -> None:
    """Longitudes go from +180 on to -180."""
    time = np.arange(101.0)
    still = np.zeros_like(time)
    track = on_ellipsoid(time, np.full_like(time, 30.0), still, still, -17.0, 179.99)

    assert track.longitude_deg.max() <= 180.0
    assert -180.0 <= track.longitude_deg[-1] < -179.97


def test_angles_between_samples_are_interpolated() -> None:
    """At 20 m/s a wheel of 0.316 m has turned 0.025 s * 20 / 0.316 rad after 25 ms."""
    world = world_of(straight(20.0, 10.0))

    assert pytest.approx([0.025 * 20 / 0.316]) == world.angle_at(np.array([0.025]), RR)
    assert pytest.approx([0.025 * 20 / 0.316 * 48 / (2 * np.pi)]) == world.counts_at(np.array([0.025]), RR)
