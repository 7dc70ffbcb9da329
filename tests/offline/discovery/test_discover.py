"""Drawn cars, withheld names: the wheels are found, and where they cannot be, that is said."""

from __future__ import annotations

import json
from functools import reduce
from operator import xor
from pathlib import Path

import numpy as np
import pytest

from bench.campaigns.offline.drawn_buses import LAYOUTS, DrawnBus, draw
from tpmsd.car.config.check import check
from tpmsd.car.config.dbc import load_dbc
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.discovery.discover import discover
from tpmsd.offline.discovery.names import named_wheel
from tpmsd.offline.discovery.raw_fields import dbc_start
from tpmsd.offline.discovery.result import BusDiscovery
from tpmsd.offline.discovery.result_files import dbc_text, vehicle_text

DURATION_S = 540.0
_DRAWN: dict[str, DrawnBus] = {}


def drawn(name: str) -> DrawnBus:
    """A car with this layout, drawn once."""
    if name not in _DRAWN:
        layout = next(one for one in LAYOUTS if one.name == name)
        _DRAWN[name] = draw(7_000 + LAYOUTS.index(layout), DURATION_S, layout)
    return _DRAWN[name]


def signals(found: BusDiscovery, bus: DrawnBus) -> dict[str, str]:
    what = bus.layout.kind.removesuffix("s")
    return {wheel: found.roles[f"wheel_{what}_{wheel}"].field.signal for wheel in WHEELS}


@pytest.mark.parametrize("name", [layout.name for layout in LAYOUTS])
def test_wheels_by_what_they_do(name: str, tmp_path: Path) -> None:
    """Without names, among decoys and a late copy, the wheels, track and latency are found."""
    bus = drawn(name)
    file = tmp_path / "bus.dbc"
    file.write_text(bus.dbc)
    found = discover(bus.log, bus.fixes, load_dbc(file), bus.tyre)

    assert bus.truth == signals(found, bus)
    assert found.wheels_decided
    assert (bus.spec.vehicle.driven_axle, bus.layout.kind) == (found.driven_axle[0], found.kind)  # type: ignore[index]
    track, latency = found.geometry["track_rear_m"], found.gnss["latency_s"]
    assert abs(track.value - bus.spec.vehicle.track_rear_m) < max(3 * track.std, 0.03)
    assert abs(latency.value - bus.spec.receiver.latency_s) < max(3 * latency.std, 0.02)


@pytest.mark.parametrize("name", ["counts16-be-split", "counts8-254", "speeds-0.01-be", "speeds-1/32"])
def test_wheels_in_raw_frames(name: str, tmp_path: Path) -> None:
    """Without a DBC the same wheels are found bit by bit, and the files that are written pass the check."""
    bus = drawn(name)
    found = discover(bus.log, bus.fixes, None, bus.tyre)
    what = bus.layout.kind.removesuffix("s")
    for wheel, (identifier, lowest, big) in bus.raw_truth.items():
        field = found.roles[f"wheel_{what}_{wheel}"].field
        layout = field.layout
        at = layout.shift
        if layout.big_endian:
            at = 8 * (layout.word_bytes - 1 - layout.shift // 8) + layout.shift % 8
        assert (identifier, lowest) == (field.key, at)
        assert big == layout.big_endian or layout.length <= 8
        assert field.message == f"ID_{identifier:03X}"

    (tmp_path / "bus.dbc").write_text(dbc_text(found))
    (tmp_path / "vehicle.toml").write_text(vehicle_text(found, "bus.dbc"))
    result = check(tmp_path / "vehicle.toml")
    assert () == result.problems
    database = load_dbc(tmp_path / "bus.dbc")
    for one in found.roles.values():
        signal = database.get_message_by_name(one.field.message).get_signal_by_name(one.field.name)
        assert (dbc_start(one.field), one.field.layout.length) == (signal.start, signal.length)


@pytest.mark.parametrize(
    ("name", "modulus"), [("counts8-254", 254), ("counts10-1001", 1001), ("counts16", 0)]
)
def test_the_modulus_is_seen(name: str, modulus: int, tmp_path: Path) -> None:
    """A counter that rolls over below its width is found out; one that does not is left alone."""
    bus = drawn(name)
    (tmp_path / "bus.dbc").write_text(bus.dbc)
    found = discover(bus.log, bus.fixes, load_dbc(tmp_path / "bus.dbc"))
    assert [modulus] * 4 == [found.roles[f"wheel_count_{wheel}"].modulus for wheel in WHEELS]


def test_a_straight_road_tells_no_sides(tmp_path: Path) -> None:
    """On a drive without a fix in motion nothing is claimed, and the drive that would tell is named."""
    bus = drawn("counts16")
    found = discover(bus.log, bus.fixes[:50], None)

    assert found.kind is None
    assert not found.wheels_decided
    assert "10 min" in found.undecided[0].drive


@pytest.mark.parametrize(
    ("signal", "wheel"),
    [
        ("ESP_10.ESP_Wegimpuls_VL", "fl"),
        ("ESP_19.ESP_HR_Radgeschw_02", "rr"),
        ("WHL_SPD11.WHL_SPD_FL", "fl"),
        ("WHEEL_SPEEDS.WHEEL_SPEED_RR", "rr"),
        ("WheelSpeed.WhlRPM_RL", "rl"),
        ("EBCMWheelSpdFront.FLWheelSpd", "fl"),
        ("ESP_wheelSpeeds.ESP_wheelSpeedFrL", "fl"),
        ("M.Engine", None),
    ],
)
def test_names(signal: str, wheel: str | None) -> None:
    """The names that makers give their wheels are read; others say nothing."""
    assert wheel == named_wheel(signal)


@pytest.mark.parametrize("drive", ["van-motorway-c", "van-motorway-d"])
def test_the_van_without_its_configuration(recordings: Path, tmp_path: Path, drive: str) -> None:
    """On the real van both rear encoders are found on their sides, with a DBC and without."""
    for option in ([], ["--no-dbc"]):
        target = tmp_path / "out.json"
        assert 0 == main(["discover", str(recordings / drive), "--json", str(target), *option])
        document = json.loads(target.read_text())
        left, right = (document["roles"][f"wheel_count_{wheel}"]["signal"] for wheel in ("rl", "rr"))
        assert (left, right) in (
            ("ENCODERS.COUNT_RL", "ENCODERS.COUNT_RR"),
            ("ID_120.I0_32", "ID_120.I32_32"),
        )
        assert "counts" == document["kind"]
        assert pytest.approx(-0.74, abs=0.25) == document["gnss"]["antenna_left_m"]["value"]
        assert pytest.approx(1.55, abs=0.12) == document["geometry"]["track_rear_m"]["value"]
        assert "tpmsd.discovery/2" == document["schema"]


def test_four_speeds_of_the_rav4(recordings: Path, tmp_path: Path) -> None:
    """The real RAV4 shows its four wheel speeds and its gyro; on its straight minute no more is claimed."""
    target = tmp_path / "out.json"
    code = main(["discover", str(recordings / "rav4-suburb-60s"), "--json", str(target)])
    document = json.loads(target.read_text())

    found = {role: entry["signal"] for role, entry in document["roles"].items()}
    assert {
        f"wheel_speed_{wheel}": f"WHEEL_SPEEDS.{wheel.upper()}" for wheel in WHEELS
    }.items() <= found.items()
    assert "KINEMATICS.YAW_RATE" == found["yaw_rate"]
    assert code == (4 if any("wheel_speed" in one["key"] for one in document["undecided"]) else 0)


def test_write_refuses_and_is_accepted(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is written passes the check; a second run refuses to replace it unless told to."""
    target = tmp_path / "vehicle.toml"
    command = ["discover", str(recordings / "van-oval"), "--write", str(target)]
    assert 0 == main(command)
    assert () == check(target).problems
    before = target.read_text()
    assert 2 == main(command)
    assert "--force" in capsys.readouterr().err
    assert before == target.read_text()
    assert 0 == main([*command, "--force"])
    assert {target, tmp_path / "vehicle.dbc"} == set(tmp_path.iterdir())


def test_what_was_written_stands_alone(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The configuration names the copied DBC beside it, and both files and the next step are said."""
    target = tmp_path / "vehicle.toml"
    drive = recordings / "van-oval"
    assert 0 == main(["discover", str(drive), "--write", str(target)])
    said = capsys.readouterr().out
    assert f"Wrote {target} and {tmp_path / 'vehicle.dbc'}." in said
    assert f"Next: tpmsd check {target} --drive {drive}" in said
    assert 'dbc = "vehicle.dbc"' in target.read_text()
    assert (drive / "bus.dbc").read_bytes() == (tmp_path / "vehicle.dbc").read_bytes()
    target.unlink()
    (tmp_path / "vehicle.dbc").write_text("mine")
    assert 2 == main(["discover", str(drive), "--write", str(target)]), "no DBC of another is replaced"
    assert "mine" == (tmp_path / "vehicle.dbc").read_text()


def test_nothing_written_is_said(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Where no wheels are found the command says that nothing was written."""
    drive = tmp_path / "drive"
    drive.mkdir()
    lines = [f"({1700000000 + i / 10:.6f}) can0 123#{i % 256:02X}00" for i in range(600)]
    (drive / "can.log").write_text("\n".join(lines) + "\n")
    body = "GPRMC,{:06d}.00,A,4807.0380,N,01131.0000,E,0.0,84.4,230394,,,A"
    sentences = [body.format(120000 + i) for i in range(60)]
    sums = [reduce(xor, sentence.encode()) for sentence in sentences]
    stamped = [
        f"({1700000000 + i}.0) ${s}*{c:02X}" for i, (s, c) in enumerate(zip(sentences, sums, strict=True))
    ]
    (drive / "gnss.nmea").write_text("\n".join(stamped) + "\n")
    target = tmp_path / "vehicle.toml"
    assert 4 == main(["discover", str(drive), "--write", str(target)])
    assert "Nothing was written" in capsys.readouterr().out
    assert not target.exists()


def test_two_folders_are_no_drive(recordings: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two drives, or a name that is not there, are answered by what the command takes."""
    wanted = "one folder, or two files, its CAN log and its NMEA log"
    assert 2 == main(["discover", str(recordings / "van-oval"), str(recordings / "van-motorway-c")])
    assert wanted in capsys.readouterr().err
    assert 3 == main(["discover", "a", "b"])
    assert wanted in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "code"),
    [(["/nonexistent"], 3), (["a.log", "b.log", "c.log"], 2), (["--tyre", "round", "."], 2)],
)
def test_wrong_usage(arguments: list[str], code: int, capsys: pytest.CaptureFixture[str]) -> None:
    """Wrong input ends in one line and the right exit code."""
    assert code == main(["discover", *arguments])
    assert 1 == len(capsys.readouterr().err.strip().splitlines())


def test_bits_of_a_field_are_those_of_the_decoder() -> None:
    """Whole columns give the raw bits that the frame-by-frame decoder gives, in both byte orders."""
    from tpmsd.offline.discovery.frames import MessageLog
    from tpmsd.onboard.sources.can.signal_plan import BitField

    rng = np.random.default_rng(3)
    data = rng.integers(0, 256, (50, 8), dtype=np.uint8)
    log = MessageLog(1, np.arange(50.0), data)
    for _ in range(300):
        length = int(rng.integers(1, 65))
        first = int(rng.integers(0, 65 - length))
        size = (first + length + 7) // 8
        for big in (False, True):
            shift = 8 * size - first - length if big else first
            place = BitField(big, size, length, shift, size, False, False, (1 << length) - 1)
            assert [place.bits(bytes(row)) for row in data.tolist()] == log.bits(place).tolist()
