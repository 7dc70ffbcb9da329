"""The real van: its drives agree with each other."""

from __future__ import annotations

import math
from itertools import combinations
from pathlib import Path

import pytest

from tpmsd.car.config.load import load_config
from tpmsd.interfaces.cli.calibrate import read_recordings
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.calibration.calibrate import calibrate
from tpmsd.offline.calibration.result import EstimatedEffect, FittedGeometry
from tpmsd.offline.inference.recording import Recording


@pytest.fixture(scope="module")
def drives(recordings: Path) -> list[Recording]:
    return [
        read_recordings([recordings / f"van-{name}"], None)[0][0]
        for name in ("motorway-a", "motorway-b", "oval")
    ]


@pytest.fixture(scope="module")
def van(drives: list[Recording], recordings: Path) -> list[FittedGeometry]:
    vehicle = load_config(recordings / "van-oval").vehicle
    return [calibrate([drive], vehicle)[0] for drive in drives]


def off(one: FittedGeometry, other: FittedGeometry, wheel: str, growth: EstimatedEffect) -> float:
    """How far two radii are apart at the speed of the first, in standard deviations."""
    a, b = one.wheels[wheel], other.wheels[wheel]
    squares = one.reference_speed_mps**2 - other.reference_speed_mps**2
    std = math.hypot(a.radius_std_m, b.radius_std_m, growth.std * squares)
    return abs(a.radius_m - b.radius_m - growth.value * squares) / std


def test_drives_of_the_van_agree(
    van: list[FittedGeometry], drives: list[Recording], recordings: Path
) -> None:
    """Two motorway drives and the oval give one radius per wheel once growth with speed is taken out; all
    together know it better than a drive of about the same speed."""
    together, _ = calibrate(drives, load_config(recordings / "van-oval").vehicle)
    growth = together.effects["growth"]
    a, b, oval = van

    assert 3.0 < growth.value / growth.std
    for wheel in ("rl", "rr"):
        assert off(a, b, wheel, growth) < 2.0
        assert off(a, oval, wheel, growth) < 2.5
        assert off(b, oval, wheel, growth) < 2.5
        assert max(one.wheels[wheel].radius_std_m for one in van) < 0.25e-3
        assert together.wheels[wheel].radius_std_m < min(one.wheels[wheel].radius_std_m for one in (a, b))


def test_left_and_right_of_the_van_agree(van: list[FittedGeometry]) -> None:
    """What stands between the rear wheels is the same in every pair of drives, within what is stated."""
    for one, other in combinations(van, 2):
        apart = [found.wheels["rr"].radius_m - found.wheels["rl"].radius_m for found in (one, other)]
        assert abs(apart[0] - apart[1]) < 2.0 * math.hypot(one.difference_std_m, other.difference_std_m)


def test_the_track_and_load_transfer_of_the_van(van: list[FittedGeometry]) -> None:
    """All drives show the same track, both motorway drives the same load transfer, of a plausible size."""
    a, b, oval = van
    load_a, load_b = a.effects["load_lateral"], b.effects["load_lateral"]

    for one, other in combinations((a, b, oval), 2):
        apart = abs(one.track_rear_m - other.track_rear_m)
        assert apart < 2.0 * math.hypot(one.track_rear_std_m, other.track_rear_std_m)
    assert abs(load_a.value - load_b.value) < 2.0 * math.hypot(load_a.std, load_b.std)
    assert 1e-4 < load_a.value < 4e-4


def test_a_minute_straight_on_is_refused(recordings: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The RAV4's minute holds no bend: exit code 3, one line."""
    assert 3 == main(["calibrate", str(recordings / "rav4-suburb-60s")])
    assert 1 == len(capsys.readouterr().err.strip().splitlines())
