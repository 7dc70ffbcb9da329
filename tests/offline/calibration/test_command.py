"""The command from end to end: what it prints and writes, and that the other commands take it."""

from __future__ import annotations

import contextlib
import io
import json
import math
import re
import shutil
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tpmsd.car.config.load import load_config
from tpmsd.interfaces.cli.main import main


class Written(NamedTuple):
    """One run of the command with all that it writes."""

    vehicle: Path
    report: dict[str, Any]
    picture: Path
    printed: str
    notes: str


@pytest.fixture(scope="module")
def written(town: Path, tmp_path_factory: pytest.TempPathFactory) -> Written:
    folder = tmp_path_factory.mktemp("etc")
    target, report, picture = (folder / name for name in ("vehicle.toml", "report.json", "picture.png"))
    out, err = io.StringIO(), io.StringIO()
    arguments = ["calibrate", str(town), "--write", str(target), "--json", str(report)]
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        assert 0 == main([*arguments, "--plot", str(picture)])
    return Written(target, json.loads(report.read_text()), picture, out.getvalue(), err.getvalue())


def test_the_written_calibration_is_a_configuration(town: Path, written: Written) -> None:
    """--write gives a vehicle.toml that loads, with the radii of the report and all else as it was."""
    found = written.report
    before, after = load_config(town), load_config(written.vehicle)

    assert ["rl", "rr"] == list(found["wheels"])
    assert [found["wheels"][w]["radius_m"] for w in ("rl", "rr")] == pytest.approx(
        after.vehicle.wheel_radius_m[2:], abs=1e-6
    )
    assert before.vehicle.wheel_radius_m[:2] == after.vehicle.wheel_radius_m[:2]
    assert [0.318, 0.315] == pytest.approx(after.vehicle.wheel_radius_m[2:], abs=5e-4)
    assert found["track_rear_m"] == pytest.approx(after.vehicle.track_rear_m, abs=1e-4)
    assert (before.can.dbc.resolve(), before.can.signals) == (after.can.dbc.resolve(), after.can.signals)
    assert (before.state, before.status) == (after.state, after.status)
    assert "# a note of the operator" in written.vehicle.read_text()
    assert ("joint", "town") == (after.calibration.method, after.calibration.drives)


def test_what_is_printed_is_what_is_reported(written: Written) -> None:
    """Circumference, radius, standard deviations, track, iterations, why it stopped, pose error."""
    found = written.report
    rl = found["wheels"]["rl"]

    assert 2 * math.pi * rl["radius_m"] == pytest.approx(rl["circumference_m"])
    assert 2 * math.pi * rl["radius_std_m"] == pytest.approx(rl["circumference_std_m"])
    assert found["pose_error_m"]["after"] < 0.2 * found["pose_error_m"]["before"]
    assert len(found["history"]) == found["iterations"]
    assert f"{rl['circumference_m'] * 1e3:.1f} +- {rl['circumference_std_m'] * 1e3:.2f} mm" in written.printed
    assert f"{found['track_rear_m']:.3f} +- {found['track_rear_std_m']:.3f} m" in written.printed
    assert f"{found['iterations']} iterations; stopped because {found['stopped_because']}" in written.printed
    assert f"{found['pose_error_m']['after']:.2f} m after" in written.printed
    assert b"\x89PNG" == written.picture.read_bytes()[:4]
    assert "" == written.notes


def test_replay_takes_the_calibration(town: Path, written: Written, tmp_path: Path) -> None:
    """With its own calibration the drive replays to deviations of tenths of a millimetre from it."""
    report = tmp_path / "replay.json"

    assert 0 == main(["replay", str(town), "--config", str(written.vehicle), "--json", str(report)])
    wheels = json.loads(report.read_text())["wheels"]

    assert max(abs(wheels[w]["deviation_mm"]) for w in ("rl", "rr")) < 0.6


def test_diagnose_takes_the_calibration(town: Path, written: Written, tmp_path: Path) -> None:
    """The diagnosis starts from the calibrated radii, and finds no wheel that changed."""
    report = tmp_path / "diagnosis.json"
    arguments = ["diagnose", str(town), "--config", str(written.vehicle), "--json", str(report)]

    code = main([*arguments, "--model-out", str(tmp_path / "model.toml")])
    found = json.loads(report.read_text())
    assert (3 if found["verdict"] == "insufficient_data" else 0) == code

    assert found["verdict"] in ("consistent", "insufficient_data", "mismatch")
    assert [] == [f for f in found["findings"] if f["effect"] == "radius_change"]


def test_run_and_check_take_the_calibration(written: Written, tmp_path: Path) -> None:
    """The daemon runs with the calibrated car, and its recording holds the calibration on."""
    arguments = ["run", "--config", str(written.vehicle), "--interface", "virtual", "--channel", "calibrated"]
    arguments += ["--device", "", "--record", str(tmp_path / "drive"), "--speed-up", "20", "--duration", "4"]

    assert 0 == main(["check", str(written.vehicle)])
    assert 0 == main(arguments)
    ran, given = load_config(tmp_path / "drive"), load_config(written.vehicle)
    assert (given.vehicle, given.calibration) == (ran.vehicle, ran.calibration)


def test_writing_into_a_configuration_that_exists(town: Path, tmp_path: Path) -> None:
    """Radii and track are replaced in it; its own DBC, tables, keys and comments stay."""
    target = tmp_path / "tpmsd.toml"
    shutil.copy(town / "bus.dbc", tmp_path / "mine.dbc")
    text = (town / "vehicle.toml").read_text().replace("bus.dbc", "mine.dbc")
    target.write_text("# the van of the works\n" + text + "\n[monitor]\nlearn_s = 33.0  # soon\n")
    other = [
        line for line in target.read_text().splitlines() if "radius" not in line and "rear_m" not in line
    ]

    before = target.read_text()
    assert 0 == main(["calibrate", str(town), "--method", "paper", "--write", str(target)])
    config = load_config(target)
    assert before == (tmp_path / "tpmsd.toml.bak").read_text()

    assert [] == [line for line in other if line not in target.read_text().splitlines()]
    assert ("mine.dbc", 33.0) == (config.can.dbc.name, config.monitor.learn_s)
    assert ("paper", 1.52) == (config.calibration.method, config.vehicle.track_rear_m)
    assert [0.318, 0.315] == pytest.approx(config.vehicle.wheel_radius_m[2:], abs=1.5e-3)


def test_a_radius_that_no_tyre_has_is_refused_and_nothing_is_written(
    town: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With a third of the true teeth the radii come out at a third: one line, the configuration untouched."""
    target = tmp_path / "vehicle.toml"
    text = (town / "vehicle.toml").read_text().replace('dbc = "bus.dbc"', f'dbc = "{town / "bus.dbc"}"')
    wrong = re.sub(r"teeth_per_rev = (\d+)", lambda found: f"teeth_per_rev = {int(found[1]) * 3}", text)
    target.write_text(wrong)

    for write in ([], ["--write", str(target)]):
        assert 3 == main(["calibrate", str(town), "--config", str(target), *write])
        assert 1 == len(capsys.readouterr().err.strip().splitlines())
    assert wrong == target.read_text()
    assert ["vehicle.toml"] == [path.name for path in tmp_path.iterdir()]


def test_drives_of_different_cars_do_not_mix(town: Path, tmp_path: Path) -> None:
    """Two drives whose [vehicle] tables differ are refused unless one configuration is given for both."""
    other = tmp_path / "other"
    shutil.copytree(town, other)
    text = (other / "vehicle.toml").read_text()
    (other / "vehicle.toml").write_text(text.replace("wheelbase_m = 2.63", "wheelbase_m = 2.9"))

    assert 3 == main(["calibrate", str(town), str(other)])


def test_the_help_explains(capsys: pytest.CaptureFixture[str]) -> None:
    """It names every option, shows examples and says what the exit codes are."""
    assert 0 == main(["calibrate", "--help"])
    text = capsys.readouterr().out

    assert [] == [o for o in ("--config", "--method", "--write", "--plot", "--json") if o not in text]
    assert "examples:" in text
    assert "exit codes:" in text
