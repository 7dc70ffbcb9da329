"""The Python face: light to import, equal to the commands, typed, and showing itself."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import tpmsd
from tests.interfaces.api.conftest import FAULT
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.tables.columns import COLUMNS

REPO = Path(__file__).resolve().parents[3]
CORE = ("numpy", "scipy", "can", "cantools")
EXTRAS = ("pandas", "pyarrow", "matplotlib", "dask", "distributed", "duckdb", "mcap", "h5py", "fsspec")


def test_the_import_is_light() -> None:
    """`import tpmsd` takes at most 0.15 s of CPU time and loads no package beyond the standard library."""
    code = (
        "import sys, time; begun = time.process_time(); import tpmsd; dir(tpmsd);"
        f"print(time.process_time() - begun, *[name for name in {CORE + EXTRAS!r} if name in sys.modules])"
    )
    taken, *loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()

    assert [] == loaded
    assert float(taken) <= 0.15


def test_the_daemon_loads_no_extra() -> None:
    """The daemon's modules load none of the packages of tables and fleets."""
    # python-can itself loads asammdf, and so pandas, where it is installed.
    code = (
        "import sys; sys.modules['asammdf'] = None;"
        "import tpmsd.interfaces.cli.run, tpmsd.onboard.daemon.loop, tpmsd.onboard.pipeline;"
        f"print(*[name for name in {EXTRAS!r} if name in sys.modules])"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout

    assert "\n" == loaded


def test_public_names_are_there() -> None:
    """Every name of `__all__` can be had, and another is an AttributeError."""
    assert [] == [name for name in tpmsd.__all__ if getattr(tpmsd, name, None) is None]
    with pytest.raises(AttributeError, match="no attribute 'fly'"):
        tpmsd.fly  # noqa: B018


def test_a_replay_equals_the_command(folder: Path, replay: tpmsd.Replay, tmp_path: Path) -> None:
    """`to_dict()` is the JSON of `tpmsd replay`, apart from the speed of the computer."""
    assert 0 == main(["replay", str(folder), "--json", str(tmp_path / "replay.json")])
    expected = json.loads((tmp_path / "replay.json").read_text())
    actual = json.loads(json.dumps(replay.to_dict()))

    for document in (expected, actual):
        assert document.pop("realtime_factor") > 0.0
    assert expected == actual
    assert {"rl"} == {alarm.wheel for alarm in replay.alarms}


def test_a_simulated_drive_is_that_of_the_folder(replay: tpmsd.Replay) -> None:
    """`simulate` in memory replays to the very numbers of the drive that was written and read."""
    drive = tpmsd.simulate(duration_s=160.0, seed=3, faults=(FAULT,))
    again = tpmsd.replay(drive, table=False)

    assert again.table is None
    for name in ("deviation_m", "std_m", "speed_mps"):
        expected, actual = getattr(replay.result, name), getattr(again.result, name)
        np.testing.assert_array_equal(expected, actual)
    assert replay.alarms == again.alarms


def test_diagnosis_and_calibration_equal_the_commands(tmp_path: Path) -> None:
    """`to_dict()` of both is the JSON of the command; a refused calibration is an InputError."""
    drive = tpmsd.simulate(duration_s=150.0, seed=5, route="rural")
    saved = drive.save(tmp_path / drive.name)
    files = {name: tmp_path / f"{name}.json" for name in ("diagnose", "calibrate")}
    assert 0 == main(["diagnose", str(saved), "--json", str(files["diagnose"])])
    assert 0 == main(["calibrate", str(saved), "--json", str(files["calibrate"])])

    diagnosis, calibration = tpmsd.diagnose(saved), tpmsd.calibrate([saved])
    expected = json.loads(files["diagnose"].read_text())
    assert {**expected, "model_file": None} == json.loads(json.dumps(diagnosis.to_dict()))
    assert json.loads(files["calibrate"].read_text()) == json.loads(json.dumps(calibration.to_dict()))
    assert {"fl", "fr", "rl", "rr"} == set(calibration.to_pandas()["wheel"])
    assert len(diagnosis.to_pandas()) >= len(diagnosis.findings)
    for shown in (diagnosis, calibration):
        axes = Figure().subplots()
        assert axes is shown.plot(axes)
        assert "<p><b>" in shown._repr_html_()
    axes = Figure().subplots()
    calibration.plot(axes)
    assert ["configured"] == [one.get_text() for one in axes.get_legend().get_texts()]
    with pytest.raises(tpmsd.InputError, match="cannot be calibrated from"):
        tpmsd.calibrate(tpmsd.simulate(duration_s=10.0))


def test_a_diagnosis_without_findings_is_drawn_as_a_sentence() -> None:
    """No empty frame: the reason stands where the bars would."""
    axes = Figure().subplots()
    tpmsd.diagnose(tpmsd.simulate(duration_s=20.0, seed=3)).plot(axes)

    assert [] == list(axes.patches)
    assert 1 == len(axes.texts) and len(axes.texts[0].get_text()) > 20
    assert not axes.get_frame_on()


def test_the_tick_table_is_documented(replay: tpmsd.Replay) -> None:
    """The data frame has the documented columns in order, and ends with the report's deviations."""
    frame = replay.to_pandas()

    assert [column.name for column in COLUMNS] == list(frame.columns)
    for wheel in WHEELS:
        expected = replay.to_dict()["wheels"][wheel]["deviation_mm"]
        assert expected == pytest.approx(1e3 * frame[f"deviation_{wheel}_m"].iloc[-1], abs=1e-6)
        assert replay.wheels[wheel].state == frame[f"state_{wheel}"].iloc[-1]
    assert frame["alarms"].iloc[-1].split()[0] == "deflation:rl"


def test_a_replay_shows_itself(replay: tpmsd.Replay) -> None:
    """The plot has a line and a band per wheel, names the alarm, and not flattened by the first seconds."""
    axes = Figure().subplots()

    assert axes is replay.plot(axes)
    assert "deflation RL" in {text.get_text() for text in axes.texts}
    highest_mm = 1e3 * float(np.nanmax(replay.result.deviation_m + 2.0 * replay.result.std_m))
    assert axes.get_ylim()[1] < highest_mm
    assert list(WHEELS) == [text.get_text() for text in axes.get_legend().get_texts()]
    assert 4 == len(axes.collections)
    assert "<td>deflation</td><td>rl</td>" in replay._repr_html_()


CLIENT = """
import tpmsd

def soft(folder: str) -> list[str]:
    drive: tpmsd.Drive = tpmsd.load(folder)
    replay = tpmsd.replay(drive)
    names: list[str] = [alarm.wheel for alarm in replay.alarms if alarm.wheel is not None]
    radii: dict[str, float] = tpmsd.calibrate([drive]).radii_m
    return names + list(radii) + [finding.effect for finding in tpmsd.diagnose(drive).findings]
"""


def test_a_client_program_is_typed(tmp_path: Path) -> None:
    """A small program against the package passes `mypy --strict`, and a wrong type in it does not."""
    (tmp_path / "right.py").write_text(CLIENT)
    (tmp_path / "wrong.py").write_text(CLIENT.replace("dict[str, float]", "dict[str, str]"))
    command = [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", "right.py", "wrong.py"]
    # What `make lint` worked out before is used again, where it has run.
    command += ["--config-file", str(REPO / "pyproject.toml"), "--cache-dir", str(REPO / ".mypy_cache")]
    # An editable install is found by an import hook, which mypy does not run.
    environment = os.environ | {"MYPYPATH": str(REPO)}
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=environment)

    assert ["wrong.py:8"] == [line.partition(": ")[0] for line in done.stdout.splitlines() if "error" in line]


@pytest.mark.parametrize(
    ("call", "reason"),
    [
        (lambda: tpmsd.load("nowhere"), "nowhere: no such drive folder"),
        (lambda: tpmsd.diagnose([]), "no drive"),
        (lambda: tpmsd.simulate(wings=2), "unexpected keyword argument 'wings'"),
        (lambda: tpmsd.calibrate(tpmsd.simulate(duration_s=10.0), method="magic"), "no such method: 'magic'"),
        (lambda: tpmsd.replay(tpmsd.simulate(duration_s=10.0), seed=-1), "a seed is 0 or more"),
    ],
)
def test_wrong_use_is_reported_in_one_line(call: object, reason: str) -> None:
    """What a user can do wrong is a TpmsdError of one line with the reason."""
    with pytest.raises(tpmsd.TpmsdError) as error:
        call()  # type: ignore[operator]

    assert reason in str(error.value)
    assert 1 == len(str(error.value).splitlines())
