"""Records CAN and the receiver side by side, before there is a configuration: what `tpmsd record` runs.

In: open links, a clock, limits. Out: `can.log` and `gnss.nmea` in the drive format, with host stamps;
figures of what is
seen. Whole lines are handed to the system every second and to the disk every `SYNC_S`, so that a power
loss costs some seconds at the end and nothing before.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from tpmsd.foundation.errors import TpmsdError
from tpmsd.onboard.daemon.bus_link import BusLink
from tpmsd.onboard.daemon.descriptors import Descriptors
from tpmsd.onboard.daemon.receiver_link import ReceiverLink
from tpmsd.onboard.daemon.recorder import Appender, candump_line
from tpmsd.onboard.sources.events import GnssFix
from tpmsd.onboard.sources.gnss.nmea_epoch import NmeaAssembler

CAN_LOG, NMEA_LOG = "can.log", "gnss.nmea"
SYNC_S = 5.0
FLUSH_S = 1.0
WAIT_S = 0.05
FREE_BYTES = 200 << 20
"""Room that is left on the disk for others."""


class RecordingError(TpmsdError):
    """The recording cannot begin, or cannot go on."""


@dataclass(slots=True)
class RecordingProgress:
    """Frames, identifiers, sentences and bytes recorded so far, with the last speed and fix quality."""

    frames: int = 0
    identifiers: set[int] = field(default_factory=set)
    sentences: int = 0
    bytes: int = 0
    speed_mps: float = float("nan")
    quality: int = 0
    frames_per_s: float = 0.0
    why: str = ""
    """Reason for which it ended by itself; empty where it was asked to."""


class DriveRecording:
    """One recording into a folder that holds none yet."""

    def __init__(
        self,
        folder: Path,
        bus: BusLink,
        receiver: ReceiverLink | None,
        now: Callable[[], float],
        monotonic: Callable[[], float],
        max_bytes: int,
    ) -> None:
        """RecordingError where the folder cannot be made or holds a recording already."""
        self._new_folder = not folder.exists()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._can = Appender(folder / CAN_LOG)
            self._nmea = Appender(folder / NMEA_LOG)
        except FileExistsError:
            raise RecordingError(f"{folder}: holds a recording already; name another folder") from None
        except OSError as error:
            raise RecordingError(f"{folder}: {error.strerror or error}") from None
        self._folder, self._bus, self._receiver = folder, bus, receiver
        self._now, self._monotonic, self._max_bytes = now, monotonic, max_bytes
        self._assembler = NmeaAssembler()
        self.seen = RecordingProgress()

    def run(
        self, stopped: Callable[[], bool], report: Callable[[RecordingProgress], None], duration_s: float
    ) -> RecordingProgress:
        """Record until `stopped`, the time or a limit; `report` is called once a second."""
        descriptors = Descriptors()
        start_s = flushed_s = synced_s = self._monotonic()
        frames_before = 0
        try:
            while not stopped() and not self.seen.why:
                monotonic_s = self._monotonic()
                if monotonic_s - start_s >= duration_s:
                    break
                self._bus.service(monotonic_s)
                descriptors.follow(self._bus)
                if self._receiver is not None:
                    self._receiver.service(monotonic_s)
                    descriptors.follow(self._receiver)
                descriptors.wait(WAIT_S)
                self._collect_input(monotonic_s)
                if monotonic_s - flushed_s >= FLUSH_S:
                    self.seen.frames_per_s = (self.seen.frames - frames_before) / (monotonic_s - flushed_s)
                    flushed_s, frames_before = monotonic_s, self.seen.frames
                    self._flush_files(sync=monotonic_s - synced_s >= SYNC_S)
                    synced_s = monotonic_s if monotonic_s - synced_s >= SYNC_S else synced_s
                    report(self.seen)
        finally:
            self._flush_files(sync=True)
            self._can.close()
            self._nmea.close()
            self._bus.close()
            if self._receiver is not None:
                self._receiver.close()
            descriptors.close()
            if not self.seen.bytes:
                self._remove_empty()
        return self.seen

    def _remove_empty(self) -> None:
        """Remove the files of a recording in which nothing was received, and the folder made for them."""
        with contextlib.suppress(OSError):
            for name in (CAN_LOG, NMEA_LOG):
                (self._folder / name).unlink(missing_ok=True)
            if self._new_folder:
                self._folder.rmdir()

    def _collect_input(self, monotonic_s: float) -> None:
        """Read bus and receiver, and add to the files and the progress."""
        seen = self.seen
        for frame in self._bus.read(monotonic_s):
            line = candump_line(frame, "_".join(frame.channel.split()) or "can0")
            seen.frames += 1
            seen.bytes += len(line)
            if len(seen.identifiers) < 4096:
                seen.identifiers.add(frame.arbitration_id)
            if self._can.add(line):
                self._flush_files(sync=False)
        if self._receiver is None:
            return
        for stamp_s, sentence in self._receiver.read(monotonic_s, self._now()):
            line = b"(%.6f) %s\n" % (stamp_s, sentence)
            seen.sentences += 1
            seen.bytes += len(line)
            self._nmea.add(line)
            for event in self._assembler.feed(stamp_s, sentence):
                if isinstance(event, GnssFix):
                    seen.speed_mps, seen.quality = event.speed_mps, event.quality

    def _flush_files(self, sync: bool) -> None:
        """Write the buffers, and set the reason to stop if that fails or a limit is reached."""
        if self.seen.why:
            return
        try:
            for appender in (self._can, self._nmea):
                appender.flush()
                if sync:
                    appender.sync()
            room = os.statvfs(self._folder)
        except OSError as error:
            self.seen.why = f"{self._folder}: {error.strerror or error}"
            return
        if self.seen.bytes >= self._max_bytes:
            self.seen.why = f"{self._max_bytes >> 20} MB are full (--max-mb)"
        elif room.f_bavail * room.f_frsize < FREE_BYTES:
            self.seen.why = f"less than {FREE_BYTES >> 20} MB are free on the disk"
