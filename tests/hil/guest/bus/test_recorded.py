"""A recorded drive, put onto the bus by canplayer: the daemon finds what a replay of the recording finds."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cantools
import pytest

from tests.conftest import REPO
from tests.hil.guest.play import Receiver, canplaying, copy_car, cut, write_log
from tests.hil.guest.rig import TPMSD, run, running

SECONDS, PACE = 36.0, 2.0
REAL = Path(os.environ.get("TPMSD_RECORDINGS", REPO.parent / "shared" / "recordings")) / "rav4-suburb-60s"


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A real drive with every frame of its bus where there is one, else a simulated one."""
    if REAL.is_dir():
        return REAL
    folder = tmp_path_factory.mktemp("simulated") / "drive"
    run(*TPMSD, "simulate", folder, "--duration", "60", "--route", "rural", "--seed", "5")
    return folder


@pytest.fixture(scope="module")
def played(drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """What the daemon knew at the end, beside what a replay of the same seconds says."""
    folder = tmp_path_factory.mktemp("recorded")
    log = folder / "play.log"
    frames = write_log(log, drive, SECONDS, PACE)
    car = copy_car(drive, folder / "car", "vcan0")
    channel = next(iter(log.read_text("ascii").split()[1::3]))
    receiver = Receiver(drive, "vcan0", SECONDS, PACE)
    try:
        with running(car, "--device", receiver.path, "--speed-up", f"{PACE:g}") as daemon:
            daemon.ready()
            with canplaying(log, f"vcan0={channel}") as player:
                assert 0 == player.wait(60.0)
            document = daemon.until(lambda status: status["can"]["state"] == "silent", "the drive is over")
            code = daemon.stop()
            text = daemon.log()
    finally:
        receiver.close()
    original = cut(drive, folder / "original", SECONDS)
    run(*TPMSD, "replay", original, "--json", folder / "replay.json")
    wanted = wanted_ids(drive)
    yield {
        "frames": frames,
        "wanted": sum(identifier(line) in wanted for line in log.open()),
        "document": document,
        "code": code,
        "log": text,
        "replay": json.loads((folder / "replay.json").read_text()),
    }


def identifier(line: str) -> int:
    """Of a candump line."""
    return int(line.split()[2].split("#")[0], 16)


def wanted_ids(drive: Path) -> set[int]:
    """The identifiers of the messages that the car's configuration names, by its DBC."""
    signals = tomllib.loads((drive / "vehicle.toml").read_text())["can"]["signals"]
    database: Any = cantools.database.load_file(drive / "bus.dbc")
    return {database.get_message_by_name(signal.split(".")[0]).frame_id for signal in signals.values()}


def test_every_wanted_frame_arrives_and_no_other(played: dict[str, Any]) -> None:
    """The kernel's filter lets the named messages through, all of them, and nothing else of the bus."""
    can = played["document"]["can"]

    assert played["wanted"] == can["frames"]
    assert played["wanted"] < played["frames"]
    assert "dropped_by_kernel" not in can["faults"]


def test_the_radii_are_those_of_the_recording(played: dict[str, Any]) -> None:
    """What canplayer plays gives the radii that a replay of the same seconds gives."""
    live, replayed = played["document"]["wheels"], played["replay"]["wheels"]

    assert set(live) == set(replayed)
    for wheel in live:
        std_mm = max(live[wheel]["std_mm"], replayed[wheel]["std_mm"])
        assert std_mm < 1.0
        assert replayed[wheel]["deviation_mm"] == pytest.approx(live[wheel]["deviation_mm"], abs=3.0 * std_mm)


def test_the_drive_is_healthy(played: dict[str, Any]) -> None:
    """A drive without a fault raises no alarm, and the daemon stops in order."""
    assert [] == played["document"]["alarms"]
    assert (0, False) == (played["code"], "Traceback" in played["log"])
