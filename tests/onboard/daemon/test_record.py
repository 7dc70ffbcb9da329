"""`tpmsd record`: what comes is on the disk, whole lines, stamped; and nothing is overwritten."""

from __future__ import annotations

import socket
import threading
import time
from itertools import count, pairwise
from pathlib import Path

import can
import pytest

from tests.onboard.daemon.fakes import FakeBus
from tests.onboard.daemon.test_links import link_of
from tpmsd.interfaces.cli.main import main
from tpmsd.onboard.daemon.drive_recording import (
    SYNC_S,
    DriveRecording,
    RecordingError,
    RecordingProgress,
)
from tpmsd.onboard.daemon.recorder import Appender
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.can.log import read_can_log
from tpmsd.onboard.sources.gnss.nmea_log import read_nmea_log

RMC = b"$GNRMC,080000.00,A,5230.12345,N,01324.54321,E,27.21,84.3,010724,,,A*71\r\n"


def feed(channel: str, server: socket.socket, stop: threading.Event) -> None:
    """Traffic on a virtual bus and a TCP receiver."""
    connection, _ = server.accept()
    with can.Bus(interface="virtual", channel=channel) as bus, connection:
        number = 0
        while not stop.is_set():
            bus.send(can.Message(arbitration_id=0xB0, data=[number % 256] * 8, is_extended_id=False))
            if number % 10 == 0:
                connection.sendall(RMC)
            number += 1
            time.sleep(0.005)


def test_a_recording_is_a_drive(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Frames and sentences come back from the files with stamps of one clock; a second run refuses the
    folder."""
    server = socket.create_server(("127.0.0.1", 0))
    stop = threading.Event()
    thread = threading.Thread(target=feed, args=("record-test", server, stop))
    thread.start()
    folder = tmp_path / "drive"
    command = ["record", str(folder), "--interface", "virtual", "--channel", "record-test"]
    command += ["--source", f"tcp://127.0.0.1:{server.getsockname()[1]}", "--duration", "2"]
    try:
        before = time.time()
        assert 0 == main(command)
    finally:
        stop.set()
        thread.join()
        server.close()
    frames = list(read_can_log(folder / "can.log"))
    sentences = list(read_nmea_log(folder / "gnss.nmea"))
    assert len(frames) > 50
    assert len(sentences) > 3
    counters = [frame.data[0] for frame in frames]
    assert all((after - one) % 256 == 1 for one, after in pairwise(counters))
    assert all(before - 1 < frame.time_s < before + 10 for frame in frames)
    assert all(before - 1 < time_s < before + 10 for time_s, _, _ in sentences)

    capsys.readouterr()
    assert 1 == main(command)
    assert "holds a recording already" in capsys.readouterr().err


def test_nothing_that_comes_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A silent bus is exit code 3 and one line, and leaves no folder behind."""
    command = [
        "record",
        str(tmp_path / "x"),
        "--interface",
        "virtual",
        "--source",
        "none",
        "--duration",
        "0.3",
    ]
    assert 3 == main(command)
    assert "nothing came from CAN can0" in capsys.readouterr().err
    assert [] == list(tmp_path.iterdir())


def test_a_source_that_is_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A misspelt source is wrong usage, before anything is made."""
    assert 2 == main(["record", str(tmp_path / "x"), "--source", "pigeon://home"])
    assert not (tmp_path / "x").exists()


def test_what_was_flushed_is_on_the_disk(tmp_path: Path) -> None:
    """After a flush and a sync the file holds whole lines, whatever happens to the process."""
    appender = Appender(tmp_path / "can.log")
    appender.add(b"one\n")
    appender.flush()
    appender.sync()
    appender.add(b"two")
    assert b"one\n" == (tmp_path / "can.log").read_bytes()
    appender.close()
    assert 4 == len((tmp_path / "can.log").read_bytes())


def test_a_recording_ends_at_its_limit_and_says_which(tmp_path: Path) -> None:
    """The line names the megabytes of --max-mb."""
    clock = count(0.0, 1.0)
    link = link_of(FakeBus())
    made = DriveRecording(tmp_path / "d", link, None, lambda: 1000.0, lambda: next(clock), 2 << 20)
    made.seen.bytes = 2 << 20
    seen = made.run(lambda: False, lambda seen: None, 30.0)

    assert "2 MB are full (--max-mb)" == seen.why


class SteadyBus(FakeBus):
    """Thirty frames in each round."""

    def read(self, limit: int = 1000) -> list[CanFrame]:
        return 30 * [CanFrame(1000.0, "can0", 0xB0, False, False, False, False, b"\0")]


def test_a_power_cut_costs_seconds_and_the_rate_is_that_of_the_last_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In rounds of a second: every `SYNC_S` and at the end both files go to the disk, not more often."""
    clock, synced, seen = count(0.0, 1.0), list[str](), list[tuple[int, float]]()
    monkeypatch.setattr("tpmsd.onboard.daemon.drive_recording.WAIT_S", 0.0)
    monkeypatch.setattr(Appender, "sync", lambda _: synced.append("file"))
    link = link_of(SteadyBus())
    made = DriveRecording(tmp_path / "d", link, None, lambda: 1000.0, lambda: next(clock), 1 << 30)

    def report(progress: RecordingProgress) -> None:
        seen.append((len(synced), progress.frames_per_s))

    made.run(lambda: False, report, 23.0)
    assert [(2 * int(second // SYNC_S), 30.0) for second in range(1, 23)] == seen
    assert 2 * int(23.0 // SYNC_S) + 2 == len(synced)


def test_a_folder_that_is_there_may_be_recorded_into_once(tmp_path: Path) -> None:
    """An empty folder, or one with a configuration, is as good as none; a recording is not overwritten."""
    (tmp_path / "vehicle.toml").write_text("", "utf-8")
    for folder in (tmp_path, tmp_path / "of" / "today"):
        link = link_of(FakeBus())
        DriveRecording(folder, link, None, time.time, time.monotonic, 1 << 20)
        with pytest.raises(RecordingError, match="holds a recording already"):
            DriveRecording(folder, link, None, time.time, time.monotonic, 1 << 20)
