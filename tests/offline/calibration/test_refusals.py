"""Drives from which a calibration cannot be had are refused for the right reason."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.calibration.drives import configured, recorded, recording_of
from tpmsd.car.physics.motion import Motion
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.calibration.calibrate import calibrate
from tpmsd.offline.calibration.checks import RefusedError, check_recordings
from tpmsd.offline.calibration.nominal import Vehicle, vehicle_of
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive

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


LOSS_M = 0.0046 * 0.31
"""Of radius: a fifth of the pressure."""


def loses(*wheels: str) -> dict[str, dict[str, object]]:
    """Physics of a world in which these wheels lose pressure from the 40th to the 110th second."""
    change = {"deviation_m": -LOSS_M, "onset_s": 40.0, "duration_s": 70.0}
    return {f"radius_change{n}": {"wheel": w, **change} for n, w in zip(("", "_2"), wheels, strict=False)}


# Tyres that go flat together: far on the way of an exponential that has an end.
ALL_FOUR: dict[str, dict[str, object]] = {
    "thermal_growth": {"amplitude_m": -1.58 * LOSS_M, "time_constant_s": 240.0}
}


@pytest.mark.parametrize(
    ("physics", "wheels", "says"),
    [
        (loses("fl"), 4, "the radius of wheel fl changes by -"),
        (loses("fr"), 4, "the radius of wheel fr changes by -"),
        (loses("rl"), 4, "the radius of wheel rl changes by -"),
        (loses("rr"), 2, "the radius of wheel rr changes by -"),
        (ALL_FOUR, 4, "the radii of all wheels change by -"),
        (ALL_FOUR, 2, "the radii of all wheels change by -"),
    ],
)
def test_tyres_that_lose_pressure_are_refused(
    physics: dict[str, dict[str, object]], wheels: int, says: str
) -> None:
    """A drive on which any one tyre loses pressure is refused, the wheel named; and so if all of them do."""
    # Wheels are held against each other far more closely than all of them against the receiver.
    duration_s = 240.0 if physics is ALL_FOUR else 150.0
    spec = Spec(duration_s=duration_s, road="mixed", physics=physics)
    recording = recording_of(drive(spec, 3), wheels=wheels)

    with pytest.raises(RefusedError, match=f"{says}.*a tyre that loses pressure") as refusal:
        calibrate([recording], configured(spec))
    assert 0 == refusal.value.drive


def test_tyres_that_warm_up_are_no_fault() -> None:
    """Half a millimetre of growth by warmth on all wheels is not taken for a loss of pressure."""
    warm = {"thermal_growth": {"amplitude_m": 5e-4, "time_constant_s": 300.0}}
    spec = Spec(duration_s=150.0, road="mixed", physics=warm)
    found, _ = calibrate([recording_of(drive(spec, 3), wheels=2)], configured(spec))

    assert ["rl", "rr"] == list(found.wheels)


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (["nowhere"], 3, "nowhere: no such drive folder"),
        (["nowhere", "--method", "magic"], 2, "no such method: 'magic' (methods: joint paper)"),
        (["nowhere", "--plot", "p.txt"], 2, "p.txt: a plot ends in .png, .svg, .pdf, not in '.txt'"),
        (["nowhere", "--write", "/"], 1, "--write /: a folder; the name of a file is wanted"),
        (["nowhere", "--write", "none/v.toml"], 1, "--write none/v.toml: there is no folder none"),
    ],
)
def test_wrong_usage_is_one_line(
    arguments: list[str], code: int, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is wrong with the command line is said before any work is done."""
    assert code == main(["calibrate", *arguments])
    assert f"tpmsd: {says}\n" == capsys.readouterr().err
