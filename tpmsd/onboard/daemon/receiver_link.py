"""The GNSS receiver as the loop sees it: open, or unplugged and tried again.

In: what opens the line, and what takes its bytes apart. Out: sentences, each with the time at which its first
byte came. Never raises for anything that a receiver can do.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Protocol

from tpmsd.car.config.gnss_source import source_of
from tpmsd.car.config.model import GnssConfig
from tpmsd.onboard.daemon.link import Link
from tpmsd.onboard.sources.gnss.gpsd_json import WATCH
from tpmsd.onboard.sources.gnss.net_live import TcpReceiver, UdpReceiver
from tpmsd.onboard.sources.gnss.serial_live import ReceiverGone, SerialReceiver
from tpmsd.onboard.sources.gnss.stream import GnssStream, GpsdStream, NmeaStream

READS_AT_ONCE = 64
"""Enough for all that a line can hold back; a device that never ends must not stop the loop."""


class Receiver(Protocol):
    """A line to a receiver, as `SerialReceiver`, `TcpReceiver` and `UdpReceiver`."""

    def open(self) -> None:
        """Open; raises `ReceiverGone`."""

    def fileno(self) -> int:
        """Return the descriptor to wait on."""

    def read(self) -> bytes:
        """Return the bytes that have arrived; raises `ReceiverGone`."""

    def close(self) -> None:
        """Close the receiver's connection."""


OpenReceiver = Callable[[GnssConfig], Receiver]


def configured_receiver(config: GnssConfig) -> Receiver:
    """Return the configured receiver (serial line, TCP, UDP or gpsd), not opened yet."""
    source = source_of(config)
    if source is None or source.kind in ("serial", "can"):
        return SerialReceiver("" if source is None else source.path, config.baud)
    if source.kind == "udp":
        return UdpReceiver(source.label, source.host, source.port)
    greeting = WATCH if source.kind == "gpsd" else b""
    return TcpReceiver(source.label, source.host, source.port, greeting)


def configured_stream(config: GnssConfig) -> GnssStream:
    """Return the stream that turns the receiver's bytes into sentences."""
    source = source_of(config)
    return GpsdStream() if source is not None and source.kind == "gpsd" else NmeaStream()


class ReceiverLink(Link):
    """One receiver."""

    def __init__(
        self, receiver: Receiver, label: str, log: logging.Logger, stream: GnssStream | None = None
    ) -> None:
        """`stream`: what takes the bytes apart; None: NMEA."""
        super().__init__(label, log)
        self._receiver = receiver
        self._stream: GnssStream = NmeaStream() if stream is None else stream
        self._logged_hint = ""

    @property
    def sentences(self) -> int:
        """Lines handed out so far."""
        return self._stream.lines

    @property
    def overlong(self) -> int:
        """Lines given up because they did not end."""
        return self._stream.overlong

    @property
    def hint(self) -> str:
        """Possible fault of an open line, in words; empty if nothing is found."""
        return self._stream.hint

    def fileno(self) -> int | None:
        """Return the descriptor to wait on; None if it is down."""
        if not self._is_open:
            return None
        try:
            return self._receiver.fileno()
        except ReceiverGone:
            return None

    def service(self, now_s: float) -> None:
        """Open the receiver if an attempt is due."""
        if self._is_open or now_s < self._next_try_s:
            return
        try:
            self._receiver.open()
        except ReceiverGone as error:
            self._note_failure(now_s, error.reason)
        else:
            self._stream.reset()
            self._note_opened(now_s)

    def read(self, now_s: float, stamp_s: float) -> list[tuple[float, bytes]]:
        """Return the lines completed by the bytes that have arrived, each with the time of its first byte;
        `stamp_s`: host time."""
        lines: list[tuple[float, bytes]] = []
        for _ in range(READS_AT_ONCE):
            if not self._is_open:
                break
            try:
                data = self._receiver.read()
            except ReceiverGone as error:
                self._receiver.close()
                self._note_failure(now_s, error.reason)
                break
            self._note_working(now_s, bool(data))
            if not data:
                break
            lines += self._stream.feed(data, stamp_s)
        hint = self.hint
        if hint and hint != self._logged_hint:
            self._logged_hint = hint
            self._log.warning("%s: %s", self.label, hint)
        elif lines:
            self._logged_hint = ""
        return lines

    def close(self) -> None:
        """Close the receiver for good."""
        if self._is_open:
            self._is_open = False
            self.generation += 1
            self._receiver.close()
