"""The GNSS receiver as the loop sees it: open, or unplugged and tried again.

In: a function that makes the serial line. Out: sentences, each with the time at which its first byte
came. Never raises for anything that a receiver can do.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Protocol

from tpmsd.config.model import GnssConfig
from tpmsd.daemon.link import Link
from tpmsd.sources.nmea_framer import NmeaFramer
from tpmsd.sources.serial_live import ReceiverGone, SerialReceiver

READS_AT_ONCE = 64
"""Enough for all that a serial line can hold back; a device that never ends must not stop the loop."""


class Receiver(Protocol):
    """An open serial line, as `SerialReceiver`."""

    def open(self) -> None:
        """Open; raises `ReceiverGone`."""

    def fileno(self) -> int:
        """Descriptor to wait on."""

    def read(self) -> bytes:
        """What has arrived; raises `ReceiverGone`."""

    def close(self) -> None:
        """Close."""


OpenReceiver = Callable[[GnssConfig], Receiver]


def serial_receiver(config: GnssConfig) -> Receiver:
    """The serial line of the configuration, not opened yet."""
    return SerialReceiver(config.device or "", config.baud)


class ReceiverLink(Link):
    """One receiver."""

    def __init__(self, receiver: Receiver, label: str, log: logging.Logger) -> None:
        super().__init__(label, log)
        self._receiver = receiver
        self._framer = NmeaFramer()
        self._begun_s = 0.0
        """When the unfinished line began."""
        self._told_baud = False

    @property
    def sentences(self) -> int:
        """Lines handed out so far."""
        return self._framer.counts["lines"]

    @property
    def overlong(self) -> int:
        """Lines given up because they did not end."""
        return self._framer.counts["overlong"]

    @property
    def hint(self) -> str:
        """What may be wrong with an open line; empty if nothing seems to be."""
        return "bytes but no sentence: wrong baud rate?" if self._framer.wrong_baud else ""

    def fileno(self) -> int | None:
        """Descriptor to wait on; None if it is down."""
        if not self._is_open:
            return None
        try:
            return self._receiver.fileno()
        except ReceiverGone:
            return None

    def service(self, now_s: float) -> None:
        """Open it if that is due."""
        if self._is_open or now_s < self._next_try_s:
            return
        try:
            self._receiver.open()
        except ReceiverGone as error:
            self._failed(now_s, error.reason)
        else:
            self._framer.reset()
            self._opened(now_s)

    def read(self, now_s: float, stamp_s: float) -> list[tuple[float, bytes]]:
        """Lines completed by what is there, each with the time of its first byte; `stamp_s`: host time."""
        lines: list[tuple[float, bytes]] = []
        for _ in range(READS_AT_ONCE):
            if not self._is_open:
                break
            try:
                data = self._receiver.read()
            except ReceiverGone as error:
                self._receiver.close()
                self._failed(now_s, error.reason)
                break
            self._well(now_s, bool(data))
            if not data:
                break
            lines += self._stamped(data, stamp_s)
        if self.hint and not self._told_baud:
            self._told_baud = True
            self._log.warning("%s: %s", self.label, self.hint)
        elif lines:
            self._told_baud = False
        return lines

    def _stamped(self, data: bytes, stamp_s: float) -> list[tuple[float, bytes]]:
        # A line that is not whole in this piece began in an earlier one.
        lines = [(stamp_s if line in data else self._begun_s, line) for line in self._framer.feed(data)]
        if b"$" in data[max(data.rfind(b"\n"), data.rfind(b"\r")) + 1 :]:
            self._begun_s = stamp_s
        return lines

    def close(self) -> None:
        """Give the line back for good."""
        if self._is_open:
            self._is_open = False
            self.generation += 1
            self._receiver.close()
