"""Play a simulated drive live: frames onto a CAN bus, sentences into a pseudo terminal.

In: a `SimulatedDrive`, an open python-can bus, a `PtyPort`. Out: traffic at its own pace, or faster. Every
frame and sentence has an absolute deadline, so that the pace does not drift. Frames carry the drive's host
time as their time stamp (python-can's `virtual` bus hands it on with `preserve_timestamps=True`);
`LivePlayer.now` is that clock.
"""

from __future__ import annotations

import contextlib
import errno
import os
import pty
import threading
import time
import tty
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import can
import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.errors import ConfigError, TpmsdError
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.simulator.drive import SimulatedDrive

_GLANCE_S = 0.25
_HELD_UP_S = 0.02
"""Lateness beyond which a frame is not sent any more if the next one of its message is due as well, s."""


class PtyPort:
    """A pseudo terminal that looks like a receiver's serial port; its reader opens `path`.

    Writing never blocks: what nobody reads is dropped and counted, as on a real serial line. With `link`, a
    symbolic link of that name points to it for as long as it is open. TpmsdError if the system gives none.
    """

    def __init__(self, link: str | Path | None = None) -> None:
        try:
            # The slave is kept open: a reader that comes and goes must not hang up the line.
            self._master, self._slave = pty.openpty()
        except OSError as error:
            raise TpmsdError(f"no pseudo terminal to be had: {error.strerror}") from None
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        self.dropped_bytes = 0
        self._link = Path(link) if link is not None else None
        if self._link is not None:
            try:
                if self._link.is_symlink():
                    self._link.unlink()
                self._link.symlink_to(self.path)
            except OSError as error:
                self._link = None
                self.close()
                raise TpmsdError(f"{link}: cannot be made a link to {self.path}: {error.strerror}") from None

    def write(self, data: bytes) -> None:
        """Send bytes to the reader; what does not fit into the line's buffer is dropped."""
        try:
            sent = os.write(self._master, data)
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EIO):
                raise
            sent = 0
        self.dropped_bytes += len(data) - sent

    def close(self) -> None:
        """Close the port; the reader sees the receiver being unplugged."""
        for fd in (self._master, self._slave):
            with contextlib.suppress(OSError):
                os.close(fd)
        if self._link is not None:
            self._link.unlink(missing_ok=True)

    def __enter__(self) -> PtyPort:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


@dataclass(slots=True)
class PlayStats:
    """Progress of a player so far."""

    frames: int = 0
    sentences: int = 0
    send_errors: int = 0
    """Frames that the bus did not take (down, or its queue full)."""
    overtaken: int = 0
    """Frames that were not sent, since the next of their message was due by then."""
    worst_lateness_s: float = 0.0
    """Largest lateness behind a deadline, in wall-clock time, s."""


class LivePlayer:
    """Plays one drive; in the caller's thread by `play()`, or in its own by `start()`, `stop()`, `join()`.

    `monotonic` is the clock and `speedup` how many seconds of drive pass in one of its seconds.

    With `newest_only` a player that was held up sends what is current and leaves out what it missed, as an
    ECU does, whose message has one buffer that its newest values overwrite. Otherwise it sends all of it at
    once, which only a listener that goes by the frames' own stamps can take for a car.
    """

    def __init__(
        self,
        drive: SimulatedDrive,
        bus: can.BusABC,
        port: PtyPort | None = None,
        *,
        speedup: float = 1.0,
        monotonic: Callable[[], float] = time.monotonic,
        progress: Callable[[float], None] | None = None,
        newest_only: bool = False,
    ) -> None:
        if not 0.01 <= speedup <= 10_000:
            raise ConfigError(f"speed-up {speedup:g} is outside 0.01 to 10000")
        self._drive = drive
        self._bus = bus
        self._port = port
        self._speedup = speedup
        self._monotonic = monotonic
        self._progress = progress
        self._newest_only = newest_only
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._failure: BaseException | None = None
        self._began: float | None = None
        self.start_host_s = float(drive.spec.clocks.host_s(np.zeros(1))[0])
        self.stats = PlayStats()

    def now(self) -> float:
        """Return the drive's host clock at this moment (its start, until playing begins)."""
        began = self._began
        if began is None:
            return self.start_host_s
        return self.start_host_s + (self._monotonic() - began) * self._speedup

    def play(self) -> PlayStats:
        """Play to the end or until `stop()`; TpmsdError only if the pseudo terminal breaks."""
        frames, nmea = self._drive.frames, self._drive.nmea
        frame_times = frames.time_s
        nmea_times = np.array([line.time_s for line in nmea])
        times = np.concatenate([frame_times, nmea_times])
        order = np.argsort(times, kind="stable")
        again = _next_due_times(frame_times, frames.frame_id)
        self._began = self._monotonic()
        for index in order.tolist():
            if not self._wait_until(float(times[index])):
                break
            if index < len(frames):
                if self._newest_only and self._is_superseded(float(frame_times[index]), float(again[index])):
                    self.stats.overtaken += 1
                    continue
                self._send_frame(
                    float(times[index]), int(frames.frame_id[index]), frames.data[index].tobytes()
                )
            elif self._port is not None:
                self._port.write(nmea[index - len(frames)].text.encode("ascii") + b"\r\n")
                self.stats.sentences += 1
        return self.stats

    def start(self) -> None:
        """Play in a thread of its own."""
        if self._thread is not None:
            raise RuntimeError("this player was started before")
        self._thread = threading.Thread(target=self._run_thread, name="tpmsd-live-player", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the playing at once; does nothing when it has ended."""
        self._stop.set()

    def join(self, timeout_s: float | None = None) -> bool:
        """Wait for the end; return True if it has come. Raises the exception that ended the player, if
        any.
        """
        if self._thread is not None:
            self._thread.join(timeout_s)
        if self._failure is not None:
            raise self._failure
        return self._thread is None or not self._thread.is_alive()

    def _run_thread(self) -> None:
        try:
            self.play()
        except BaseException as failure:  # handed to whoever joins: a thread has nobody else to tell
            self._failure = failure

    def _wait_until(self, host_s: float) -> bool:
        """Wait until a time of the drive; return False if the player was stopped."""
        began = self._began if self._began is not None else 0.0
        deadline = began + (host_s - self.start_host_s) / self._speedup
        while (ahead := deadline - self._monotonic()) > 0:
            if self._progress is not None:
                self._progress(self.now() - self.start_host_s)
            if self._stop.wait(min(ahead, _GLANCE_S)):
                return False
        self.stats.worst_lateness_s = max(self.stats.worst_lateness_s, -ahead)
        return not self._stop.is_set()

    def _is_superseded(self, host_s: float, again_s: float) -> bool:
        """Return whether a frame is late and the next one of its identifier is already due."""
        now_s = self.now()
        return now_s - host_s > _HELD_UP_S * self._speedup and again_s <= now_s

    def _send_frame(self, host_s: float, frame_id: int, data: bytes) -> None:
        message = can.Message(
            timestamp=host_s, arbitration_id=frame_id, is_extended_id=frame_id > 0x7FF, data=data
        )
        try:
            self._bus.send(message)
        except can.CanOperationError:
            # A bus that is down or full loses frames; the drive goes on, as a real one would.
            self.stats.send_errors += 1
        else:
            self.stats.frames += 1


def _next_due_times(time_s: FloatArray, frame_id: NDArray[np.int64]) -> FloatArray:
    """Return the (n,) times at which the next frame of the same identifier is due; infinite for the
    last one.
    """
    out = np.full(len(time_s), np.inf)
    for one in np.unique(frame_id):
        at = np.flatnonzero(frame_id == one)
        at = at[np.argsort(time_s[at], kind="stable")]
        out[at[:-1]] = time_s[at[1:]]
    return out
