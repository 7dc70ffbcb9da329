"""CAN FD, 29-bit identifiers, several buses: a drive is repacked, and its twin runs on the other bus.

The wheels' frames come as CAN FD frames of 64 bytes with 29-bit identifiers on vcan0. On vcan1, to which the
daemon sends, the same identifiers carry another car's wheels; and on vcan0 classic frames whose 11-bit
identifiers have the same number carry nonsense.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest

from tests.hil.guest.play import Receiver, canplaying, copy_car, cut, frames_of, write_log
from tests.hil.guest.rig import STATUS_ID, TPMSD, decode, listening, run, running

SECONDS, PACE = 26.0, 2.0
EXTENDED = 0x18FE0000
FD_BYTES = 64


def repacked(rest: str) -> str:
    """A candump line as a CAN FD frame (with bit rate switch) that has a 29-bit identifier."""
    channel, _, frame = rest.partition(" ")
    identifier, _, data = frame.partition("#")
    data = data.split()[0]
    return f"{channel} {EXTENDED | int(identifier, 16):08X}##1{data}{'00' * (FD_BYTES - len(data) // 2)}"


def repacked_dbc(text: str) -> str:
    """The DBC that goes with it."""
    text, found = re.subn(
        r"^BO_ (\d+) (\w+): \d+ ",
        lambda m: f"BO_ {1 << 31 | EXTENDED | int(m[1])} {m[2]}: {FD_BYTES} ",
        text,
        flags=re.M,
    )
    assert found
    return re.sub(
        r"^((?:CM_ SG_|CM_ BO_|VAL_|SIG_VALTYPE_|BA_ \"\w+\" (?:SG_|BO_)) )(\d+)",
        lambda m: f"{m[1]}{1 << 31 | EXTENDED | int(m[2])}",
        text,
        flags=re.M,
    )


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    folder = tmp_path_factory.mktemp("formats")
    run("ip", "link", "add", "dev", "vcan1", "type", "vcan")
    run("ip", "link", "set", "vcan1", "mtu", "72", "up")
    drive, twin = folder / "drive", folder / "twin"
    run(*TPMSD, "simulate", drive, "--duration", f"{SECONDS + 4:g}", "--route", "test-track", "--seed", "7")
    run(*TPMSD, "simulate", twin, "--duration", f"{SECONDS + 4:g}", "--route", "city", "--seed", "8")
    log, other, nonsense = folder / "play.log", folder / "twin.log", folder / "nonsense.log"
    frames = write_log(log, drive, SECONDS, PACE, repacked)
    write_log(other, twin, SECONDS, PACE, repacked)
    classic = write_log(nonsense, twin, SECONDS, PACE, lambda rest: rest.split("#")[0] + "#FFFF0000FFFF0000")
    car = copy_car(drive, folder / "car", "vcan0", fd=True, more='\n[alarms]\nchannel = "vcan1"\n')
    dbc = car / "bus.dbc"
    dbc.write_text(repacked_dbc(dbc.read_text("utf-8")), "utf-8")
    receiver, taken = Receiver(drive, "vcan0", SECONDS, PACE), folder / "taken"
    try:
        with (
            listening("vcan0", folder / "heard0", "6F0:7FE") as zero,
            listening("vcan1", folder / "heard1", "6F0:7FE") as one,
            running(
                car, "--device", receiver.path, "--speed-up", f"{PACE:g}", "--record", str(taken)
            ) as daemon,
        ):
            daemon.ready()
            with (
                canplaying(other, "vcan1=can0"),
                canplaying(nonsense, "vcan0=can0"),
                canplaying(log, "vcan0=can0") as player,
            ):
                assert 0 == player.wait(60.0)
            document = daemon.until(lambda status: status["can"]["state"] == "silent", "the drive is over")
            code, text = daemon.stop(), daemon.log()
            heard = {"vcan0": zero.frames(), "vcan1": one.frames()}
    finally:
        receiver.close()
    for one in (cut(drive, folder / "original", SECONDS), taken):
        run(*TPMSD, "replay", one, "--json", folder / f"{one.name}.json")
    yield {
        "frames": frames,
        "classic": classic,
        "document": document,
        "heard": heard,
        "code": code,
        "log": text,
        "played": frames_of(log),
        "taken": frames_of(taken / "can.log"),
        "replay": json.loads((folder / "original.json").read_text()),
        "replay_of_taken": json.loads((folder / "taken.json").read_text()),
    }


def test_fd_frames_with_long_identifiers_are_read(played: dict[str, Any]) -> None:
    """Every one of them, in order, none of the other bus, none with an 11-bit identifier of that number."""
    assert played["frames"] == played["document"]["can"]["frames"]
    assert played["played"] == played["taken"]
    assert played["classic"] >= 0.99 * played["frames"]


def test_the_radii_are_those_of_the_configured_bus(played: dict[str, Any]) -> None:
    """A replay of what the daemon recorded, which is the drive on vcan0 alone, tells what was told live.

    How punctual this machine is makes no difference to that: frames that a starved player sends in a burst
    may even be told as jumps. That none of the other bus is among them is the test before this one.
    """
    live, replayed = played["document"]["wheels"], played["replay_of_taken"]["wheels"]
    for wheel in live:
        assert played["replay"]["wheels"][wheel]["std_mm"] < 1.5
        for value in ("deviation_mm", "std_mm"):
            assert replayed[wheel][value] == pytest.approx(live[wheel][value], abs=0.01)


def test_what_is_sent_goes_to_the_bus_that_is_configured(played: dict[str, Any]) -> None:
    """tpmsd's frames are on vcan1 alone, classic and whole, also from a daemon that reads CAN FD."""
    status = [frame for frame in played["heard"]["vcan1"] if frame.identifier == STATUS_ID]

    assert [] == played["heard"]["vcan0"]
    assert len(status) >= 3 * SECONDS / 2
    assert {(False, 8)} == {(frame.fd, len(frame.data)) for frame in status}
    assert {"learning"} >= {row["State_RR"] for row in decode(status) if "State_RR" in row} - {"unavailable"}


def test_it_ends_in_order(played: dict[str, Any]) -> None:
    """Exit code 0 and no traceback."""
    assert (0, False) == (played["code"], "Traceback" in played["log"])
