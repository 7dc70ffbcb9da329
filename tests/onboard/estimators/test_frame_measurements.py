"""What the frame hears: each measurement can be switched off for all filters, and each is used by all."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.exact import exact
from tests.onboard.estimators.world import (
    METHODS,
    OFFSETS_M,
    VEHICLE,
    Drive,
    Receiver,
    World,
    errors_m,
    run,
    straight,
)
from tpmsd.car.config.model import MEASUREMENTS, FilterConfig, GnssConfig
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.estimators.build import build_filter
from tpmsd.onboard.estimators.frame_measurements import GyroBias
from tpmsd.onboard.estimators.radius_filter import RadiusFilter
from tpmsd.onboard.timeline.tick import Fix, Tick

EACH = pytest.mark.parametrize("method", METHODS)
BIAS_RADPS = 0.004
POSITIONS_ALONE = ("mpf-pn-paper",)


def filter_hearing(method: str, names: tuple[str, ...]) -> RadiusFilter:
    settings = FilterConfig(method=method, measurements=names)
    return build_filter(VEHICLE, GnssConfig(), settings, np.random.default_rng(1), True)


def without(name: str) -> tuple[str, ...]:
    return tuple(each for each in MEASUREMENTS if each != name)


def with_gyro(drive: Drive) -> list[Tick]:
    """The drive's ticks with a yaw rate that is the true one but for a bias."""
    heading = np.concatenate([[drive.pose[0, 2]], drive.pose[:, 2]])
    rates = np.diff(heading) / drive.world.dt_s + BIAS_RADPS
    return [replace(t, yaw_rate_radps=float(rate)) for t, rate in zip(drive.ticks, rates, strict=True)]


@pytest.fixture(scope="module")
def drive() -> Drive:
    return World(duration_s=60.0, steering=True).drive()


def fixes_less(field: str) -> Callable[[Tick], Tick]:
    return lambda t: replace(t, fixes=tuple(replace(f, **{field: math.nan}) for f in t.fixes))


BARE: dict[str, Callable[[Tick], Tick]] = {
    "speed": fixes_less("speed_mps"),
    "course": fixes_less("heading_rad"),
    "yaw_rate": lambda t: replace(t, yaw_rate_radps=math.nan),
    "steering": lambda t: replace(t, steering_wheel_angle_rad=math.nan),
}


@EACH
@pytest.mark.parametrize("name", BARE)
def test_what_is_switched_off_leaves_no_trace(method: str, name: str, drive: Drive) -> None:
    """A filter that does not hear a measurement says to the bit what it says of ticks that have none."""
    ticks = with_gyro(drive)
    deaf = run(filter_hearing(method, without(name)), ticks)
    bare = run(filter_hearing(method, MEASUREMENTS), [BARE[name](t) for t in ticks])
    assert exact(deaf) == exact(bare)


@EACH
def test_positions_that_are_switched_off_do_not_matter(method: str, drive: Drive) -> None:
    """With the pose found, positions kilometres away change nothing."""
    elsewhere = [
        replace(t, fixes=tuple(replace(f, east_m=f.east_m + 5e3) for f in t.fixes)) if k >= 50 else t
        for k, t in enumerate(drive.ticks)
    ]
    here, there = (run(filter_hearing(method, without("position")), t) for t in (drive.ticks, elsewhere))
    assert exact(here) == exact(there)
    assert math.isfinite(here[-1].east_m)


def common_mm(drive: Drive, estimates: list[RadiusEstimate]) -> float:
    return 1e3 * float(np.mean(errors_m(drive, estimates)[-1, 2:]))


@EACH
def test_speed_is_received_by_all(method: str) -> None:
    """Wheels 4 mm larger than nominal: a minute of Doppler speeds of 0.05 m/s with a memory of a second tells
    the common radius to 0.14 mm, and every filter knows it to 0.6 mm with positions switched off (MPF-MN,
    whose particles are too few for its states as in the paper, to 1.5 mm)."""
    if method in POSITIONS_ALONE:
        pytest.skip("it takes positions alone")
    world = World(duration_s=70.0, offsets_m=tuple(0.004 + each for each in OFFSETS_M), seed=3)
    drive = world.drive()
    assert abs(common_mm(drive, run(filter_hearing(method, ("speed", "course")), drive.ticks))) < (
        1.5 if method == "mpf-mn" else 0.6
    )


@EACH
def test_course_and_gyro_are_heard_by_all(method: str) -> None:
    """The rear pair 2 mm apart: course alone and gyro alone, with poor positions, tell left from right to
    0.5 mm within two minutes."""
    world = World(duration_s=120.0, receiver=Receiver(position_std_m=5.0), seed=5)
    drive = world.drive()
    if method in POSITIONS_ALONE:
        pytest.skip("it takes positions alone")
    ticks = with_gyro(drive)
    for name in ("course", "yaw_rate"):
        names = ("speed", "course", "yaw_rate") if name == "yaw_rate" else ("position", "speed", "course")
        error = 1e3 * errors_m(drive, run(filter_hearing(method, names), ticks))[-1]
        assert abs(error[2] - error[3]) < 0.5, name


def test_the_bias_is_that_of_gyro_against_course() -> None:
    """A gyro 4 mrad/s off, in bends: the bias is found to three of its standard deviations, which after five
    minutes are below 0.1 mrad/s; wheels have no part in it."""
    drive = World(duration_s=300.0).drive()
    bias = GyroBias()
    before = bias.std_radps
    for tick in with_gyro(drive):
        bias.update(replace(tick, rotation_rad=np.full(4, math.nan)))
    assert abs(bias.bias_radps - BIAS_RADPS) < 3.0 * bias.std_radps
    assert bias.std_radps < 1e-4 < before


def test_a_gap_is_not_summed_over() -> None:
    """Ten seconds of a turn that the gyro did not see are not taken for a bias."""

    def tick(k: int, course_rad: float, rate: float) -> Tick:
        fix = Fix(float(k), 1.0, 0.0, 0.0, 1.0, speed_mps=20.0, heading_rad=course_rad)
        return Tick(k, float(k), 1.0, np.full(4, 60.0), np.zeros(4), (fix,), yaw_rate_radps=rate)

    bias = GyroBias()
    for k in range(40):
        bias.update(tick(k, 0.0, 0.0))
    known = bias.bias_radps
    for k in range(40, 50):
        bias.update(tick(k, 0.1 * (k - 39), math.nan))
    for k in range(50, 60):
        bias.update(tick(k, 1.0, 0.0))
    assert bias.bias_radps == pytest.approx(known, abs=1e-9)


def test_the_gate_receives_what_the_filter_receives() -> None:
    """A soft rear tyre looks like a bend to the wheels: with courses the ticks stay informative, with courses
    switched off and positions as good the chords tell it."""
    world = World(duration_s=60.0, yaw_radps=straight, fault=(2, -0.03, 20.0))
    drive = world.drive()
    for names in (MEASUREMENTS, without("course")):
        estimates = run(filter_hearing("gaussian-sum", names), drive.ticks)
        assert sum(e.informative for e in estimates[300:]) > 250
