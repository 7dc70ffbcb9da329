"""Serves the tyre status on a Unix socket, inside the daemon's one event loop.

In: connections on a stream socket, and a function that makes the status document. Out: JSON lines.

A client connects and sends one line: `status`, `watch`, `explain`, `reset`, or the same as a JSON object
`{"request": "status" | "watch" | "explain" | "reset", "tyres": NAME}`; one that sends
nothing (for a second, or by closing its side) is taken to ask for the status. `status` is answered by one
line, then the connection is closed; `watch` by one line now and one with every `publish`. What is no request
is answered by `{"error": "..."}`.

Nothing here blocks, and no client can hurt the daemon: their number, the length of a request, the time it may
take and what may pile up for a client that does not read are all bounded.
"""

from __future__ import annotations

import contextlib
import errno
import json
import logging
import math
import os
import selectors
import socket
import stat
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tpmsd.foundation.errors import TpmsdError
from tpmsd.onboard.sinks.socket_path import check_socket_path

MAX_CLIENTS = 128
MAX_WATCHERS = 112
"""Number of watching clients, at most; the other connections are for those who ask once: watchers stay for
ever."""
MAX_TURNED_AWAY = 16
"""Clients beyond MAX_CLIENTS whose request is still read, so that the refusal reaches them: a socket that is
closed with unread bytes is a reset connection at the other end."""
MAX_REQUEST_BYTES = 4096
MAX_PENDING_BYTES = 65536
SILENT_S = 1.0
"""Time without a request after which a client is given the status, s."""
REQUEST_S = 5.0
"""Time after which a request must be whole, s; so must the taking of an answer."""
_ACCEPTS_PER_CALL = 32
"""Number of connections taken per call: a storm of them must not hold up the estimator."""
_ACCEPT_PAUSE_S = 1.0
TOO_MANY = f"too many clients: {MAX_CLIENTS} are served at a time; try again"

_log = logging.getLogger(__name__)


class StatusSocketError(TpmsdError):
    """The status socket cannot be made; says where and why."""


@dataclass(slots=True, eq=False)
class _Client:
    connection: socket.socket
    deadline_s: float
    connected_s: float
    request: bytearray = field(default_factory=bytearray)
    pending: bytearray = field(default_factory=bytearray)
    answered: bool = False
    watching: bool = False
    turned_away: bool = False
    """True if it came when all connections were in use; it is sent a refusal."""
    events: int = 0
    """Events for which the selector watches it."""


class StatusServer:
    """The socket and its clients.

    The owner watches `fileno()` for reading, and calls `service` when it is readable and at least once a
    second all the same (for the time-outs). `now_s` is any clock that does not step back.
    """

    def __init__(
        self,
        path: Path,
        document: Callable[[], Mapping[str, Any]],
        *,
        mode: int = 0o660,
        reset: Callable[[str | None], str] | None = None,
        explain: Callable[[], Mapping[str, Any]] | None = None,
    ) -> None:
        """Prepare the server; nothing is opened yet. `document` is called whenever a client is answered.

        `reset` takes a request to learn the tyres again, with the name of the set if one is given; it answers
        with why it cannot be taken, or with nothing. `explain` makes the document of `tpmsd explain`.
        """
        self._explain = explain
        self._reset = reset
        self._path = path
        self._document = document
        self._mode = mode
        self._selector = selectors.DefaultSelector()
        self._clients: set[_Client] = set()
        self._listener: socket.socket | None = None
        self._identity: tuple[int, int] | None = None
        self._accepts_again_s = -math.inf
        self._accepting = False
        self._latest: bytes | None = None
        """The answer, made at most once per call: a hundred clients at a time cost little more than one."""

    def open(self) -> None:
        """Open the socket; a stale one of an earlier run is replaced, one that is answered on is not.

        Raises ConfigError for a path that cannot be a socket's, StatusSocketError for what stands in the way.
        """
        check_socket_path(self._path)
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            _remove_stale(self._path)
            listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            try:
                listener.setblocking(False)
                listener.bind(str(self._path))
                # Nobody can connect before listen(), so there is no moment with a wider mode.
                self._path.chmod(self._mode)
                listener.listen(MAX_CLIENTS)
                status = self._path.lstat()
            except OSError:
                listener.close()
                raise
        except OSError as error:
            reason = error.strerror or str(error)
            raise StatusSocketError(f"cannot make the status socket {self._path}: {reason}") from error
        self._listener = listener
        self._identity = (status.st_dev, status.st_ino)
        self._set_accepting(True)

    def fileno(self) -> int:
        """Return the descriptor, which is readable when there is something to `service`; another selector may
        watch it."""
        return self._selector.fileno()

    @property
    def clients(self) -> int:
        """Number of clients that are connected."""
        return len(self._clients)

    @property
    def watchers(self) -> int:
        """Number of clients that wait for the next `publish`."""
        return sum(client.watching for client in self._clients)

    def service(self, now_s: float) -> None:
        """Accept clients, read requests and send answers as far as possible without waiting."""
        self._latest = None
        if self._listener is not None and not self._accepting and now_s >= self._accepts_again_s:
            self._set_accepting(True)
        for key, events in self._selector.select(timeout=0):
            if key.fileobj is self._listener:
                self._accept_clients(now_s)
                continue
            client: _Client = key.data
            if events & selectors.EVENT_READ:
                self._read_request(client, now_s)
            if events & selectors.EVENT_WRITE and client in self._clients:
                self._send_pending(client)
        for client in [client for client in self._clients if now_s >= client.deadline_s]:
            if client.answered or client.request:
                self._drop(client)
            else:
                self._answer(client, now_s)

    def publish(self, now_s: float) -> None:
        """Send every watching client the present status."""
        self._latest = None
        if self.watchers:
            line = self._document_line()
            for client in [client for client in self._clients if client.watching]:
                self._send(client, line)
        self.service(now_s)

    def close(self) -> None:
        """Close all connections and remove the socket, if it is still ours."""
        for client in list(self._clients):
            self._drop(client)
        if self._listener is not None:
            self._set_accepting(False)
            self._listener.close()
            self._listener = None
            with contextlib.suppress(OSError):
                status = self._path.lstat()
                if (status.st_dev, status.st_ino) == self._identity:
                    self._path.unlink()
        self._selector.close()

    def _set_accepting(self, on: bool) -> None:
        """Accept new clients, or let them wait."""
        if self._listener is None or on == self._accepting:
            return
        if on:
            self._selector.register(self._listener, selectors.EVENT_READ)
        else:
            self._selector.unregister(self._listener)
        self._accepting = on

    def _accept_clients(self, now_s: float) -> None:
        assert self._listener is not None
        for _ in range(_ACCEPTS_PER_CALL):
            try:
                connection, _address = self._listener.accept()
            except OSError as error:
                if error.errno in (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM):
                    # The socket stays readable: without a pause the loop would spin on it.
                    self._set_accepting(False)
                    self._accepts_again_s = now_s + _ACCEPT_PAUSE_S
                return
            connection.setblocking(False)
            if len(self._clients) >= MAX_CLIENTS + MAX_TURNED_AWAY:
                with contextlib.suppress(OSError):
                    connection.send(_error_line(TOO_MANY))
                    connection.shutdown(socket.SHUT_WR)
                    connection.recv(MAX_REQUEST_BYTES)
                connection.close()
                continue
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, MAX_PENDING_BYTES)
            client = _Client(connection, now_s + SILENT_S, now_s)
            client.turned_away = len(self._clients) >= MAX_CLIENTS
            self._clients.add(client)
            self._watch_events(client, selectors.EVENT_READ)

    def _read_request(self, client: _Client, now_s: float) -> None:
        """Read what a client has sent, and answer once the request is complete."""
        try:
            data = client.connection.recv(MAX_REQUEST_BYTES + 1 - len(client.request))
        except BlockingIOError:
            return
        except OSError:
            self._drop(client)
            return
        client.request += data
        client.deadline_s = client.connected_s + REQUEST_S
        if not data or b"\n" in client.request or len(client.request) > MAX_REQUEST_BYTES:
            self._answer(client, now_s)

    def _answer(self, client: _Client, now_s: float) -> None:
        """Send the answer to a client's request; a refused one gets an error line."""
        client.answered = True
        client.deadline_s = now_s + REQUEST_S
        try:
            if client.turned_away:
                raise ValueError(TOO_MANY)
            asked, tyres = _parse_request(bytes(client.request))
            if asked == "watch" and self.watchers >= MAX_WATCHERS:
                raise ValueError(
                    f"too many watchers: {MAX_WATCHERS} are served at a time; ask for the status"
                )
            client.watching = asked == "watch"
            if asked == "reset":
                self._take_reset(tyres)
        except ValueError as error:
            line = _error_line(str(error))
        else:
            line = self._explanation_line() if asked == "explain" else self._document_line()
        if client.watching:
            client.deadline_s = math.inf
        self._send(client, line)

    def _take_reset(self, tyres: str | None) -> None:
        """Hand a reset to the daemon; ValueError with the reason if it is rejected."""
        why = "this daemon takes no resets" if self._reset is None else self._reset(tyres)
        if why:
            raise ValueError(why)

    def _explanation_line(self) -> bytes:
        """Return the explanation as a line, made for each request, for these are few."""
        if self._explain is None:
            return _error_line("this daemon explains nothing")
        try:
            return json.dumps(self._explain(), allow_nan=False).encode("ascii") + b"\n"
        except (TypeError, ValueError) as error:
            _log.error("the explanation is no JSON: %s", error)
            return _error_line("the explanation cannot be written")

    def _document_line(self) -> bytes:
        """Return the status document as a line, made once per round; an error line if it is no JSON."""
        if self._latest is None:
            try:
                text = json.dumps(self._document(), allow_nan=False)
            except (TypeError, ValueError) as error:
                _log.error("the status document is no JSON: %s", error)
                return _error_line("the status cannot be written")
            self._latest = text.encode("ascii") + b"\n"
        return self._latest

    def _send(self, client: _Client, line: bytes) -> None:
        """Send a line as far as possible; a watcher that reads too slowly is disconnected."""
        client.pending += line
        self._send_pending(client)
        if client.watching and len(client.pending) > MAX_PENDING_BYTES:
            self._drop(client)

    def _send_pending(self, client: _Client) -> None:
        """Send the rest of an answer as far as possible; disconnect a client that has it all and does not
        watch."""
        try:
            while client.pending:
                sent = client.connection.send(client.pending, socket.MSG_NOSIGNAL)
                del client.pending[:sent]
        except BlockingIOError:
            pass
        except OSError:
            self._drop(client)
            return
        if not client.pending and not client.watching:
            self._drop(client)
        else:
            # What a client says after its request is not read: so it cannot keep the loop busy.
            self._watch_events(client, selectors.EVENT_WRITE if client.pending else 0)

    def _watch_events(self, client: _Client, events: int) -> None:
        """Watch a client's connection for these events; 0 for none."""
        if events == client.events:
            return
        if not client.events:
            self._selector.register(client.connection, events, client)
        elif not events:
            self._selector.unregister(client.connection)
        else:
            self._selector.modify(client.connection, events, client)
        client.events = events

    def _drop(self, client: _Client) -> None:
        """Close a client's connection."""
        if client not in self._clients:
            return
        self._clients.discard(client)
        client.watching = False
        self._watch_events(client, 0)
        client.connection.close()


def _parse_request(request: bytes) -> tuple[str, str | None]:
    """Return the request (`status`, `watch`, `explain` or `reset`) and its set of tyres, None without;
    ValueError if it is none."""
    if b"\n" not in request and len(request) > MAX_REQUEST_BYTES:
        raise ValueError(f"request longer than {MAX_REQUEST_BYTES} bytes")
    tyres = None
    try:
        line = request.split(b"\n", 1)[0].decode("utf-8").strip()
        asked: Any = line or "status"
        if line.startswith("{"):
            document = json.loads(line)
            asked, tyres = document.get("request"), document.get("tyres")
    except (ValueError, RecursionError) as error:
        raise ValueError("the request is neither a word nor a JSON object") from error
    if asked not in ("status", "watch", "explain", "reset"):
        raise ValueError("unknown request; known are status, watch, explain and reset")
    if tyres is not None and not isinstance(tyres, str):
        raise ValueError("tyres must be a name")
    return str(asked), tyres


def _error_line(reason: str) -> bytes:
    return json.dumps({"error": reason}).encode("ascii") + b"\n"


def _remove_stale(path: Path) -> None:
    """Remove a socket that nobody answers on; raises OSError for anything else at the path."""
    try:
        if not stat.S_ISSOCK(path.lstat().st_mode):
            raise FileExistsError(errno.EEXIST, "a file that is no socket is in the way")
    except FileNotFoundError:
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        result = probe.connect_ex(str(path))
    if result in (0, errno.EAGAIN):
        raise OSError(errno.EADDRINUSE, "another tpmsd is answering on it")
    if result not in (errno.ECONNREFUSED, errno.ENOENT):
        raise OSError(result, os.strerror(result))
    path.unlink(missing_ok=True)
