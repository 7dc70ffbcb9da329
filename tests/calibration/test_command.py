"""The command from end to end: what it prints and writes, and that the other commands take it."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from tpmsd.cli.main import main
from tpmsd.config.load import load_config
from tpmsd.simulator.bus import BusSpec
from tpmsd.simulator.drive import DriveSpec, simulate_drive
from tpmsd.simulator.drive_writer import write_drive


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    spec = DriveSpec(
        route="city", duration_s=180.0, seed=3, bus=BusSpec(wheels=2), radius_offset_m=(0, 0, 2e-3, -1e-3)
    )
    return write_drive(tmp_path_factory.mktemp("drives") / "town", simulate_drive(spec))


def test_the_written_calibration_is_a_configuration(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """--write gives a vehicle.toml that loads, with the radii of the report and all else as it was."""
    (tmp_path / "etc").mkdir()
    target, report = tmp_path / "etc" / "vehicle.toml", tmp_path / "report.json"

    assert 0 == main(["calibrate", str(folder), "--write", str(target), "--json", str(report)])
    printed = capsys.readouterr().out
    found = json.loads(report.read_text())
    before, after = load_config(folder), load_config(target)

    assert ["rl", "rr"] == list(found["wheels"])
    assert [found["wheels"][w]["radius_m"] for w in ("rl", "rr")] == pytest.approx(
        after.vehicle.wheel_radius_m[2:], abs=1e-6
    )
    assert before.vehicle.wheel_radius_m[:2] == after.vehicle.wheel_radius_m[:2]
    assert [0.318, 0.315] == pytest.approx(after.vehicle.wheel_radius_m[2:], abs=5e-4)
    assert found["track_rear_m"] == pytest.approx(after.vehicle.track_rear_m, abs=1e-4)
    assert (before.can.dbc.resolve(), before.can.signals) == (after.can.dbc.resolve(), after.can.signals)
    assert ("joint", "town") == (after.calibration.method, after.calibration.drives)
    rl = found["wheels"]["rl"]
    assert 2 * math.pi * rl["radius_m"] == pytest.approx(rl["circumference_m"])
    assert 2 * math.pi * rl["radius_std_m"] == pytest.approx(rl["circumference_std_m"])
    assert found["pose_error_m"]["after"] < 0.2 * found["pose_error_m"]["before"]
    assert len(found["history"]) == found["iterations"]
    assert f"{rl['circumference_m'] * 1e3:.1f} +- {rl['circumference_std_m'] * 1e3:.2f} mm" in printed
    assert found["stopped_because"] in printed


def test_replay_takes_the_calibration(folder: Path, tmp_path: Path) -> None:
    """With its own calibration the drive replays to deviations of tenths of a millimetre."""
    target, report = tmp_path / "vehicle.toml", tmp_path / "replay.json"
    main(["calibrate", str(folder), "--write", str(target), "--json", str(tmp_path / "c.json")])

    assert 0 == main(["replay", str(folder), "--config", str(target), "--json", str(report)])
    wheels = json.loads(report.read_text())["wheels"]

    assert max(abs(wheels[w]["deviation_mm"]) for w in ("rl", "rr")) < 0.6


def test_the_paper_method_and_a_picture(folder: Path, tmp_path: Path) -> None:
    """--method paper gives the rear circumferences within a millimetre; the picture is a PNG."""
    report, picture = tmp_path / "c.json", tmp_path / "c.png"

    assert 0 == main(
        ["calibrate", str(folder), "--method", "paper", "--json", str(report), "--plot", str(picture)]
    )
    found = json.loads(report.read_text())

    assert "paper" == found["method"]
    assert [0.318, 0.315] == pytest.approx([found["wheels"][w]["radius_m"] for w in ("rl", "rr")], abs=1.5e-3)
    assert found["track_rear_std_m"] is None
    assert b"\x89PNG" == picture.read_bytes()[:4]


def test_drives_of_different_cars_do_not_mix(folder: Path, tmp_path: Path) -> None:
    """Two drives whose [vehicle] tables differ are refused unless one configuration is given for both."""
    other = tmp_path / "other"
    other.mkdir()
    for file in folder.iterdir():
        (other / file.name).write_bytes(file.read_bytes())
    text = (other / "vehicle.toml").read_text()
    (other / "vehicle.toml").write_text(text.replace("wheelbase_m = 2.63", "wheelbase_m = 2.9"))

    assert 3 == main(["calibrate", str(folder), str(other)])
