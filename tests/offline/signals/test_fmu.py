"""An FMU as simulation: its outputs against the closed form it computes, and archives that are none."""

from __future__ import annotations

import json
import os
import stat
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.offline.dynamics.drives import folder as signals_folder
from tests.offline.dynamics.drives import hidden, loaded
from tpmsd.foundation.errors import ConfigError, InputError
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.dynamics import stages
from tpmsd.offline.signals import fmu
from tpmsd.offline.signals.fmu import fmu_table, unpack
from tpmsd.offline.signals.read import read_signals

MODEL = '''
import math, time
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class {name}(Fmi2Slave):
    """Steady cornering of a car without slip: yaw rate = speed * steer / wheelbase."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.road_wheel_angle_rad = 0.0
        self.speed_mps = 0.0
        self.yaw_rate_radps = 0.0
        self.accel_lat_mps2 = 0.0
        for name in {inputs}:
            setattr(self, name, 0.0)
            self.register_variable(Real(name, causality=Fmi2Causality.input, start=0.0))
        for name in {outputs}:
            setattr(self, name, 0.0)
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        {body}
        self.yaw_rate_radps = self.speed_mps * math.tan(self.road_wheel_angle_rad) / 2.7
        self.accel_lat_mps2 = self.speed_mps * self.yaw_rate_radps
        return True
'''
CLOCK = """        self.time = 0.0
        continuous = Fmi3Variability.continuous
        self.register_variable(
            Float64("time", causality=Fmi3Causality.independent, variability=continuous)
        )
"""
INPUTS, OUTPUTS = ["road_wheel_angle_rad", "speed_mps"], ["yaw_rate_radps", "accel_lat_mps2"]


def need_fmpy() -> None:
    pytest.importorskip("fmpy", reason="fmpy is not installed: it runs the FMU")


def built(
    where: Path,
    name: str,
    inputs: list[str] = INPUTS,
    outputs: list[str] = OUTPUTS,
    body: str = "pass",
    standard: str = "pythonfmu",
) -> Path:
    """An FMU made by pythonfmu (FMI 2) or pythonfmu3 (FMI 3)."""
    need_fmpy()
    pytest.importorskip(standard, reason=f"{standard} is not installed: it makes the FMU of these tests")
    where.mkdir(parents=True, exist_ok=True)
    script = where / f"{name.lower()}.py"
    text = MODEL.format(name=name, inputs=inputs, outputs=outputs, body=body)
    if standard == "pythonfmu3":
        text = text.replace("pythonfmu", "pythonfmu3").replace("Fmi2", "Fmi3").replace("Real", "Float64")
        text = text.replace("        for name in", CLOCK + "        for name in", 1)
    script.write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", standard, "build", "-f", str(script), "-d", str(where)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return where / f"{name}.fmu"


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return signals_folder(tmp_path_factory.mktemp("fmu") / "drive", hidden(), duration_s=30.0)


@pytest.fixture(scope="module")
def cornering(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(tmp_path_factory.mktemp("built"), "Cornering")


@pytest.mark.parametrize("standard", ["pythonfmu", "pythonfmu3"])
def test_the_outputs_are_those_of_the_recording_s_inputs(drive: Path, tmp_path: Path, standard: str) -> None:
    """FMI 2 and 3: speed times tan(steer) over the wheelbase, a communication step of 5 ms late as inputs
    are held over it."""
    made = built(tmp_path, "Cornering", standard=standard)
    _, recorded = loaded(drive, "single-track")
    table = fmu_table(made, drive, recorded)
    given = recorded.inputs
    late = recorded.time_s[1:] - 0.005
    speed, steer = (np.interp(late, recorded.time_s, one) for one in (given.speed_mps, given.steer_rad))
    yaw = speed * np.tan(steer) / 2.7
    assert set(table.columns) == {"time_s", *OUTPUTS}
    assert table.time_s == pytest.approx(recorded.time_s + recorded.start_s)
    assert table.columns["yaw_rate_radps"][1:] == pytest.approx(yaw, abs=1e-6)
    assert table.columns["accel_lat_mps2"][1:] == pytest.approx(speed * yaw, abs=1e-5)


def test_a_diagnosis_runs_it(
    drive: Path, cornering: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`diagnose --baseline single-track --simulation MODEL.fmu` compares its outputs with the recording, as
    it compares a folder with the same outputs; what it would name is no matter here."""
    monkeypatch.setattr(stages, "SETTINGS", replace(stages.SETTINGS, max_effects=0))
    reported = {}
    _, recorded = loaded(drive, "single-track")
    table = fmu_table(cornering, drive, recorded)
    from tpmsd.offline.signals.write import signals_text

    same = tmp_path / "same"
    same.mkdir()
    (same / "signals.csv").write_text(signals_text(dict(table.columns)))
    for simulation in (cornering, same):
        file = tmp_path / "said.json"
        line = ["diagnose", str(drive), "--baseline", "single-track", "--simulation", str(simulation)]
        assert main([*line, "--json", str(file)]) in (0, 4)
        reported[simulation.suffix] = json.loads(file.read_text())
    assert set(reported[".fmu"]["outputs"]) == {"yaw_rate", "accel_lat"}
    for name, found in reported[".fmu"]["outputs"].items():
        assert found["rms_before"] == pytest.approx(reported[""]["outputs"][name]["rms_before"], rel=1e-3)


@pytest.mark.parametrize(
    ("name", "changes", "what"),
    [
        ("Thirsty", {"inputs": [*INPUTS, "wind_mps"]}, "wind_mps"),
        ("Mute", {"outputs": ["oil_temp"]}, "none of its outputs"),
        ("Broken", {"body": "raise RuntimeError('no')"}, "the simulation failed"),
        ("Endless", {"body": "time.sleep(60)"}, "takes longer than 2 s"),
    ],
)
def test_one_that_cannot_be_run_is_one_line(
    drive: Path, tmp_path: Path, name: str, changes: dict[str, list[str]], what: str
) -> None:
    """Missing inputs and outputs, an error of its own, one that never ends."""
    made = built(tmp_path, name, **changes)  # type: ignore[arg-type]
    _, recorded = loaded(drive, "single-track")
    with pytest.raises(InputError, match=what) as caught:
        fmu_table(made, drive, recorded, wall_s=2.0 if name == "Endless" else 120.0)
    assert "\n" not in str(caught.value)


def zipped(file: Path, *members: tuple[str, bytes], link: bool = False) -> Path:
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in members:
            info = zipfile.ZipInfo(name)
            if link:
                info.external_attr = (stat.S_IFLNK | 0o777) << 16
            archive.writestr(info, content)
    return file


GOOD = ("modelDescription.xml", b"<fmiModelDescription fmiVersion='2.0'/>")
STEERING = ("modelDescription.xml", "<fmiModelDescription fmiVersion='\u009b31m'/>".encode())


@pytest.mark.parametrize(
    "name", ["../evil.txt", "/etc/evil", "a/../../evil", "a\\..\\evil", "C:evil", "", "."]
)
def test_a_member_that_leads_out_is_refused(tmp_path: Path, name: str) -> None:
    """Nothing is unpacked, the line names the member."""
    file = zipped(tmp_path / "a.fmu", GOOD, (name, b"x"))
    with pytest.raises(InputError, match="leads out of the archive"):
        unpack(file, tmp_path / "in" / "fmu")
    assert [file] == [path for path in tmp_path.rglob("*") if path.is_file()]


def test_a_link_is_refused(tmp_path: Path) -> None:
    """A symbolic link could lead anywhere."""
    with pytest.raises(InputError, match="leads out"):
        unpack(zipped(tmp_path / "a.fmu", ("x", b"/etc"), link=True), tmp_path / "fmu")


@pytest.mark.parametrize(
    ("members", "what"),
    [
        ((("a.txt", b""),), "no modelDescription.xml"),
        ((("modelDescription.xml", b"<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>"),), "document type"),
    ],
)
def test_an_archive_that_is_no_fmu_is_refused(
    tmp_path: Path, members: tuple[tuple[str, bytes], ...], what: str
) -> None:
    """Without a description, or with one that declares entities."""
    with pytest.raises(InputError, match=what):
        unpack(zipped(tmp_path / "a.fmu", *members), tmp_path / "fmu")


@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_a_damaged_member_is_one_line(tmp_path: Path, method: int) -> None:
    """Whatever it was packed with, and a pipe is no archive that is waited for."""
    file = tmp_path / "a.fmu"
    with zipfile.ZipFile(file, "w", method) as archive:
        archive.writestr("modelDescription.xml", GOOD[1] * 20)
        packed = archive.getinfo("modelDescription.xml").compress_size
    content = bytearray(file.read_bytes())
    begin = 30 + len("modelDescription.xml")
    content[begin + 9 : begin + packed] = b"\xff" * (packed - 9)
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"no FMU|cannot be read"):
        unpack(file, tmp_path / "fmu")
    os.mkfifo(tmp_path / "b.fmu")
    with pytest.raises(InputError, match="not a file"):
        unpack(tmp_path / "b.fmu", tmp_path / "fmu")


def test_one_that_unpacks_to_too_much_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the stated sizes, before a byte is unpacked."""
    monkeypatch.setattr(fmu, "MAX_BYTES", 1000)
    with pytest.raises(InputError, match="larger than"):
        unpack(zipped(tmp_path / "a.fmu", GOOD, ("big", bytes(2000))), tmp_path / "fmu")
    assert not (tmp_path / "fmu").exists()


def test_a_file_that_is_no_archive_ends_the_command(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 3 and one line, in which what the file states steers no terminal."""
    need_fmpy()
    file = tmp_path / "a.fmu"
    file.write_bytes(b"PK\x03\x04" + bytes(100))
    line = ["diagnose", str(drive), "--baseline", "single-track", "--simulation", str(file)]
    assert 3 == main(line)
    file.unlink()
    assert 3 == main(line)
    zipped(file, STEERING)
    assert 3 == main(line)
    said = capsys.readouterr().err.strip()
    assert 3 == len(said.splitlines())
    assert "\\x9b31m" in said
    assert "\x9b" not in said


def test_a_description_alone_fails_in_the_child(drive: Path, tmp_path: Path) -> None:
    """What the library says of it is one line."""
    need_fmpy()
    _, recorded = loaded(drive, "single-track")
    with pytest.raises(InputError, match="the simulation failed"):
        fmu_table(zipped(tmp_path / "a.fmu", GOOD), drive, recorded)


def test_without_the_package_the_extra_is_named(
    drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line with the command that installs it."""
    monkeypatch.setitem(sys.modules, "fmpy", None)
    _, recorded = loaded(drive, "single-track")
    with pytest.raises(ConfigError, match=r"tpmsd\[fmu\]"):
        fmu_table(tmp_path / "a.fmu", drive, recorded)
    assert read_signals(drive).unknown == ()
