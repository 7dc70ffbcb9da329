"""A recorded drive, put onto the bus by canplayer: the daemon gets it all and finds what a replay finds.

Nothing here depends on how punctual this machine is. Frames and sentences must arrive whole and in order;
what the daemon makes of them it makes by the stamps that they got on arrival, which its own recording has.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import REPO
from tests.hil.guest.play import (
    Receiver,
    canplaying,
    copy_car,
    cut,
    frames_of,
    sentences_of,
    span_s,
    wanted_ids,
    write_log,
)
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
    add_other_traffic(folder / "can.log")
    return folder


def add_other_traffic(log: Path) -> None:
    """After every tenth frame of a simulated bus, which carries what is wanted alone, one that nobody
    reads."""
    lines = log.read_text("ascii").splitlines()
    for k in range(len(lines) - 1, 0, -10):
        stamp, channel, _ = lines[k].split()
        lines.insert(k + 1, f"{stamp} {channel} 5A5#{k % 256:02X}")
    log.write_text("\n".join(lines) + "\n", "ascii")


@pytest.fixture(scope="module")
def played(drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """What the daemon knew at the end and recorded, beside what replays of both recordings say."""
    folder = tmp_path_factory.mktemp("recorded")
    log = folder / "play.log"
    frames = write_log(log, drive, SECONDS, PACE)
    car = copy_car(drive, folder / "car", "vcan0")
    channel = next(iter(log.read_text("ascii").split()[1::3]))
    receiver, taken = Receiver(drive, "vcan0", SECONDS, PACE), folder / "taken"
    arguments = ("--device", receiver.path, "--speed-up", f"{PACE:g}", "--record", str(taken))
    try:
        with running(car, *arguments) as daemon:
            daemon.ready()
            with canplaying(log, f"vcan0={channel}") as player:
                assert 0 == player.wait(60.0)
            document = daemon.until(lambda status: status["can"]["state"] == "silent", "the drive is over")
            code = daemon.stop()
            text = daemon.log()
    finally:
        receiver.close()
    original = cut(drive, folder / "original", SECONDS)
    for one in (original, taken):
        run(*TPMSD, "replay", one, "--json", folder / f"{one.name}.json")
    wanted = wanted_ids(drive)
    yield {
        "frames": frames,
        "wanted": [frame for frame in frames_of(log) if frame[0] in wanted],
        "said": sentences_of(original, 0.0, SECONDS),
        "taken": taken,
        "document": document,
        "code": code,
        "log": text,
        "replay": json.loads((folder / "original.json").read_text()),
        "replay_of_taken": json.loads((folder / "taken.json").read_text()),
    }


def test_every_wanted_frame_arrives_and_no_other(played: dict[str, Any]) -> None:
    """The kernel's filter lets the named messages through, all of them in order, and nothing else."""
    can = played["document"]["can"]

    assert len(played["wanted"]) == can["frames"]
    assert played["wanted"] == frames_of(played["taken"] / "can.log")
    assert len(played["wanted"]) < played["frames"]
    assert "dropped_by_kernel" not in can["faults"]


def test_every_sentence_arrives(played: dict[str, Any]) -> None:
    """The receiver's lines, in order and whole, and frames at the pace of the drive."""
    assert len(played["said"]) > SECONDS
    assert played["said"] == sentences_of(played["taken"])
    assert span_s(played["taken"] / "can.log") == pytest.approx(SECONDS, rel=0.1)


def test_the_radii_are_those_of_the_recording(played: dict[str, Any]) -> None:
    """What was told live is what a replay of the daemon's own recording tells; the drive is long enough."""
    live, replayed = played["document"]["wheels"], played["replay_of_taken"]["wheels"]

    assert set(live) == set(replayed) == set(played["replay"]["wheels"])
    for wheel in live:
        assert played["replay"]["wheels"][wheel]["std_mm"] < 1.0
        for value in ("deviation_mm", "std_mm"):
            assert replayed[wheel][value] == pytest.approx(live[wheel][value], abs=0.01)


def test_the_drive_is_healthy(played: dict[str, Any]) -> None:
    """A drive without a fault raises no alarm, and the daemon stops in order."""
    assert [] == played["document"]["alarms"]
    assert (0, False) == (played["code"], "Traceback" in played["log"])
