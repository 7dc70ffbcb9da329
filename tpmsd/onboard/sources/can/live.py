"""A CAN interface, read without ever waiting.

In: interface and channel from the configuration, the filters of `can_filters`. Out: `CanFrame`s as they come,
and frames sent. Everything that can go wrong is a `CanDown` of one line, upon which the caller closes, backs
off and opens again.

    SocketCAN           filters in the kernel, its time stamps, its count of frames dropped while nobody read
    any other backend   through python-can's `recv`; filters in the adapter where it has some, else here
"""

from __future__ import annotations

import contextlib
import errno
import socket
import struct
import time
from typing import Any, Protocol

import can

from tpmsd.car.config.model import CanConfig
from tpmsd.foundation.errors import TpmsdError
from tpmsd.onboard.sources.can.frame import CanFrame

RECEIVE_BUFFER_BYTES = 4 << 20
"""Asked for; without privileges the kernel gives what net.core.rmem_max allows. Its default of about 200 kB
holds 280 frames, which is 0.1 s of a busy bus."""

_SO_RCVBUFFORCE = 33
_SO_RXQ_OVFL = 40
_SO_TIMESTAMPNS = 35
"""Linux's numbers (asm-generic/socket.h); Python's socket module does not have them all."""

_HEADER = struct.Struct("=IBBBB")
"""struct can_frame and canfd_frame of linux/can.h: identifier with flags, length, FD flags, two reserved."""
_TIMESPEC = struct.Struct("@ll")
_COUNT = struct.Struct("@I")
_CLASSIC_BYTES, _FD_BYTES = 16, 72
_EXTENDED, _REMOTE, _ERROR = 0x80000000, 0x40000000, 0x20000000
_ANCILLARY_BYTES = socket.CMSG_SPACE(_TIMESPEC.size) + socket.CMSG_SPACE(_COUNT.size)


class CanDown(TpmsdError, OSError):  # noqa: N818  (a state of the bus that passes, not a mistake)
    """The bus cannot be opened, was lost, or accepts nothing; opening it again later may succeed."""

    def __init__(self, channel: str, reason: str) -> None:
        self.channel = channel
        self.reason = reason
        super().__init__(f"CAN {channel}: {reason}")


class _Bus(Protocol):
    """Members of a python-can bus that are used."""

    def recv(self, timeout: float | None = None) -> can.Message | None: ...

    def send(self, msg: can.Message, timeout: float | None = None) -> None: ...

    def shutdown(self) -> None: ...

    def fileno(self) -> int: ...


_NO_FRAME = "could not unpack received message"
"""python-can's word for a datagram on its udp_multicast bus that holds no frame."""
_MULTICAST_EXTRA = " (pip install 'tpmsd[multicast]')"
"""The extra that brings what python-can's udp_multicast bus needs."""
MAX_SKIPPED = 10_000
"""Frames that nobody wants, and datagrams that are none, that are passed over in one look."""


class LiveCan:
    """One open CAN interface."""

    def __init__(
        self,
        config: CanConfig,
        filters: list[dict[str, Any]] | None = None,
        channel: str | None = None,
        bus: _Bus | None = None,
    ) -> None:
        """Open the interface; `CanDown` if that fails.

        `filters`: what `can_filters` gives; None for all frames. `channel`: instead of the configuration's.
        `bus`: an open bus to take instead (then the filters are its own affair).
        """
        self.channel = config.channel if channel is None else channel
        self.dropped = 0
        """Frames that the kernel dropped since the bus was opened, because nobody read in time."""
        self.malformed = 0
        """Datagrams of a network bus (udp_multicast) that were no frame; anybody can send those."""
        self._wanted: set[tuple[bool, int]] | None = None
        self._fd = config.fd
        if bus is None:
            bus = self._open(config, filters)
        self._bus: _Bus | None = bus
        # The socket is read directly: python-can's own reading cannot tell the count of dropped frames.
        found = getattr(bus, "socket", None)
        self._socket = found if isinstance(found, socket.socket) else None
        if self._socket is not None:
            self._set_socket_options(self._socket)

    def _open(self, config: CanConfig, filters: list[dict[str, Any]] | None) -> can.BusABC:
        """Return an open python-can bus; `CanDown` with the reason where that fails."""
        options: dict[str, Any] = {"interface": config.interface, "channel": self.channel}
        if config.fd:
            options["fd"] = True
        if config.bitrate is not None:
            options["bitrate"] = config.bitrate
        try:
            bus = can.Bus(**options)
        except Exception as error:
            # Each of the twenty backends has its own exceptions, from its driver's to ImportError.
            hint = _MULTICAST_EXTRA if "msgpack" in str(error) else ""
            raise CanDown(
                self.channel, f"cannot be opened with {config.interface}: {_one_line(error)}{hint}"
            ) from None
        if filters is None:
            return bus
        if type(bus)._apply_filters is not can.BusABC._apply_filters:
            try:
                bus.set_filters(filters)  # type: ignore[arg-type]
            except Exception as error:
                bus.shutdown()
                raise CanDown(self.channel, f"takes no filters: {_one_line(error)}") from None
        else:
            # python-can's own filter ends a non-blocking read at the first frame that it rejects.
            self._wanted = {(bool(entry["extended"]), int(entry["can_id"])) for entry in filters}
        return bus

    @staticmethod
    def _set_socket_options(sock: socket.socket) -> None:
        """Set the socket's options as far as possible: a kernel that rejects any of them still delivers
        frames."""
        for option in (_SO_TIMESTAMPNS, _SO_RXQ_OVFL):
            with contextlib.suppress(OSError):
                sock.setsockopt(socket.SOL_SOCKET, option, 1)
        try:
            sock.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES)
        except OSError:
            with contextlib.suppress(OSError):
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)

    def fileno(self) -> int | None:
        """Return the descriptor that becomes readable with a frame; None where the backend has none: poll
        it."""
        if self._bus is None:
            return None
        try:
            number = self._bus.fileno()
        except (NotImplementedError, can.CanError, OSError):
            return None
        return number if number >= 0 else None

    def read(self, limit: int = 1000) -> list[CanFrame]:
        """Return up to `limit` frames that have arrived; never waits. `CanDown` if the bus is gone.

        If it goes while frames are being read, these are returned, and the next call raises.
        """
        frames: list[CanFrame] = []
        while len(frames) < limit:
            try:
                frame = self._read_socket() if self._socket is not None else self._read_bus()
            except CanDown:
                if frames:
                    break
                raise
            if frame is None:
                break
            frames.append(frame)
        return frames

    def _read_socket(self) -> CanFrame | None:
        """Return the next frame of a SocketCAN socket; None if none has arrived."""
        assert self._socket is not None
        try:
            packet, ancillary, _, _ = self._socket.recvmsg(_FD_BYTES, _ANCILLARY_BYTES, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return None
        except OSError as error:
            # ENETDOWN comes once after the link went down; then the socket is silent until reopened.
            raise CanDown(self.channel, _one_line(error)) from None
        time_s, dropped = _unpack_ancillary(ancillary)
        if dropped is not None:
            self.dropped = dropped
        frame = unpack_socketcan(packet, time_s, self.channel)
        if frame is None:
            raise CanDown(self.channel, f"odd packet of {len(packet)} bytes")
        return frame

    def _read_bus(self) -> CanFrame | None:
        """Return the next wanted frame of a python-can bus; None if none has arrived."""
        if self._bus is None:
            raise CanDown(self.channel, "is closed")
        for _ in range(MAX_SKIPPED):
            try:
                message = self._bus.recv(timeout=0.0)
            except Exception as error:
                if isinstance(error, can.CanOperationError) and _NO_FRAME in str(error):
                    self.malformed += 1
                    continue
                # As in `_open`: backends let their drivers' exceptions through.
                raise CanDown(self.channel, _one_line(error)) from None
            if message is None:
                return None
            wanted = self._wanted
            if (
                wanted is None
                or message.is_error_frame
                or (message.is_extended_id, message.arbitration_id) in wanted
            ):
                return CanFrame(
                    message.timestamp,
                    self.channel,
                    message.arbitration_id,
                    message.is_extended_id,
                    message.is_fd,
                    message.is_error_frame,
                    message.is_remote_frame,
                    bytes(message.data),
                )
        return None

    def send(self, arbitration_id: int, data: bytes, extended: bool = False) -> bool:
        """Send a frame (CAN FD beyond 8 bytes). False if the transmit queue is full: a bus on which nobody
        acknowledges takes no more, but may still be heard. `CanDown` for any other failure."""
        if self._bus is None:
            raise CanDown(self.channel, "is closed")
        message = can.Message(
            arbitration_id=arbitration_id, data=data, is_extended_id=extended, is_fd=len(data) > 8
        )
        try:
            self._bus.send(message, timeout=0.0)
        except Exception as error:
            if _is_full(error):
                return False
            raise CanDown(self.channel, _one_line(error)) from None
        return True

    def close(self) -> None:
        """Close the interface; does nothing if it is closed."""
        bus, self._bus, self._socket = self._bus, None, None
        if bus is not None:
            # An adapter that was pulled out cannot be shut down in order.
            with contextlib.suppress(Exception):
                bus.shutdown()


def unpack_socketcan(packet: bytes, time_s: float, channel: str) -> CanFrame | None:
    """Return a frame as the kernel hands it over (linux/can.h); None if the packet is none."""
    if len(packet) not in (_CLASSIC_BYTES, _FD_BYTES):
        return None
    identifier, length, _, _, _ = _HEADER.unpack_from(packet)
    is_extended = bool(identifier & _EXTENDED)
    return CanFrame(
        time_s,
        channel,
        identifier & (0x1FFFFFFF if is_extended or identifier & _ERROR else 0x7FF),
        is_extended,
        len(packet) == _FD_BYTES,
        bool(identifier & _ERROR),
        bool(identifier & _REMOTE),
        b"" if identifier & _REMOTE else packet[_HEADER.size : _HEADER.size + length],
    )


def _unpack_ancillary(ancillary: list[tuple[int, int, bytes]]) -> tuple[float, int | None]:
    """Return the kernel's stamp of a frame, s, and its count of frames dropped so far; None if it states
    none."""
    # The kernel stamps every frame; the time of reading stands in where a driver or an option is missing.
    time_s, dropped = time.time(), None
    for level, kind, data in ancillary:
        if level != socket.SOL_SOCKET:
            continue
        if kind == _SO_TIMESTAMPNS and len(data) >= _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack_from(data)
            time_s = seconds + nanoseconds * 1e-9
        elif kind == _SO_RXQ_OVFL and len(data) >= _COUNT.size:
            dropped = int(_COUNT.unpack_from(data)[0])
    return time_s, dropped


def _is_full(error: Exception) -> bool:
    """Return whether an error of `send` means that the transmit queue is full."""
    if isinstance(error, TimeoutError | BlockingIOError):
        return True
    code = getattr(error, "error_code", None) or getattr(error, "errno", None)
    return code in (errno.ENOBUFS, errno.EAGAIN) or "buffer full" in str(error).lower()


def _one_line(error: Exception) -> str:
    """Return an error's text as one line of bounded length."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 200 else text[:197] + "..."
