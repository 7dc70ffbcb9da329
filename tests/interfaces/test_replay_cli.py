"""`tpmsd replay` on unusable input of every kind: an exit code and one clear line, never a traceback."""

from __future__ import annotations

import gzip
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tpmsd.interfaces.cli.main import main
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive

OTHER_DBC = """VERSION ""
NS_ :
BS_:
BU_: CAR
BO_ 300 OTHER: 8 CAR
 SG_ X : 0|8@1+ (1,0) [0|255] "" CAR
"""
NOISE = np.random.default_rng(1).bytes(5000)
Damage = Callable[[Path], object]


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_drive(tmp_path_factory.mktemp("good"), simulate_drive(DriveSpec(duration_s=15.0, seed=2)))


@pytest.fixture
def folder(good: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(good, tmp_path / "drive"))


def gone(*names: str) -> Damage:
    return lambda folder: [(folder / name).unlink() for name in names]


def put(name: str, content: bytes) -> Damage:
    return lambda folder: (folder / name).write_bytes(content)


def edited(name: str, pattern: str, replacement: str) -> Damage:
    def damage(folder: Path) -> None:
        text = (folder / name).read_text()
        changed = re.sub(pattern, replacement, text)
        assert text != changed
        (folder / name).write_text(changed)

    return damage


def renamed(name: str, other: str) -> Damage:
    return lambda folder: (folder / name).rename(folder / other)


def zipped(share: float) -> Damage:
    def damage(folder: Path) -> None:
        data = gzip.compress((folder / "can.log").read_bytes())
        (folder / "can.log").unlink()
        (folder / "can.log.gz").write_bytes(data[: max(int(share * len(data)), 3)])

    return damage


def first_line_of(name: str) -> Damage:
    def damage(folder: Path) -> None:
        (folder / name).write_text((folder / name).read_text().splitlines()[0] + "\n")

    return damage


def a_folder_for(name: str) -> Damage:
    def damage(folder: Path) -> None:
        (folder / name).unlink()
        (folder / name).mkdir()

    return damage


REFUSED: dict[str, tuple[Damage, int, str]] = {
    "empty folder": (
        gone("can.log", "gnss.nmea", "bus.dbc", "vehicle.toml", "truth.json"),
        2,
        "vehicle.toml",
    ),
    "no CAN log": (gone("can.log"), 3, "no CAN log; looked for can.log"),
    "no vehicle.toml": (gone("vehicle.toml"), 2, "vehicle.toml: no such file"),
    "no DBC": (gone("bus.dbc"), 2, "vehicle.toml:"),
    "empty can.log": (put("can.log", b""), 3, "can.log: the file is empty"),
    "blank can.log": (put("can.log", b"\n\n\n"), 3, "can.log"),
    "binary can.log": (put("can.log", NOISE), 3, "can.log:1: no CAN frame in it"),
    "gz cut at once": (zipped(0.0), 3, "can.log.gz:1:"),
    "not gz": (renamed("can.log", "can.log.gz"), 3, "can.log.gz:1:"),
    "text as asc": (renamed("can.log", "can.asc"), 3, "can.asc: no CAN frame in it"),
    "text as blf": (renamed("can.log", "can.blf"), 3, "can.blf: no CAN frame in it"),
    "two logs": (put("can.asc", b"x"), 3, "more than one CAN log (can.asc can.log)"),
    "a folder for a log": (a_folder_for("can.log"), 3, "can.log: not a file"),
    "wrong DBC": (
        put("bus.dbc", OTHER_DBC.encode()),
        2,
        "vehicle.toml: can.signals.wheel_count_fl: the DBC has no",
    ),
    "garbage DBC": (put("bus.dbc", NOISE), 2, "bus.dbc: not a bus description"),
    "missing signal": (
        edited("vehicle.toml", "wheel_count_rl", "# wheel_count_rl"),
        2,
        "wheel_count_rl: missing",
    ),
    "mistyped signal": (edited("vehicle.toml", "CNT_RL|RL_|_RL\\b", "XX"), 2, "vehicle.toml"),
    "other identifiers": (edited("can.log", "can0 [0-9A-F]{3}#", "can0 7FF#"), 3, "none of its"),
    "garbage NMEA": (put("gnss.nmea", NOISE), 3, "gnss.nmea:"),
    "empty NMEA": (put("gnss.nmea", b""), 3, "gnss.nmea: "),
    "broken TOML": (put("vehicle.toml", b"[vehicle\n"), 2, "vehicle.toml:1: not valid TOML"),
    "binary TOML": (put("vehicle.toml", b"\xff\xfe\x00"), 2, "vehicle.toml:1: not UTF-8"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_unusable_input_is_refused_in_one_line(
    folder: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The exit code of its kind, and one line on standard error that names the file and the reason."""
    damage, code, reason = REFUSED[name]
    damage(folder)
    assert code == main(["replay", str(folder), "--json", "-"])
    out, err = capsys.readouterr()
    assert "" == out
    assert reason in err
    assert str(folder) in err
    assert 1 == len(err.strip().splitlines())
    assert "Traceback" not in err
    assert "internal error" not in err


ACCEPTED: dict[str, Damage] = {
    "as it is": lambda folder: None,
    "gz cut in the middle": zipped(0.5),
    "whole gz": zipped(1.0),
    "one frame": first_line_of("can.log"),
    "one sentence": first_line_of("gnss.nmea"),
    "no receiver": gone("gnss.nmea"),
    "never a fix": edited("gnss.nmea", r"(RMC,[^,]*),A,[^*]*", r"\1,V,,,,,,,,,,N"),
    "all counters at their end": edited("can.log", "#[0-9A-F]+", "#FFFFFFFFFFFFFFFF"),
    "all counters at zero": edited("can.log", "#[0-9A-F]+", "#0000000000000000"),
    "frames cut short": edited("can.log", "#[0-9A-F]+", "#00"),
    "stamps that are no numbers": lambda folder: (folder / "can.log").write_text(
        "(nan) can0 0B0#00\n(inf) can0 0B0#00\n(-1) can0 0B0#00\n" + (folder / "can.log").read_text()
    ),
    "garbage between lines": lambda folder: (folder / "can.log").write_bytes(
        b"\n\x00\xff".join((folder / "can.log").read_bytes().splitlines(keepends=True))
    ),
    "garbage between sentences": lambda folder: (folder / "gnss.nmea").write_bytes(
        b"\n\x00\xff$GPRMC,,,\n".join((folder / "gnss.nmea").read_bytes().splitlines(keepends=True))
    ),
    "sentences without their prefix": edited("gnss.nmea", r"\([0-9.]+\) ", ""),
    "Windows line ends": lambda folder: (folder / "can.log").write_bytes(
        (folder / "can.log").read_bytes().replace(b"\n", b"\r\n")
    ),
}


@pytest.mark.parametrize("name", ACCEPTED)
def test_damaged_input_is_used_as_far_as_it_goes(
    folder: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit 0, JSON without NaN, no tyre alarm, and not a word of a traceback."""
    ACCEPTED[name](folder)
    assert 0 == main(["replay", str(folder), "--json", "-"])
    out, err = capsys.readouterr()
    document = json.loads(out, parse_constant=lambda constant: pytest.fail(constant))
    assert [] == [alarm for alarm in document["alarms"] if alarm["kind"] != "malfunction"]
    assert "Traceback" not in err
    assert "internal error" not in err
    assert len(err.strip().splitlines()) <= 3


def test_what_was_skipped_is_said(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Bad lines are counted on standard error, the first with its place."""
    lines = (folder / "can.log").read_text().splitlines(keepends=True)
    lines[4] = "(17198\n"
    (folder / "can.log").write_text("".join(lines))
    assert 0 == main(["replay", str(folder)])
    _, err = capsys.readouterr()
    assert err.startswith(f"tpmsd: 1 bad line skipped, first {folder / 'can.log'}:5: ")


@pytest.mark.parametrize(
    ("arguments", "code", "reason"),
    [
        (["--seed", "-3"], 2, "--seed -3: a seed is 0 or more"),
        (["--seed", "many"], 2, "invalid int value"),
        (
            ["--method", "kalman"],
            2,
            "unknown 'kalman'; known: gaussian-sum, mpf-pn-paper, mpf-pn, mpf-pn-",
        ),
        (["--plot", "/nonexistent/a.png"], 1, "--plot /nonexistent/a.png: there is no folder /nonexistent"),
        (["--config", "/nonexistent/a.toml"], 2, "/nonexistent/a.toml"),
        (["--json", "/nonexistent/a.json"], 1, "--json /nonexistent/a.json: there is no folder /nonexistent"),
    ],
    ids=str,
)
def test_wrong_usage(
    folder: Path, arguments: list[str], code: int, reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Wrong arguments end with their code and the reason."""
    assert code == main(["replay", str(folder), *arguments])
    _, err = capsys.readouterr()
    assert reason in err
    assert "internal error" not in err


@pytest.mark.parametrize(
    ("name", "reason"), [("nowhere", "no such drive folder"), ("can.log", "not a folder")]
)
def test_no_folder(folder: Path, name: str, reason: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A path that is no folder is named."""
    assert 3 == main(["replay", str(folder / name)])
    assert f"tpmsd: {folder / name}: {reason}\n" == capsys.readouterr().err


def test_another_method_and_seed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The published filter runs on request, and its seed makes it repeatable."""
    radii = []
    for seed in ("1", "1", "2"):
        assert 0 == main(["replay", str(folder), "--method", "mpf-pn", "--seed", seed, "--json", "-"])
        document = json.loads(capsys.readouterr().out)
        radii.append([wheel["deviation_mm"] for wheel in document["wheels"].values()])
    assert radii[0] == radii[1]
    assert radii[0] != radii[2]
