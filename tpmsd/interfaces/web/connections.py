"""Limits of the connections of each visitor, by number and by idle time.

In: sockets as they are accepted, and what the protocol says of them. Out: connections that are closed. A
connection waits (for TLS, headers, a body, the next request) or is being answered. Who waits costs its owner
nothing, so waiting ends after `request_s`, and where the places are taken the longest waiting one is closed
for the newest: whoever sends a request gets an answer, however many others send half of one. What is being
answered, a live page for hours, is never closed for somebody else.
"""

from __future__ import annotations

import contextlib
import ipaddress
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from tpmsd.interfaces.web.settings import WebSettings

LISTEN_BACKLOG = 1024
"""Connections that the kernel holds until they are accepted: a burst waits there and is not refused."""
Peer = tuple[str, int]
"""Address and port of a visitor, as `getpeername` has them first."""


@dataclass
class Connection:
    """One open connection of a visitor."""

    opened: socket.socket
    origin: str
    since_s: float
    """When it was accepted, or the last answer was complete."""
    waiting: bool = True
    stalled_s: float | None = None
    """Since when its visitor takes nothing of an answer."""
    abort: Callable[[], object] | None = None
    """Closes it at once; None until the protocol has begun, as before TLS."""


class Connections:
    """Open connections by the visitor's address and port, the longest waiting ones first."""

    def __init__(self, settings: WebSettings, clock: Callable[[], float] = time.monotonic) -> None:
        self._settings = settings
        self._clock = clock
        self._open: dict[Peer, Connection] = {}

    def __len__(self) -> int:
        return len(self._open)

    def admit(self, opened: socket.socket, address: tuple[Any, ...]) -> bool:
        """Accept a connection, if need be in place of a waiting one; return False if there is no room and it
        is to be closed."""
        origin = origin_of(address[0])
        same_origin = [peer for peer, one in self._open.items() if one.origin == origin]
        if len(same_origin) >= self._settings.max_connections_per_address:
            taken = self._evict(same_origin)
        elif len(self._open) >= self._settings.max_connections:
            taken = self._evict(list(self._open))
        else:
            taken = True
        if taken:
            self._open[peer_of(address)] = Connection(opened, origin, self._clock())
        return taken

    def attach(self, address: tuple[Any, ...], abort: Callable[[], object]) -> None:
        """Set the function that closes a connection from now on."""
        if one := self._open.get(peer_of(address)):
            one.abort = abort

    def mark_answering(self, address: tuple[Any, ...]) -> None:
        """Note that a whole request has arrived."""
        if one := self._open.get(peer_of(address)):
            one.waiting = False

    def mark_waiting(self, address: tuple[Any, ...]) -> None:
        """Note that an answer is complete and the time limit of the next request begins."""
        if one := self._open.pop(peer_of(address), None):
            one.waiting, one.since_s = True, self._clock()
            self._open[peer_of(address)] = one

    def mark_stalled(self, address: tuple[Any, ...], stalled: bool) -> None:
        """Note whether a visitor has stopped reading its answer."""
        if one := self._open.get(peer_of(address)):
            one.stalled_s = self._clock() if stalled else None

    def forget(self, opened: socket.socket, address: tuple[Any, ...]) -> None:
        """Remove a closed connection, unless another one has its port by now."""
        one = self._open.get(peer_of(address))
        if one is not None and one.opened is opened:
            del self._open[peer_of(address)]

    def expire(self) -> None:
        """Close the connections that have waited or stalled for too long."""
        now = self._clock()
        for peer, one in list(self._open.items()):
            waited = one.waiting and now - one.since_s > self._settings.request_s
            if waited or (one.stalled_s is not None and now - one.stalled_s > self._settings.stalled_s):
                self._close(peer)

    def _evict(self, peers: list[Peer]) -> bool:
        """Close the one of `peers` that has waited longest; return False where none waits."""
        oldest = next((peer for peer in peers if self._open[peer].waiting), None)
        if oldest is not None:
            self._close(oldest)
        return oldest is not None

    def _close(self, peer: Peer) -> None:
        one = self._open.pop(peer)
        if one.abort is not None:
            one.abort()
            return
        with contextlib.suppress(OSError):
            one.opened.shutdown(socket.SHUT_RDWR)  # its transport reads the end, and closes it


class Listener(socket.socket):
    """A listening socket that hands out no more connections than there are places."""

    def __init__(self, bound: socket.socket, connections: Connections) -> None:
        """Take over a socket that is bound."""
        super().__init__(bound.family, bound.type, bound.proto, fileno=bound.detach())
        self._connections = connections

    def listen(self, backlog: int = LISTEN_BACKLOG) -> None:
        """Listen with `LISTEN_BACKLOG`: the event loop's value is how many it accepts at a time."""
        del backlog
        super().listen(LISTEN_BACKLOG)

    def accept(self) -> tuple[socket.socket, Any]:
        """Accept the next connection for which there is room; BlockingIOError where no more come."""
        while True:
            accepted, address = super().accept()
            opened = _Opened(accepted, address, self._connections)
            if self._connections.admit(opened, address):
                return opened, address
            opened.close()


class _Opened(socket.socket):
    """An accepted socket that says when it is closed."""

    def __init__(self, accepted: socket.socket, address: Any, connections: Connections) -> None:
        super().__init__(accepted.family, accepted.type, accepted.proto, fileno=accepted.detach())
        self._address = address
        self._connections = connections

    def close(self) -> None:
        """Close the socket, and remove the connection."""
        self._connections.forget(self, self._address)
        super().close()


def peer_of(address: tuple[Any, ...]) -> Peer:
    """Return address and port of a socket address; IPv6 has more elements."""
    return str(address[0]), int(address[1])


def origin_of(host: str) -> str:
    """Return the key by which a visitor's connections are counted: an IPv4 address, or the /64 network of an
    IPv6 address."""
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if isinstance(address, ipaddress.IPv4Address):
        return host
    if address.ipv4_mapped is not None:
        return str(address.ipv4_mapped)
    return str(ipaddress.ip_network((address, 64), strict=False))
