"""Signals as something to wait for: a descriptor beside the others.

In: SIGTERM, SIGINT, SIGHUP. Out: a descriptor that becomes readable, and the signals' numbers.
"""

from __future__ import annotations

import contextlib
import signal
import socket
from types import FrameType, TracebackType
from typing import Any

STOP_SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
"""All three end the daemon in order; a hang-up is the terminal going away."""


class SignalPipe:
    """A context manager for the main thread; what was installed before is put back at its end."""

    _wakeup: int
    """Descriptor that was woken up before."""

    def __init__(self) -> None:
        self._reader, self._writer = socket.socketpair()
        self._reader.setblocking(False)
        self._writer.setblocking(False)
        self._handlers: dict[signal.Signals, Any] = {}

    def fileno(self) -> int:
        """Return the descriptor, which is readable when a signal has come."""
        return self._reader.fileno()

    def read(self) -> list[signal.Signals]:
        """Return the signals that have come since."""
        numbers = b""
        with contextlib.suppress(BlockingIOError):
            numbers = self._reader.recv(4096)
        return [signal.Signals(number) for number in numbers if number in STOP_SIGNALS]

    def __enter__(self) -> SignalPipe:
        # No warning on a full buffer: one byte that says "stop" is enough.
        self._wakeup = signal.set_wakeup_fd(self._writer.fileno(), warn_on_full_buffer=False)
        for number in STOP_SIGNALS:
            if signal.getsignal(number) is not signal.SIG_IGN:  # what nohup has switched off stays off
                self._handlers[number] = signal.signal(number, _ignore_signal)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._wakeup)
        self._reader.close()
        self._writer.close()


def _ignore_signal(number: int, frame: FrameType | None) -> None:
    """Do nothing: the byte on the descriptor is the message, and the default handler would end the
    process."""
