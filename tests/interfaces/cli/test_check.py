"""`tpmsd check`: the verdict stands first, and scripts can ask for its strictest form."""

from __future__ import annotations

from pathlib import Path

import pytest

from tpmsd.interfaces.cli.main import main
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five minutes with bends."""
    folder = tmp_path_factory.mktemp("drives") / "monday"
    write_drive(folder, simulate_drive(DriveSpec(duration_s=300.0, seed=4)))
    return folder


def swapped(drive: Path, folder: Path) -> Path:
    """The drive's configuration with the rear wheels exchanged."""
    text = (drive / "vehicle.toml").read_text("utf-8").replace('"bus.dbc"', f'"{drive / "bus.dbc"}"')
    left, right = (
        next(line.split("=")[1] for line in text.splitlines() if line.startswith(f"wheel_count_{wheel} "))
        for wheel in ("rl", "rr")
    )
    text = text.replace(left, "LEFT").replace(right, left).replace("LEFT", right)
    file = folder / "vehicle.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_a_contradiction_is_the_first_line_and_strict_makes_it_an_error(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The verdict comes before the plan; without --strict a suspicion leaves the exit code at 0."""
    file = swapped(drive, tmp_path)
    codes = [main(["check", str(file), "--drive", str(drive), *more]) for more in ([], ["--strict"])]

    lines = capsys.readouterr().out.splitlines()
    assert [0, 2] == codes
    assert lines[0].startswith(f"{file}: the drive {drive} contradicts ")
    assert any("swapped_left_right" in line for line in lines[1 : lines.index("It would monitor:")])


def test_a_configuration_that_fits_is_no_error_under_strict(
    drive: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The drive's own configuration has neither warning nor suspicion."""
    assert 0 == main(["check", "--drive", str(drive), "--strict"])

    first, second, *_ = capsys.readouterr().out.splitlines()
    assert first.startswith(f"{drive / 'vehicle.toml'}: nothing wrong in the file itself and ")
    assert f"Nothing in the drive {drive} contradicts it." == second


def test_a_warning_is_an_error_under_strict(drive: Path, tmp_path: Path) -> None:
    """A configuration without the teeth per revolution is warned of."""
    text = (drive / "vehicle.toml").read_text("utf-8").replace('"bus.dbc"', f'"{drive / "bus.dbc"}"')
    file = tmp_path / "vehicle.toml"
    file.write_text("\n".join(line for line in text.splitlines() if "teeth_per_rev" not in line), "utf-8")

    assert [0, 2] == [main(["check", str(file), *more]) for more in ([], ["--strict"])]
