"""The status socket, asked by well-behaved, slow, greedy and hostile clients on a real Unix socket."""

from __future__ import annotations

import json
import os
import resource
import select
import socket
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.foundation.errors import ConfigError, TpmsdError
from tpmsd.onboard.sinks.socket_path import MAX_PATH_BYTES
from tpmsd.onboard.sinks.status_server import (
    MAX_CLIENTS,
    MAX_PENDING_BYTES,
    MAX_REQUEST_BYTES,
    MAX_TURNED_AWAY,
    MAX_WATCHERS,
    REQUEST_S,
    SILENT_S,
    TOO_MANY,
    StatusServer,
    StatusSocketError,
)


class Daemon:
    """A server with a document that counts how often it was asked for."""

    def __init__(self, path: Path, mode: int = 0o660, extra: dict[str, Any] | None = None) -> None:
        self.path = path
        self.asked = 0
        self.extra = extra or {}
        self.server = StatusServer(path, self.document, mode=mode)
        self.server.open()

    def document(self) -> dict[str, Any]:
        self.asked += 1
        return {"version": 1, "asked": self.asked, **self.extra}

    def connect(self) -> socket.socket:
        client = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        client.settimeout(5)
        client.connect(str(self.path))
        return client

    def answer(self, request: bytes, now_s: float = 0.0) -> list[dict[str, Any]]:
        """What a client gets that sends `request` and reads to the end."""
        with self.connect() as client:
            client.sendall(request)
            self.server.service(now_s)
            self.server.service(now_s)
            return lines(read_all(client))


def read_all(client: socket.socket) -> bytes:
    data = b""
    try:
        while part := client.recv(65536):
            data += part
    except ConnectionResetError:  # the server closed before it had read all of a hostile request
        pass
    return data


def lines(data: bytes) -> list[dict[str, Any]]:
    return [json.loads(line) for line in data.splitlines()]


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[Daemon]:
    daemon = Daemon(tmp_path / "run" / "status.sock")
    yield daemon
    daemon.server.close()


# ---- asking


@pytest.mark.parametrize(
    "request_",
    [b"status\n", b"\n", b"  status  \r\n", b'{"request": "status"}\n', b'{"request":"status","x":1}\nmore'],
)
def test_a_status_request_gets_one_line_and_the_end(daemon: Daemon, request_: bytes) -> None:
    """However a request is spelt, one document comes back and the connection is closed."""
    assert [{"version": 1, "asked": 1}] == daemon.answer(request_)
    assert 0 == daemon.server.clients


def test_who_closes_his_side_is_answered_at_once(daemon: Daemon) -> None:
    """`socat - UNIX-CONNECT:... </dev/null` and a request without a line break both work."""
    for request in (b"", b"status"):
        with daemon.connect() as client:
            client.sendall(request)
            client.shutdown(socket.SHUT_WR)
            for _ in range(3):  # connection, request, end
                daemon.server.service(0.0)
            assert 1 == len(lines(read_all(client)))


def test_who_says_nothing_is_answered_after_a_second(daemon: Daemon) -> None:
    """A client that connects and only reads gets the status, but not before it had time to ask."""
    with daemon.connect() as client:
        daemon.server.service(10.0)
        daemon.server.service(10.0 + SILENT_S - 0.01)
        assert 0 == daemon.asked
        daemon.server.service(10.0 + SILENT_S)
        assert [{"version": 1, "asked": 1}] == lines(read_all(client))


def test_a_watcher_gets_a_line_with_every_update(daemon: Daemon) -> None:
    """One line at once, one per publish, until it goes; then it is forgotten."""
    with daemon.connect() as client:
        client.sendall(b'{"request":"watch"}\n')
        daemon.server.service(0.0)
        daemon.server.service(0.0)
        for i in range(3):
            daemon.server.publish(1.0 + i)
        assert [1, 2, 3, 4] == [line["asked"] for line in lines(client.recv(65536))]
        assert 1 == daemon.server.watchers
    daemon.server.publish(5.0)
    assert (0, 0) == (daemon.server.watchers, daemon.server.clients)


def test_a_watcher_may_close_its_sending_side(daemon: Daemon) -> None:
    """`echo watch | socat ...` goes on receiving after the end of its input."""
    with daemon.connect() as client:
        client.sendall(b"watch")
        client.shutdown(socket.SHUT_WR)
        for _ in range(3):  # connection, request, end
            daemon.server.service(0.0)
        daemon.server.publish(100.0)
        assert 2 == len(lines(client.recv(65536)))


def test_without_watchers_an_update_costs_no_document(daemon: Daemon) -> None:
    """Nobody watches, nobody is asked."""
    daemon.server.publish(0.0)
    assert 0 == daemon.asked


def test_the_descriptor_tells_a_foreign_event_loop_when_to_serve(daemon: Daemon) -> None:
    """`fileno()` is readable when somebody connects or asks, and quiet while a watcher is idle."""

    def readable() -> bool:
        return bool(select.select([daemon.server], [], [], 0)[0])

    assert not readable()
    with daemon.connect() as client:
        assert readable()
        daemon.server.service(0.0)
        assert not readable()
        client.sendall(b"watch\n")
        assert readable()
        daemon.server.service(0.0)
        client.sendall(b"chatter" * 100)
        assert not readable()


# ---- bad requests


@pytest.mark.parametrize(
    ("request_", "error"),
    [
        (b"reboot\n", "unknown request; known are status, watch, explain and reset"),
        (b'{"request": ["status"]}\n', "unknown request; known are status, watch, explain and reset"),
        (b"{}\n", "unknown request; known are status, watch, explain and reset"),
        (b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", "unknown request; known are status, watch, explain and reset"),
        (b'{"request": \n', "the request is neither a word nor a JSON object"),
        (b"\xff\xfe\n", "the request is neither a word nor a JSON object"),
        (b'{"request":' + b"[" * 4000 + b"\n", "the request is neither a word nor a JSON object"),
        (b"x" * 100_000, f"request longer than {MAX_REQUEST_BYTES} bytes"),
    ],
)
def test_a_bad_request_gets_an_error_and_the_end(daemon: Daemon, request_: bytes, error: str) -> None:
    """One line says what is wrong; the next client is served as if nothing had been."""
    assert [{"error": error}] == daemon.answer(request_)
    assert [{"version": 1, "asked": 1}] == daemon.answer(b"status\n")


@given(requests=st.lists(st.binary(max_size=200), max_size=8))
@settings(derandomize=True, deadline=None, max_examples=60)
def test_no_bytes_whatever_break_the_server(
    tmp_path_factory: pytest.TempPathFactory, requests: list[bytes]
) -> None:
    """Random bytes end in one line and a closed connection each."""
    daemon = Daemon(tmp_path_factory.mktemp("s") / "s")
    try:
        for request in requests:
            answers = daemon.answer(request + b"\n")
            assert 1 == len(answers)
            assert answers[0].keys() & {"error", "version"}
        assert 0 == daemon.server.clients
    finally:
        daemon.server.close()


def test_a_document_that_is_no_json_is_an_error_to_the_client_alone(tmp_path: Path) -> None:
    """NaN in the status ends in an error line and a log entry, not in the end of the daemon."""
    daemon = Daemon(tmp_path / "s", extra={"radius": float("nan")})
    assert [{"error": "the status cannot be written"}] == daemon.answer(b"status\n")
    daemon.server.close()


# ---- many, slow and greedy clients


def test_a_hundred_clients_are_served_together(daemon: Daemon) -> None:
    """A hundred clients that ask at once all get the status, which is made once per round, not per client."""
    clients = [daemon.connect() for _ in range(100)]
    for client in clients:
        client.sendall(b"status\n")
    for _ in range(10):
        daemon.server.service(0.0)
    answers = [lines(read_all(client)) for client in clients]
    for client in clients:
        client.close()
    assert [1] * 100 == [len(answer) for answer in answers]
    assert daemon.asked <= 10
    assert 0 == daemon.server.clients


def test_one_client_too_many_is_refused_with_a_reason(daemon: Daemon) -> None:
    """The number of clients is bounded; once they have gone there is room again."""
    clients = []
    for _ in range(MAX_CLIENTS + MAX_TURNED_AWAY + 5):
        clients.append(daemon.connect())
        daemon.server.service(0.0)
    assert MAX_CLIENTS + MAX_TURNED_AWAY == daemon.server.clients
    for client in clients[MAX_CLIENTS : MAX_CLIENTS + MAX_TURNED_AWAY]:
        client.sendall(b"status\n")
    daemon.server.service(0.0)
    refused = [lines(read_all(c)) for c in clients[MAX_CLIENTS:]]
    assert [[{"error": TOO_MANY}]] * (MAX_TURNED_AWAY + 5) == refused
    assert MAX_CLIENTS == daemon.server.clients
    for client in clients:
        client.close()
    daemon.server.service(0.5)
    assert 0 == daemon.server.clients
    assert 1 == len(daemon.answer(b"status\n", 0.6))


def test_obedient_watchers_leave_room_for_who_asks_once(daemon: Daemon) -> None:
    """However many watch, the next one who asks for the status gets it; a watcher too many is told so."""
    watchers = []
    for _ in range(MAX_CLIENTS):
        watcher = daemon.connect()
        watcher.sendall(b"watch\n")
        daemon.server.service(0.0)
        watchers.append(watcher)
    assert MAX_WATCHERS == daemon.server.watchers
    assert [True] == ["asked" in answer for answer in daemon.answer(b"status\n")]
    error = f"too many watchers: {MAX_WATCHERS} are served at a time; ask for the status"
    assert [{"error": error}] == daemon.answer(b"watch\n")
    for watcher in watchers:
        watcher.close()


def test_a_client_that_trickles_its_request_is_dropped(daemon: Daemon) -> None:
    """One byte a second does not hold a place for longer than the time-out."""
    with daemon.connect() as client:
        now_s = 0.0
        daemon.server.service(now_s)
        while daemon.server.clients and now_s < 60:
            client.send(b"x")
            daemon.server.service(now_s)
            now_s += 1.0
        assert REQUEST_S + 1 == now_s
        assert b"" == read_all(client)


def test_a_watcher_that_never_reads_is_dropped(tmp_path: Path) -> None:
    """What piles up for it is bounded, and other watchers go on receiving."""
    daemon = Daemon(tmp_path / "s", extra={"fill": "x" * 4000})
    with daemon.connect() as lazy, daemon.connect() as keen:
        for client in (lazy, keen):
            client.sendall(b"watch\n")
        for _ in range(2):
            daemon.server.service(0.0)
        got = b""
        for i in range(200):
            daemon.server.publish(float(i))
            got += keen.recv(1 << 20)
        assert 1 == daemon.server.watchers
        assert 201 == len(lines(got))
        assert len(read_all(lazy)) < 6 * MAX_PENDING_BYTES
    daemon.server.close()


def test_a_client_that_does_not_take_its_answer_is_dropped(tmp_path: Path) -> None:
    """A status greater than the kernel's buffer waits for its reader no longer than the time-out."""
    daemon = Daemon(tmp_path / "s", extra={"fill": "x" * 1_000_000})
    with daemon.connect() as client:
        client.sendall(b"status\n")
        daemon.server.service(0.0)
        daemon.server.service(0.0)
        daemon.server.service(REQUEST_S - 0.1)
        assert 1 == daemon.server.clients
        daemon.server.service(REQUEST_S)
        assert 0 == daemon.server.clients
    daemon.server.close()


def test_a_long_answer_is_sent_as_fast_as_it_is_read(tmp_path: Path) -> None:
    """Partial writes are continued, and nothing is lost."""
    daemon = Daemon(tmp_path / "s", extra={"fill": "x" * 1_000_000})
    with daemon.connect() as client:
        client.sendall(b"status\n")
        got = b""
        while not got.endswith(b"\n"):
            daemon.server.service(0.0)
            if select.select([client], [], [], 0)[0]:
                got += client.recv(1 << 20)
    assert "x" * 1_000_000 == lines(got)[0]["fill"]
    daemon.server.close()


def test_clients_that_vanish_leave_nothing_behind(daemon: Daemon) -> None:
    """Two hundred clients that ask and hang up at once are all cleaned away, descriptors too."""
    before = len(list(Path("/proc/self/fd").iterdir()))
    for i in range(200):
        client = daemon.connect()
        client.sendall(b"watch\n" if i % 2 else b"sta")
        client.close()
        daemon.server.service(0.0)
    daemon.server.publish(1.0)
    daemon.server.publish(2.0)
    assert 0 == daemon.server.clients
    assert before == len(list(Path("/proc/self/fd").iterdir()))


def test_running_out_of_descriptors_does_not_make_the_loop_spin(daemon: Daemon) -> None:
    """With no descriptor left the socket goes quiet for a second and then serves again."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with daemon.connect() as client:
        client.sendall(b"status\n")
        highest = max(int(entry.name) for entry in Path("/proc/self/fd").iterdir())
        fillers = [os.open("/dev/null", os.O_RDONLY)]
        while fillers[-1] < highest:
            fillers.append(os.open("/dev/null", os.O_RDONLY))
        resource.setrlimit(resource.RLIMIT_NOFILE, (fillers[-1] + 1, hard))
        try:
            daemon.server.service(0.0)
            quiet = not daemon.server._selector.select(0)
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
            for descriptor in fillers:
                os.close(descriptor)
        assert quiet
        daemon.server.service(0.5)
        assert 0 == daemon.server.clients
        for _ in range(3):
            daemon.server.service(1.0)
        assert 1 == len(lines(read_all(client)))


# ---- the socket file


@pytest.mark.parametrize("mode", [0o660, 0o600, 0o666])
def test_the_socket_has_the_configured_mode_and_goes_with_the_daemon(tmp_path: Path, mode: int) -> None:
    """Folder and socket are made, the socket with its mode; closing takes the socket away."""
    path = tmp_path / "a" / "b" / "status.sock"
    daemon = Daemon(path, mode)
    status = path.stat()
    assert (True, mode) == (stat.S_ISSOCK(status.st_mode), stat.S_IMODE(status.st_mode))
    daemon.server.close()
    assert not path.exists()


def test_a_stale_socket_is_replaced(tmp_path: Path) -> None:
    """What a killed daemon left behind does not keep the next from starting."""
    path = tmp_path / "status.sock"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as dead:
        dead.bind(str(path))
    daemon = Daemon(path)
    assert 1 == len(daemon.answer(b"status\n"))
    daemon.server.close()


def test_a_living_daemon_keeps_its_socket(daemon: Daemon) -> None:
    """A second daemon is told so, and the first goes on answering."""
    second = StatusServer(daemon.path, dict)
    with pytest.raises(StatusSocketError) as caught:
        second.open()
    second.close()
    expected = f"cannot make the status socket {daemon.path}: another tpmsd is answering on it"
    assert (expected, 1) == (str(caught.value), caught.value.exit_code)
    daemon.server.service(0.0)
    assert 1 == len(daemon.answer(b"status\n"))


def test_a_socket_that_another_daemon_has_taken_over_is_left_to_it(daemon: Daemon) -> None:
    """Closing removes the socket only if it is still the one that was made."""
    daemon.path.unlink()
    other = Daemon(daemon.path)
    daemon.server.close()
    assert 1 == len(other.answer(b"status\n"))
    other.server.close()


def test_a_file_that_is_no_socket_is_not_removed(tmp_path: Path) -> None:
    """Somebody's file under that name is an error, and stays."""
    path = tmp_path / "status.sock"
    path.write_text("precious")
    with pytest.raises(StatusSocketError) as caught:
        StatusServer(path, dict).open()
    reason = "a file that is no socket is in the way"
    assert f"cannot make the status socket {path}: {reason}" == str(caught.value)
    assert "precious" == path.read_text()


def test_a_path_too_long_for_a_socket_is_said_so(tmp_path: Path) -> None:
    """107 bytes are the most; the message gives both numbers."""
    folder = tmp_path
    path = folder / ("s" * (MAX_PATH_BYTES - len(os.fsencode(folder))))
    assert 108 == len(os.fsencode(path))
    with pytest.raises(ConfigError) as caught:
        StatusServer(path, dict).open()
    expected = f"the path of the status socket has 108 bytes, at most 107 are possible: {path}"
    assert expected == str(caught.value)
    just_right = path.with_name(path.name[:-1])
    server = StatusServer(just_right, dict)
    server.open()
    server.close()


def test_a_folder_that_cannot_be_made_is_one_clear_line(tmp_path: Path) -> None:
    """A file where the folder should be gives the path and the reason."""
    (tmp_path / "run").write_text("")
    path = tmp_path / "run" / "status.sock"
    with pytest.raises(TpmsdError) as caught:
        StatusServer(path, dict).open()
    assert f"cannot make the status socket {path}: File exists" == str(caught.value)
