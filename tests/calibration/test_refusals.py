"""Drives from which a calibration cannot be had are refused for the right reason."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.calibration.drives import recorded
from tpmsd.calibration.checks import RefusedError, check_recordings
from tpmsd.calibration.nominal import Vehicle, vehicle_of
from tpmsd.calibration.recording import Recording, record
from tpmsd.cli.main import main
from tpmsd.physics.motion import Motion
from tpmsd.simulator.drive import DEFAULT_VEHICLE, DriveSpec, simulate_drive
from tpmsd.simulator.drive_writer import write_drive

NAN = math.nan


def motion(speed_mps: float, yaw_radps: Callable[[np.ndarray], np.ndarray], duration_s: float) -> Motion:
    time_s = np.arange(round(100 * duration_s) + 1) / 100.0
    speed = speed_mps * np.clip(time_s / 5.0, 0.0, 1.0)
    return Motion.from_profiles(time_s, speed, yaw_radps(time_s) * speed / speed_mps, wheelbase_m=2.63)


def waves(time_s: np.ndarray) -> np.ndarray:
    return np.where(np.sin(time_s / 8.0) > 0.4, 0.12, 0.0)


@pytest.fixture(scope="module")
def usable(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, Vehicle]:
    folder = tmp_path_factory.mktemp("drives") / "usable"
    recording, config = recorded(folder, DriveSpec(), motion(15.0, waves, 90.0))
    return recording, vehicle_of(config.vehicle)


def test_a_usable_drive_passes(usable: tuple[Recording, Vehicle]) -> None:
    """A minute and a half with straights and bends is enough to be tried."""
    check_recordings([usable[0]], usable[1])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda r: {"rotation_rad": r.rotation_rad * [1, 1, NAN, 1]}, "no readings of wheel rl"),
        (lambda r: {"east_m": r.east_m * NAN}, "no position fixes"),
        (lambda r: {"rotation_rad": r.rotation_rad[:300]}, "too short: [0-9]+ s of driving"),
        (lambda r: {"rotation_rad": r.rotation_rad * 0.01}, "too short: 0 s of driving"),
        (lambda r: {"east_m": np.where(np.arange(len(r.east_m)) < 20, r.east_m, NAN)}, "too few fixes: 20"),
        (lambda r: {"east_m": np.where(r.fix_time_s < 20.0, r.east_m, NAN)}, "too few fixes: .*near 2[0-9]%"),
    ],
)
def test_what_needs_no_fit_to_be_seen(
    usable: tuple[Recording, Vehicle], change: Callable[[Recording], dict[str, object]], reason: str
) -> None:
    """Missing wheels, missing fixes and too little driving are named, with what is there."""
    recording = dataclasses.replace(usable[0], **change(usable[0]))  # type: ignore[arg-type]

    with pytest.raises(RefusedError, match=reason) as refusal:
        check_recordings([usable[0], recording], usable[1])
    assert 1 == refusal.value.drive


@pytest.mark.parametrize(
    ("yaw", "reason"),
    [
        (lambda t: np.full_like(t, 0.15), "never straight"),
        (lambda t: np.zeros_like(t), "never turning"),
    ],
)
def test_straights_and_bends_are_needed(
    tmp_path: Path, yaw: Callable[[np.ndarray], np.ndarray], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A drive in circles or along one line is refused with exit code 3 and one line that names it."""
    folder = write_drive(tmp_path / "d", simulate_drive(DriveSpec(flat=True), motion(15.0, yaw, 70.0)))

    code = main(["calibrate", str(folder)])
    lines = capsys.readouterr().err.strip().splitlines()

    assert 3 == code
    assert 1 == len(lines)
    assert lines[0].startswith(f"tpmsd: {folder}: cannot be calibrated from: {reason}")


def test_a_drive_without_ticks_is_no_drive() -> None:
    """Nothing in, a clear reason out."""
    config = type("Config", (), {"vehicle": DEFAULT_VEHICLE})()

    with pytest.raises(ValueError, match="no readings of bus and receiver"):
        record("d", [], config)


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (["nowhere"], 3, "nowhere: no such drive folder"),
        (["nowhere", "--method", "magic"], 2, "no such method: 'magic' (methods: joint paper)"),
        (["nowhere", "--plot", "p.txt"], 2, "p.txt: a plot ends in .png, .svg, .pdf, not in '.txt'"),
    ],
)
def test_wrong_usage_is_one_line(
    arguments: list[str], code: int, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is wrong with the command line is said before any work is done."""
    assert code == main(["calibrate", *arguments])
    assert f"tpmsd: {says}\n" == capsys.readouterr().err
