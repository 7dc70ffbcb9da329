"""Reads a receiver over the network without ever waiting: gpsd, a TCP stream, UDP datagrams.

In: host and port. Out: bytes, as they come. Everything that can go wrong is a `ReceiverGone` with one line
that says why, upon which the caller closes, waits and opens again.

Connecting goes on in the background; a name that is no address is looked up by a thread of its own, since the
system's resolver may take seconds. UDP is the one source that listens: on the address that is configured and
on no other.
"""

from __future__ import annotations

import contextlib
import errno
import ipaddress
import select
import socket
import threading
from typing import NoReturn

from tpmsd.onboard.sources.gnss.serial_live import ReceiverGone

READ_BYTES = 8192
SYN_RETRIES = 2
"""Seven seconds (1 + 2 + 4) until a host that does not answer is given up; the system's 6 are minutes."""
KEEPALIVE_IDLE_S, KEEPALIVE_EACH_S, KEEPALIVE_PROBES = 5, 2, 3
"""A host that vanished without a word is found gone after some 11 s."""

_QUIET = socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC
Address = tuple[socket.AddressFamily, tuple[str, int]]


class _Lookup:
    """The addresses of a host; a name is asked for in the background."""

    def __init__(self, label: str, host: str, port: int) -> None:
        self._label, self._host, self._port = label, host, port
        self._thread: threading.Thread | None = None
        self._found: list[Address] = []
        self._error = ""
        self._turn = 0

    def next_address(self) -> Address:
        """Return the host's addresses in turn, one a call; `ReceiverGone` while there is none."""
        with contextlib.suppress(ValueError):
            family = socket.AF_INET if ipaddress.ip_address(self._host).version == 4 else socket.AF_INET6
            return family, (self._host, self._port)
        if self._host == "localhost":  # no name to be looked up (RFC 6761)
            both = ((socket.AF_INET, "127.0.0.1"), (socket.AF_INET6, "::1"))
            self._found = [(family, (address, self._port)) for family, address in both]
        elif self._thread is None:
            self._thread = threading.Thread(target=self._resolve_name, daemon=True)
            self._thread.start()
            self._thread.join(0.05)
        if self._thread is not None:
            if self._thread.is_alive():
                raise ReceiverGone(self._label, "its name is being looked up")
            self._thread = None
        if not self._found:
            raise ReceiverGone(self._label, self._error or "its name has no address")
        address = self._found[self._turn % len(self._found)]
        self._turn += 1
        return address

    def note_failure(self) -> None:
        """Note that the last address could not be reached; after all of them the name is looked up again."""
        if self._found and self._turn % len(self._found) == 0:
            self._found = []

    def _resolve_name(self) -> None:
        """Look the host's name up, in a thread; keep its addresses or the reason why there are none."""
        try:
            answers = socket.getaddrinfo(self._host, self._port, type=socket.SOCK_STREAM)
        except (OSError, UnicodeError) as error:
            self._error = f"its name is not found ({getattr(error, 'strerror', None) or error})"
            self._found = []
        else:
            self._found = [(family, (str(to[0]), self._port)) for family, _, _, _, to in answers]


class TcpReceiver:
    """A stream of NMEA or JSON from a server, which may need a greeting first."""

    def __init__(self, label: str, host: str, port: int, greeting: bytes = b"") -> None:
        self.label = label
        self._lookup = _Lookup(label, host, port)
        self._greeting = greeting
        self._socket: socket.socket | None = None
        self._connected = False

    def open(self) -> None:
        """Begin to connect. Raises `ReceiverGone`."""
        self.close()
        family, address = self._lookup.next_address()
        try:
            self._socket = socket.socket(family, socket.SOCK_STREAM | _QUIET)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_SYNCNT, SYN_RETRIES)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, KEEPALIVE_IDLE_S)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, KEEPALIVE_EACH_S)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, KEEPALIVE_PROBES)
            status = self._socket.connect_ex(address)
        except OSError as error:
            self._raise_lost(error.errno or 0)
        if status not in (0, errno.EINPROGRESS):
            self._raise_lost(status)

    def fileno(self) -> int:
        """Return the descriptor to wait on. Raises `ReceiverGone` if closed."""
        return self._require_open().fileno()

    def read(self) -> bytes:
        """Return the bytes that have arrived, empty if none have. Raises `ReceiverGone` when the connection
        is gone."""
        connection = self._require_open()
        if not self._connected and not self._finish_connecting(connection):
            return b""
        try:
            data = connection.recv(READ_BYTES)
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError as error:
            self._raise_lost(error.errno or 0)
        if not data:
            raise ReceiverGone(self.label, "has closed the connection")
        return data

    def close(self) -> None:
        """Close the connection; does nothing if it is closed."""
        connection, self._socket = self._socket, None
        self._connected = False
        if connection is not None:
            connection.close()

    def _finish_connecting(self, connection: socket.socket) -> bool:
        """Return whether the connection stands; sends the greeting once. Raises `ReceiverGone`."""
        if not select.select([], [connection], [], 0)[1]:
            return False
        if status := connection.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            self._raise_lost(status)
        self._connected = True
        if self._greeting:
            try:
                connection.send(self._greeting)  # a fresh connection has room for a line
            except OSError as error:
                self._raise_lost(error.errno or 0)
        return True

    def _require_open(self) -> socket.socket:
        """Return the socket. Raises `ReceiverGone` if it is closed."""
        if self._socket is None:
            raise ReceiverGone(self.label, "not open")
        return self._socket

    def _raise_lost(self, status: int) -> NoReturn:
        """Raise ReceiverGone with the reason; the host is looked up again."""
        self._lookup.note_failure()
        reason = _REASONS.get(status) or errno.errorcode.get(status, str(status))
        raise ReceiverGone(self.label, reason) from None


class UdpReceiver:
    """Datagrams of NMEA; each is whole lines."""

    def __init__(self, label: str, host: str, port: int) -> None:
        self.label = label
        self._lookup = _Lookup(label, host, port)
        self._socket: socket.socket | None = None

    def open(self) -> None:
        """Listen on the configured address. Raises `ReceiverGone`."""
        self.close()
        family, address = self._lookup.next_address()
        self._socket = socket.socket(family, socket.SOCK_DGRAM | _QUIET)
        try:
            self._socket.bind(address)
        except OSError as error:
            self.close()
            self._lookup.note_failure()
            reason = _REASONS.get(error.errno or 0) or error.strerror or str(error)
            raise ReceiverGone(self.label, reason) from None

    def fileno(self) -> int:
        """Return the descriptor to wait on. Raises `ReceiverGone` if closed."""
        return self._require_open().fileno()

    def read(self) -> bytes:
        """Return the next datagram as lines, empty if there is none. Raises `ReceiverGone`."""
        try:
            data = self._require_open().recv(READ_BYTES)
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError as error:
            raise ReceiverGone(self.label, error.strerror or str(error)) from None
        # A lost datagram must not join the halves of two lines.
        return data + b"\r\n"

    def close(self) -> None:
        """Stop listening; does nothing if that has happened."""
        listener, self._socket = self._socket, None
        if listener is not None:
            listener.close()

    def _require_open(self) -> socket.socket:
        """Return the socket. Raises `ReceiverGone` if it is closed."""
        if self._socket is None:
            raise ReceiverGone(self.label, "not open")
        return self._socket


_REASONS = {
    errno.ECONNREFUSED: "nobody listens there (connection refused)",
    errno.ETIMEDOUT: "does not answer",
    errno.EHOSTUNREACH: "no route to it",
    errno.ENETUNREACH: "no network",
    errno.ECONNRESET: "has cut the connection",
    errno.EADDRINUSE: "another program listens there",
    errno.EADDRNOTAVAIL: "no address of this machine",
    errno.EACCES: "no permission",
}
