"""`tpmsd record`: what comes is on the disk, whole lines, stamped; and nothing is overwritten."""

from __future__ import annotations

import errno
import logging
import math
import os
import socket
import threading
import time
from itertools import count, pairwise
from pathlib import Path
from types import SimpleNamespace

import can
import pytest

from tests.onboard.daemon.fakes import FakeBus
from tests.onboard.daemon.test_link_ends import Line
from tests.onboard.daemon.test_links import link_of
from tpmsd.interfaces.cli.main import main
from tpmsd.onboard.daemon.drive_recording import (
    SYNC_S,
    DriveRecording,
    RecordingError,
    RecordingProgress,
)
from tpmsd.onboard.daemon.receiver_link import ReceiverLink
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


class ManyBus(FakeBus):
    """In each round thirty frames with identifiers of their own, of a channel with this name."""

    def __init__(self, channel: str = "can0") -> None:
        super().__init__()
        self.channel, self.number = channel, count()

    def read(self, limit: int = 1000) -> list[CanFrame]:
        numbers = [next(self.number) for _ in range(30)]
        return [CanFrame(1000.0, self.channel, n, True, False, False, False, b"\0") for n in numbers]


class QuietLine(Line):
    """A receiver's line that nothing wakes."""

    def __init__(self, pieces: list[bytes]) -> None:
        super().__init__(pieces)
        self.ends = socket.socketpair()

    def fileno(self) -> int:
        return self.ends[0].fileno()


def recorded(
    folder: Path,
    bus: FakeBus,
    receiver: ReceiverLink | None = None,
    *,
    rounds: float = 2.0,
    step_s: float = 1.0,
) -> tuple[RecordingProgress, list[float]]:
    """A recording of so many rounds `step_s` apart; what was seen, and the times of its reports."""
    clock, times, now = count(0), list[float](), [0.0]

    def monotonic() -> float:
        now[0] = 500.0 + step_s * next(clock)
        return now[0]

    made = DriveRecording(folder, link_of(bus), receiver, lambda: 1000.0, monotonic, 1 << 30)
    seen = made.run(lambda: False, lambda _: times.append(now[0] - 500.0), (rounds + 1.0) * step_s)
    return seen, times


@pytest.fixture
def unwaiting(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rounds of the recording that follow each other at once."""
    monkeypatch.setattr("tpmsd.onboard.daemon.drive_recording.WAIT_S", 0.0)


@pytest.mark.usefixtures("unwaiting")
def test_progress_is_told_once_a_second_and_synced_every_five(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In rounds of a quarter: at the full second, and files go to the disk at the fifth."""
    synced: list[int] = []
    monkeypatch.setattr(Appender, "sync", lambda _: synced.append(0))
    _, times = recorded(tmp_path / "d", FakeBus(), rounds=43, step_s=0.25)

    assert [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0] == times
    assert 2 * 3 == len(synced)  # 5 s, 10 s, the end; two files each


@pytest.mark.usefixtures("unwaiting")
def test_what_was_seen_is_what_is_in_the_files(tmp_path: Path) -> None:
    """Frames, sentences, bytes of both files, identifiers; speed and quality are those of the last fix."""
    gga = b"$GNGGA,080000.00,5230.12345,N,01324.54321,E,4,12,0.8,34.0,M,45.0,M,1.0,0000*"
    checked = gga + b"%02X\r\n" % _sum(gga)
    later = RMC.replace(b"080000.00", b"080000.10")
    later = later[: later.index(b"*") + 1] + b"%02X\r\n" % _sum(later)
    receiver = ReceiverLink(
        QuietLine([RMC, b"", checked, b"", later, b""]), "receiver x", logging.getLogger()
    )
    seen, _ = recorded(tmp_path / "d", ManyBus(), receiver, rounds=4)

    logs = [(tmp_path / "d" / name).read_bytes() for name in ("can.log", "gnss.nmea")]
    assert (120, 120, 3) == (seen.frames, len(seen.identifiers), seen.sentences)
    assert [120, 3] == [log.count(b"\n") for log in logs]
    assert sum(map(len, logs)) == seen.bytes
    assert 27.21 * 1852.0 / 3600.0 == pytest.approx(seen.speed_mps)
    assert (4, "") == (seen.quality, seen.why)
    assert all(line.startswith(b"(1000.000000) $GN") for line in logs[1].splitlines())


def _sum(sentence: bytes) -> int:
    """The checksum of a sentence, as NMEA 0183 has it."""
    total = 0
    for byte in sentence[1 : sentence.index(b"*")]:
        total ^= byte
    return total


def test_before_anything_came_nothing_is_known() -> None:
    """Zeros, no speed, no reason to end."""
    seen = RecordingProgress()
    assert (0, set(), 0, 0, 0, 0.0, "") == (
        *(seen.frames, seen.identifiers, seen.sentences, seen.bytes),
        *(seen.quality, seen.frames_per_s, seen.why),
    )
    assert math.isnan(seen.speed_mps)


@pytest.mark.usefixtures("unwaiting")
def test_identifiers_are_counted_up_to_4096(tmp_path: Path) -> None:
    """A bus full of nonsense fills the disk, which is bounded, and not the memory."""
    seen, _ = recorded(tmp_path / "d", ManyBus(), rounds=140)
    assert (4200, set(range(4096))) == (seen.frames, seen.identifiers)


@pytest.mark.usefixtures("unwaiting")
@pytest.mark.parametrize(("channel", "name"), [("my bus", b"my_bus"), ("", b"can0"), ("vcan1", b"vcan1")])
def test_a_line_names_its_channel_in_one_word(tmp_path: Path, channel: str, name: bytes) -> None:
    """Readers of candump's format part at blanks."""
    recorded(tmp_path / "d", ManyBus(channel), rounds=1)
    assert {name} == {line.split()[1] for line in (tmp_path / "d" / "can.log").read_bytes().splitlines()}


@pytest.mark.usefixtures("unwaiting")
@pytest.mark.parametrize(("missing", "why"), [(0, ""), (1, "less than 200 MB are free on the disk")])
def test_two_hundred_megabytes_are_left_to_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: int, why: str
) -> None:
    """A disk with one block less ends the recording."""
    blocks = SimpleNamespace(f_bavail=200 * 256 - missing, f_frsize=4096)
    monkeypatch.setattr(os, "statvfs", lambda _: blocks)
    seen, times = recorded(tmp_path / "d", ManyBus(), rounds=3)

    assert (why, 1 if missing else 3) == (seen.why, len(times))


@pytest.mark.usefixtures("unwaiting")
def test_a_disk_that_fails_is_the_reason_and_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The line names folder and reason; links and files are closed all the same."""
    tries: list[int] = []
    reasons: list[tuple[int | str, ...]] = [(errno.EIO, "Input/output error"), ("odd",)]

    def flush(_: Appender) -> None:
        tries.append(0)
        raise OSError(*reasons[len(tries) - 1])

    monkeypatch.setattr(Appender, "flush", flush)
    for number, said in enumerate(("Input/output error", "odd"), 1):
        bus, line = ManyBus(), QuietLine([])
        folder = tmp_path / f"d{number}"
        seen, _ = recorded(folder, bus, ReceiverLink(line, "x", logging.getLogger()), rounds=3)
        assert (f"{folder}: {said}", number) == (seen.why, len(tries))
        assert (1, 1) == (bus.closed, line.closed)


@pytest.mark.usefixtures("unwaiting")
def test_lines_that_are_many_do_not_wait_for_the_second(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beyond the buffer they are handed to the system within the round, and not brought to the disk."""
    calls: list[str] = []
    monkeypatch.setattr("tpmsd.onboard.daemon.recorder.BUFFER_BYTES", 500)
    flush = Appender.flush
    monkeypatch.setattr(Appender, "sync", lambda _: calls.append("sync"))
    monkeypatch.setattr(Appender, "flush", lambda file: (calls.append("flush"), flush(file))[1])
    recorded(tmp_path / "d", ManyBus(), rounds=1, step_s=0.5)

    # 30 lines of 31 bytes and more: one flush in between, then the end; of two files each.
    assert ["flush", "flush", "flush", "sync", "flush", "sync"] == calls


def test_a_folder_that_was_there_is_left_when_nothing_came(tmp_path: Path) -> None:
    """Without the empty files; one that was made for the recording goes with them."""
    (tmp_path / "old").mkdir()
    for name in ("old", "new"):
        recorded(tmp_path / name, FakeBus())

    assert ["old"] == [path.name for path in tmp_path.iterdir()]
    assert [] == list((tmp_path / "old").iterdir())


class WakingBus(FakeBus):
    """A bus with a descriptor, on which something came."""

    def __init__(self) -> None:
        super().__init__()
        self.ends = socket.socketpair()
        self.ends[1].send(b"x")

    def fileno(self) -> int:
        return self.ends[0].fileno()


def test_what_comes_is_waited_for_no_longer_than_fifty_milliseconds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A descriptor that has something to say ends the wait at once; a stop is seen within it."""
    began_s = time.monotonic()
    recorded(tmp_path / "d", FakeBus())
    assert 0.09 <= time.monotonic() - began_s < 1.5
    monkeypatch.setattr("tpmsd.onboard.daemon.drive_recording.WAIT_S", 60.0)
    began_s = time.monotonic()
    recorded(tmp_path / "d", WakingBus())
    assert time.monotonic() - began_s < 30.0
