"""Writes what the daemon received as a drive folder, which `tpmsd replay` reads.

In: frames and sentences in the order in which the pipeline got them, with their stamps. Out: `can.log`,
`gnss.nmea`, `vehicle.toml`, `bus.dbc`. A full disk ends the recording, never the daemon.

A replay knows of time only by stamps. Where for a while nothing came, the daemon's own sense of time goes
into `gnss.nmea` as a proprietary sentence, `$PTPMSD`, which every reader of NMEA passes over: so a replay
makes the ticks of a silence as the daemon made them.
"""

from __future__ import annotations

import logging
import os
import shutil
from pathlib import Path

from tpmsd.car.config.model import Config
from tpmsd.foundation.errors import ConfigError
from tpmsd.onboard.daemon.config_toml import config_toml
from tpmsd.onboard.sources.can.frame import CanFrame

MARK = b"$PTPMSD"
BUFFER_BYTES = 1 << 18
"""Bytes kept back at most until the next flush, per file."""
_MAX_FOLDERS = 10_000

_log = logging.getLogger(__name__)


class Appender:
    """A file that is written in whole lines."""

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self._buffer = bytearray()
        self._size = 0

    def add(self, line: bytes) -> bool:
        """Buffer a line; return True if it is time to flush."""
        self._buffer += line
        return len(self._buffer) >= BUFFER_BYTES

    def flush(self) -> None:
        """Write the buffer; OSError leaves the file with whole lines."""
        whole = self._size + len(self._buffer)
        try:
            while self._buffer:
                del self._buffer[: os.write(self._descriptor, self._buffer)]
        except OSError:
            os.ftruncate(self._descriptor, self._size)
            raise
        self._size = whole

    def sync(self) -> None:
        """Force what was written onto the disk."""
        os.fsync(self._descriptor)

    def close(self) -> None:
        """Close the file; lines that were not flushed are lost."""
        os.close(self._descriptor)


class DriveRecorder:
    """One recording."""

    def __init__(self, folder: Path, config: Config) -> None:
        """Make the folder; where there is a drive in it already, one beside it with a number.

        ConfigError if it cannot be made.
        """
        try:
            self.folder = _free_folder(folder)
            (self.folder / "vehicle.toml").write_text(config_toml(config, "bus.dbc"), encoding="utf-8")
            shutil.copyfile(config.can.dbc, self.folder / "bus.dbc")
            self._can = Appender(self.folder / "can.log")
            self._nmea = Appender(self.folder / "gnss.nmea")
        except OSError as error:
            raise ConfigError(f"cannot record to {folder}: {error.strerror or error}") from None
        self._channel = "_".join(config.can.channel.split()) or "can0"
        self._others = {bus.channel: "_".join(bus.channel.split()) for bus in config.can.buses.values()}
        self.stopped = False

    def frame(self, frame: CanFrame) -> None:
        """Record a data frame."""
        if not self.stopped and self._can.add(
            candump_line(frame, self._others.get(frame.channel, self._channel))
        ):
            self.flush()

    def sentence(self, time_s: float, line: bytes) -> None:
        """Record a sentence."""
        if not self.stopped and self._nmea.add(b"(%.6f) %s\n" % (time_s, line)):
            self.flush()

    def mark(self, time_s: float) -> None:
        """Record that the daemon's time has advanced to `time_s`."""
        self.sentence(time_s, MARK)

    def flush(self) -> None:
        """Write the buffers; where that fails, stop recording."""
        if self.stopped:
            return
        try:
            self._can.flush()
            self._nmea.flush()
        except OSError as error:
            _log.error(
                "recording to %s ends here, the daemon goes on: %s", self.folder, error.strerror or error
            )
            self._stop()

    def close(self) -> None:
        """Write the rest and close."""
        self.flush()
        if not self.stopped:
            self._stop()

    def _stop(self) -> None:
        self.stopped = True
        self._can.close()
        self._nmea.close()


def candump_line(frame: CanFrame, channel: str) -> bytes:
    """Return a data frame as `candump -L` writes it, with its line end."""
    identifier = f"{frame.arbitration_id:08X}" if frame.is_extended else f"{frame.arbitration_id:03X}"
    separator = "##0" if frame.is_fd else "#"
    return b"(%.6f) %s %s%s%s\n" % (
        frame.time_s,
        channel.encode("utf-8"),
        identifier.encode("ascii"),
        separator.encode("ascii"),
        frame.data.hex().upper().encode("ascii"),
    )


def _free_folder(folder: Path) -> Path:
    """Return the first of `folder`, `folder`-2, ... in which there is no drive yet, made if need be."""
    for number in range(1, _MAX_FOLDERS + 1):
        candidate = folder if number == 1 else folder.with_name(f"{folder.name}-{number}")
        candidate.mkdir(parents=True, exist_ok=True)
        if not any((candidate / name).exists() for name in ("can.log", "gnss.nmea")):
            return candidate
    raise OSError(f"{_MAX_FOLDERS} recordings are there already")
