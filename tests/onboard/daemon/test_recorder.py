"""The recording of a live run: what is in it, and what a full disk does."""

from __future__ import annotations

import errno
import logging
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.onboard.daemon.fakes import car, wheels_frame
from tpmsd.car.config.load import load_config
from tpmsd.foundation.errors import ConfigError
from tpmsd.onboard.daemon.config_toml import config_toml
from tpmsd.onboard.daemon.journal import JournalFormatter
from tpmsd.onboard.daemon.recorder import Appender, DriveRecorder, candump_line
from tpmsd.onboard.sources.can.candump_line import parse_candump_line
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.drive import FolderStream, Sentence


@settings(derandomize=True, deadline=None)
@given(
    stamp_us=st.integers(0, 2**50),
    identifier=st.integers(0, 0x1FFFFFFF),
    extended=st.booleans(),
    fd=st.booleans(),
    data=st.binary(max_size=64),
)
def test_a_recorded_frame_is_read_back_as_it_was(
    stamp_us: int, identifier: int, extended: bool, fd: bool, data: bytes
) -> None:
    """Stamp, identifier, format and data of any data frame survive the log."""
    stamp_s = round(stamp_us / 1e6, 6)
    frame = CanFrame(
        stamp_s,
        "can0",
        identifier if extended else identifier & 0x7FF,
        extended,
        fd,
        False,
        False,
        data if fd else data[:8],
    )

    assert frame == parse_candump_line(candump_line(frame, "can0").decode("ascii").rstrip("\n"))


def test_a_recording_is_a_drive(tmp_path: Path) -> None:
    """What was recorded comes back in the same order with the same stamps, marks of time as sentences."""
    config, _ = car(tmp_path / "car")
    recorder = DriveRecorder(tmp_path / "drives" / "monday", config)
    frames = [wheels_frame(1000.000001 + 0.02 * k, 0.1 * k) for k in range(3)]
    recorder.mark(999.5)
    recorder.frame(frames[0])
    recorder.sentence(1000.01, b"$GNRMC,1")
    recorder.frame(frames[1])
    recorder.frame(frames[2])
    recorder.close()

    items = [item if isinstance(item, Sentence) else item.time_s for item in FolderStream(recorder.folder)]
    assert [
        Sentence(999.5, b"$PTPMSD", 1),
        1000.000001,
        Sentence(1000.01, b"$GNRMC,1", 2),
        1000.020001,
        1000.040001,
    ] == items
    assert replace(config, file=None) == replace(load_config(recorder.folder), file=None, can=config.can)
    assert (tmp_path / "car" / "bus.dbc").read_bytes() == (recorder.folder / "bus.dbc").read_bytes()


def test_everything_configured_is_recorded(tmp_path: Path) -> None:
    """The recorded vehicle.toml holds every value with which the daemon ran, given or not."""
    extra = (
        '[gnss]\ndevice = "/dev/gps \\"0\\""\nlatency_s = 0.1\n'
        "[monitor]\nlearn_s = 33.3\ndeflation_pressure_percent = 15\n"
        '[tyre]\nsize = "205/60R15"\ncurve_pressure_percent = [10, 20]\ncurve_radius_mm = [0.6, 1.4]\n'
        "[alarms]\nextended_ids = true\nstatus_id = 0x18FF1234\n"
        '[calibration]\nmade = "2024-07-01"\nmethod = "joint"\ndrives = "a, b"\nradius_std_rl_m = 0.0001\n'
        "[dynamics]\nmass_kg = 1400\nyaw_inertia_kgm2 = 2400\ncg_to_front_m = 1.2\ncg_to_rear_m = 1.4\n"
        "cornering_stiffness_front_n_per_rad = 9e4\ncornering_stiffness_rear_n_per_rad = 1e5\n"
        "[vehicle_state]\nparticles = 50\n"
    )
    config, _ = car(tmp_path, extra)
    config = replace(
        config,
        vehicle=replace(config.vehicle, wheel_radius_m=(0.31, 0.311, 0.32, 1 / 3), steering_ratio=15.1),
        state=replace(config.state, file=None),
    )
    (tmp_path / "again.toml").write_text(config_toml(config, "bus.dbc"), encoding="utf-8")

    assert replace(config, file=None) == replace(load_config(tmp_path / "again.toml"), file=None)


def test_recordings_do_not_overwrite_each_other(tmp_path: Path) -> None:
    """A daemon that is started again with the same folder records beside the first drive."""
    config, _ = car(tmp_path / "car")
    names = []
    for _ in range(3):
        recorder = DriveRecorder(tmp_path / "drive", config)
        recorder.close()
        names.append(recorder.folder.name)

    assert ["drive", "drive-2", "drive-3"] == names


def test_a_folder_that_cannot_be_made_is_a_wrong_usage(tmp_path: Path) -> None:
    """One line says that it cannot be recorded there, and why."""
    config, _ = car(tmp_path / "car")
    (tmp_path / "file").write_text("")

    with pytest.raises(ConfigError, match=r"cannot record to .*file/drive: Not a directory"):
        DriveRecorder(tmp_path / "file" / "drive", config)


@contextmanager
def small_disk(limit_bytes: int) -> Iterator[None]:
    """No file of this process may become greater."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_ends_the_recording_with_whole_lines(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Once nothing more can be written the recorder says so once, stops, and leaves what was whole."""
    config, _ = car(tmp_path / "car")
    recorder = DriveRecorder(tmp_path / "drive", config)
    with small_disk(2000):
        for second in range(10):
            for k in range(10):
                recorder.frame(wheels_frame(1000.0 + second + 0.1 * k))
            recorder.flush()
        recorder.close()

    log = (tmp_path / "drive" / "can.log").read_text("ascii")
    assert recorder.stopped
    assert log.endswith("\n")
    assert 50 == len(log.splitlines())  # five seconds of 390 bytes; the sixth was taken back
    assert all(parse_candump_line(line) is not None for line in log.splitlines())
    assert [f"recording to {tmp_path / 'drive'} ends here, the daemon goes on: File too large"] == [
        record.getMessage() for record in caplog.records
    ]


def test_a_write_that_breaks_off_within_a_line_leaves_the_lines_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A failed flush leaves the file as the last whole flush did, also if part of a line was written."""
    file = Appender(tmp_path / "log")
    file.add(b"first line\n")
    file.flush()
    real = os.write

    def write(descriptor: int, data: bytes) -> int:
        if len(data) < 9:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(descriptor, bytes(data[:4]))

    file.add(b"second line\n")
    monkeypatch.setattr(os, "write", write)
    with pytest.raises(OSError, match="No space"):
        file.flush()
    assert b"first line\n" == (tmp_path / "log").read_bytes()
    file.close()


def test_the_priorities_of_the_journal_are_those_of_syslog() -> None:
    """RFC 5424: critical 2, error 3, warning 4, informational 6, debug 7; a level between has that below."""
    levels = (logging.CRITICAL, logging.ERROR, logging.WARNING, logging.INFO, logging.DEBUG, 35)
    lines = [
        JournalFormatter("%(message)s").format(logging.LogRecord("tpmsd", level, "", 0, "a\nb", (), None))
        for level in levels
    ]
    assert [f"<{number}>a b" for number in (2, 3, 4, 6, 7, 4)] == lines


def test_lines_are_held_up_to_a_quarter_of_a_megabyte(tmp_path: Path) -> None:
    """From 2^18 bytes on it is time to flush."""
    file = Appender(tmp_path / "log")
    assert not file.add(bytes((1 << 18) - 1))
    assert file.add(b"\n")
    file.close()


def test_a_log_is_for_all_to_read_and_for_the_owner_to_write(tmp_path: Path) -> None:
    """As the umask of a service leaves it."""
    before = os.umask(0o022)
    try:
        Appender(tmp_path / "log").close()
    finally:
        os.umask(before)
    assert 0o644 == (tmp_path / "log").stat().st_mode & 0o777


def test_a_failed_flush_leaves_all_flushes_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also the second one: the file ends where the last whole flush ended."""
    file = Appender(tmp_path / "log")
    for line in (b"eleven byte\n", b"another one\n"):
        file.add(line)
        file.flush()

    def write(descriptor: int, data: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    file.add(b"third\n")
    monkeypatch.setattr(os, "write", write)
    with pytest.raises(OSError, match="No space"):
        file.flush()
    assert b"eleven byte\nanother one\n" == (tmp_path / "log").read_bytes()
    file.close()


def test_frames_and_sentences_are_written_once_they_are_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before that, and after the recording has ended, nothing is."""
    config, _ = car(tmp_path / "car")
    monkeypatch.setattr("tpmsd.onboard.daemon.recorder.BUFFER_BYTES", 100)
    for name, line_bytes in (("can.log", 40), ("gnss.nmea", 23)):
        recorder = DriveRecorder(tmp_path / name, config)
        sizes = []
        for _ in range(6):
            if name == "can.log":
                recorder.frame(wheels_frame(1000.0))
            else:
                recorder.sentence(1000.0, b"$GNRMC,1")
            sizes.append((recorder.folder / name).stat().st_size)
        recorder.close()
        enough = -(-100 // line_bytes)
        assert [number // enough * enough * line_bytes for number in range(1, 7)] == sizes
        recorder.frame(wheels_frame(1000.0))
        recorder.sentence(1000.0, b"$GNRMC,1")
        recorder.close()
        assert 6 * line_bytes == (recorder.folder / name).stat().st_size


def test_each_bus_is_recorded_under_its_channel(tmp_path: Path) -> None:
    """Blanks in a channel's name would end it in the log."""
    config, _ = car(tmp_path / "car", '[can.buses]\nbody = "second bus"\n', channel="first bus")
    recorder = DriveRecorder(tmp_path / "drive", config)
    for channel in ("first bus", "second bus"):
        recorder.frame(wheels_frame(1000.0)._replace(channel=channel))
    recorder.close()

    lines = (recorder.folder / "can.log").read_text("ascii").splitlines()
    assert ["first_bus", "second_bus"] == [line.split()[1] for line in lines]


@pytest.mark.parametrize("name", ["can.log", "gnss.nmea"])
def test_half_a_drive_is_one_already(tmp_path: Path, name: str) -> None:
    """A folder that holds one of the two files is not recorded into."""
    config, _ = car(tmp_path / "car")
    (tmp_path / "drive").mkdir()
    (tmp_path / "drive" / name).write_text("", "utf-8")
    recorder = DriveRecorder(tmp_path / "drive", config)
    recorder.close()

    assert "drive-2" == recorder.folder.name


def test_ten_thousand_recordings_are_the_most(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Then no more folders are looked at, and the line says why."""
    config, _ = car(tmp_path / "car")
    looked: list[str] = []
    monkeypatch.setattr(Path, "mkdir", lambda folder, **_: looked.append(folder.name))
    monkeypatch.setattr(Path, "exists", lambda _: True)

    with pytest.raises(ConfigError, match=r"cannot record to .*drive: 10000 recordings are there already"):
        DriveRecorder(tmp_path / "drive", config)
    assert (["drive", "drive-2"], "drive-10000", 10_000) == (looked[:2], looked[-1], len(looked))
