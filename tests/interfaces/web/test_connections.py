"""What a visitor can take of the server: bytes of a body, time for a request, connections."""

from __future__ import annotations

import asyncio
import socket
import ssl
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Scope

from tests.browser.load import line_with, process
from tpmsd.interfaces.web.app import live_app
from tpmsd.interfaces.web.connections import Connections, origin_of
from tpmsd.interfaces.web.guard import Guard
from tpmsd.interfaces.web.server import make_server, port_of
from tpmsd.interfaces.web.settings import WebSettings

PATIENCE_S = 20.0
TOKEN = "0123456789abcdef0123"
HALF = b"GET /api/session HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Half: "
ALMOST_AT_ONCE = WebSettings(port=0, request_s=1.0, stalled_s=1.0)


@contextmanager
def served(app: ASGIApp, settings: WebSettings, *tls: str) -> Iterator[int]:
    """The port of a server in a thread."""
    server, listener = make_server(app, settings, *tls)
    thread = threading.Thread(target=server.run, args=([listener],))
    thread.start()
    try:
        yield port_of(listener)
    finally:
        server.should_exit = server.force_exit = True
        thread.join(PATIENCE_S)


@contextmanager
def command(*arguments: str | Path) -> Iterator[tuple[int, int]]:
    """`tpmsd web` as a process: its port and its number."""
    with process("tpmsd", "web", "--port", "0", *arguments) as (running, said):
        url = line_with(said, "http://").split()[0]
        yield int(url.rstrip("/").rpartition(":")[2]), running.pid


def connected(port: int, sent: bytes = b"") -> socket.socket:
    """A connection on which something has been sent."""
    client = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
    client.sendall(sent)
    return client


def asked(port: int, path: str = "/static/icon.svg", name: str = "127.0.0.1") -> bytes:
    """The first line of the answer to a whole request."""
    with connected(
        port, f"GET {path} HTTP/1.1\r\nHost: {name}\r\nConnection: close\r\n\r\n".encode()
    ) as client:
        return client.makefile("rb").readline()


def answer_or_nothing(port: int, path: str) -> bytes:
    """The same; empty where the connection is closed unread."""
    try:
        return asked(port, path)
    except ConnectionError:
        return b""


def ended_s(client: socket.socket) -> float:
    """Time until the server has closed a connection."""
    begun = time.monotonic()
    try:
        while client.recv(1 << 16):
            pass
    except ConnectionError:
        pass
    return time.monotonic() - begun


def memory_bytes(number: int) -> int:
    """Of a process, what it has in memory."""
    return 4096 * int(Path(f"/proc/{number}/statm").read_text(encoding="ascii").split()[1])


def test_a_login_in_chunks_without_end_is_refused(tmp_path: Path) -> None:
    """Before any token, a body without a stated length takes neither time nor memory."""
    token = tmp_path / "token"
    token.write_text(TOKEN, encoding="ascii")
    chunk = b"10000\r\n" + b"x" * 65536 + b"\r\n"
    with command("--socket", tmp_path / "none.sock", "--token-file", token) as (port, number):
        before = memory_bytes(number)
        head = f"POST /login HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nOrigin: http://127.0.0.1:{port}\r\n"
        with connected(
            port, f"{head}Content-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n".encode()
        ) as client:
            sent = 0
            try:
                while sent < 32 << 20:
                    client.sendall(chunk)
                    sent += len(chunk)
            except ConnectionError:
                pass
            grown = memory_bytes(number) - before
        assert b"200 OK" in asked(port, "/login")

    assert sent < 16 << 20
    assert grown < 8 << 20


@pytest.mark.parametrize("headers", [[(b"content-length", b"5")], [(b"content-length", b"4096")]])
def test_bytes_are_counted_while_they_are_read(headers: list[tuple[bytes, bytes]]) -> None:
    """Whatever length is stated, no more than the bound and one message of the body is taken."""
    settings = WebSettings()
    taken, answers, passed = [0], [], []

    async def receive() -> Message:
        taken[0] += 1000
        return {"type": "http.request", "body": b"x" * 1000, "more_body": True}

    async def send(message: Message) -> None:
        answers.append(message)

    async def app(scope: Scope, receive: Any, send: Any) -> None:
        passed.append(scope)

    scope = {
        "type": "http",
        "method": "POST",
        "path": "/login",
        "headers": [(b"host", b"127.0.0.1"), (b"origin", b"http://127.0.0.1"), *headers],
    }
    asyncio.run(Guard(app, settings)(scope, receive, send))

    assert 413 == answers[0]["status"]
    assert [] == passed
    assert taken[0] <= settings.max_body_bytes + 1000


@pytest.mark.parametrize("token", [False, True])
def test_who_may_look_is_said(tmp_path: Path, token: bool) -> None:
    """Without a token the command says that all of this machine may look, and that a reset takes one."""
    file = tmp_path / "token"
    file.write_text(TOKEN, encoding="ascii")
    asking = ("--token-file", file) if token else ()
    with process("tpmsd", "web", "--port", "0", "--socket", tmp_path / "none.sock", *asking) as (_, said):
        lines = [line_with(said, "127.0.0.1")]
        if not token:
            lines.append(line_with(said, "--token-file"))
        time.sleep(0.3)
        lines += list(said.queue)

    assert (not token) is any(
        "whoever is on this machine may look; --token-file asks them for a token and allows resets" in one
        for one in lines
    )


@pytest.mark.parametrize("count", [560, 760])
def test_half_sent_requests_block_nobody(tmp_path: Path, count: int) -> None:
    """However many connections never finish their headers, one visitor more is answered at once."""
    with command("--socket", tmp_path / "none.sock") as (port, _), ExitStack() as stack:
        for _ in range(count):
            stack.enter_context(connected(port, HALF))
        begun = time.monotonic()
        answer = asked(port)

    assert b"200 OK" in answer
    assert time.monotonic() - begun < 5.0


def test_a_request_has_a_time_out(tmp_path: Path) -> None:
    """Nothing sent, half of the headers, half of a body, drops now and then: all are closed in time."""
    body = (
        b"POST /login HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: http://127.0.0.1\r\nContent-Length: 50\r\n\r\nx"
    )
    refused = b"GET /nothing HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 50\r\n\r\n"
    with served(live_app(tmp_path / "none.sock", ALMOST_AT_ONCE), ALMOST_AT_ONCE) as port:
        clients = [connected(port, sent) for sent in (b"", HALF, body, refused)]
        dropping = connected(port, HALF)
        begun, dropped = time.monotonic(), 0
        try:
            while time.monotonic() - begun < PATIENCE_S:
                dropping.sendall(b"x")
                dropped += 1
                time.sleep(0.1)
        except ConnectionError:
            pass
        for client in clients:
            assert ended_s(client) < 4.0
            client.close()
        dropping.close()
    assert 5 <= dropped <= 50


def test_a_live_page_outlasts_the_time_out(tmp_path: Path) -> None:
    """A stream of events that is read goes on for longer than any request may take."""
    request = b"GET /api/live HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    app = live_app(tmp_path / "none.sock", ALMOST_AT_ONCE)
    with served(app, ALMOST_AT_ONCE) as port, connected(port, request) as client:
        client.settimeout(3.0)
        begun, bytes_after_s = time.monotonic(), 0
        while time.monotonic() - begun < 4.0:
            got = client.recv(1 << 16)
            assert got
            bytes_after_s += len(got) if time.monotonic() - begun > 2.5 else 0
    assert bytes_after_s > 0


def test_an_upgrade_is_refused_by_the_server(tmp_path: Path) -> None:
    """A request for a WebSocket is answered with 400, and nothing fails over it."""
    request = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    request += b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
    app = live_app(tmp_path / "none.sock", ALMOST_AT_ONCE)
    with served(app, ALMOST_AT_ONCE) as port, connected(port, request) as client:
        assert b"HTTP/1.1 400" in client.makefile("rb").readline()


async def visits(port: int, count: int) -> list[bytes]:
    """First lines of the answers to live pages that are opened all at once and stay open."""

    async def visit() -> tuple[bytes, asyncio.StreamWriter]:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(b"GET /api/live HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        return await asyncio.wait_for(reader.readline(), PATIENCE_S), writer

    found = await asyncio.gather(*(visit() for _ in range(count)))
    for _, writer in found:
        writer.close()
    return [line for line, _ in found]


def test_a_burst_of_live_pages_of_one_address_is_answered(tmp_path: Path) -> None:
    """500 visitors of one address at once: as many streams as there are places, `come later` for the rest."""
    settings = WebSettings(port=0)
    with served(live_app(tmp_path / "none.sock", settings), settings) as port:
        lines = asyncio.run(visits(port, 500))

        again = asyncio.run(visits(port, 1))

    assert b"200 OK" in again[0]
    assert settings.max_streams == sum(b"200" in line for line in lines)
    assert 500 - settings.max_streams == sum(b"503" in line for line in lines)


def test_one_address_leaves_places_for_others() -> None:
    """An address whose connections are all being answered has no more than its share; another one gets in."""
    settings = WebSettings(port=0, max_connections=12, max_connections_per_address=8)

    async def forever(_: Request) -> Response:
        async def drops() -> Any:
            while True:
                yield b"x"
                await asyncio.sleep(0.05)

        return StreamingResponse(drops())

    app = Starlette(routes=[Route("/", forever), Route("/short", lambda _: PlainTextResponse("short"))])
    with served(app, settings) as port, ExitStack() as stack:
        request = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
        first = [stack.enter_context(connected(port, request)) for _ in range(8)]
        assert all(b"200" in client.makefile("rb").readline() for client in first)
        assert b"" == answer_or_nothing(port, "/short")
        other = stack.enter_context(socket.socket())
        other.settimeout(PATIENCE_S)
        other.bind(("127.0.0.2", 0))
        other.connect(("127.0.0.1", port))
        other.sendall(b"GET /short HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        assert b"200 OK" in other.makefile("rb").readline()


def test_a_visitor_that_reads_nothing_is_closed() -> None:
    """An answer that nobody takes holds its place for `stalled_s` and no longer."""
    app = Starlette(routes=[Route("/", lambda _: Response(b"x" * (32 << 20)))])
    request = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    with served(app, ALMOST_AT_ONCE) as port, connected(port, request) as client:
        time.sleep(4.0)
        got = 0
        try:
            while part := client.recv(1 << 20):
                got += len(part)
        except ConnectionError:
            pass
    assert got < 32 << 20


def test_tls_that_is_not_begun_is_closed(tmp_path: Path) -> None:
    """A connection counts from its first moment: one without a handshake is closed in time."""
    files = certificate(tmp_path)
    settings = WebSettings(port=0, secure=True, token=TOKEN, request_s=1.0)
    context = ssl.create_default_context(cafile=files[0])
    with served(live_app(tmp_path / "none.sock", settings), settings, *files) as port:
        with connected(port) as silent:
            assert ended_s(silent) < 4.0
        with context.wrap_socket(connected(port), server_hostname="127.0.0.1") as client:
            client.sendall(b"GET /login HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
            assert b"200 OK" in client.makefile("rb").readline()


def certificate(folder: Path) -> tuple[str, str]:
    """Files of a certificate for 127.0.0.1 and of its key."""
    from ipaddress import IPv4Address

    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "127.0.0.1")])
    now = datetime.now(UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(days=1))
        .not_valid_after(now + timedelta(days=1))
        .add_extension(
            x509.SubjectAlternativeName([x509.IPAddress(IPv4Address("127.0.0.1"))]), critical=False
        )
        .sign(key, hashes.SHA256())
    )
    (folder / "cert.pem").write_bytes(made.public_bytes(serialization.Encoding.PEM))
    plain = (serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    (folder / "key.pem").write_bytes(key.private_bytes(*plain))
    return str(folder / "cert.pem"), str(folder / "key.pem")


@pytest.mark.parametrize(
    ("host", "origin"),
    [
        ("10.0.0.1", "10.0.0.1"),
        ("::ffff:10.0.0.1", "10.0.0.1"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
        ("fe80::1%eth0", "fe80::/64"),
        ("", ""),
    ],
)
def test_whose_connections_count_together(host: str, origin: str) -> None:
    """An IPv6 subscriber has 2^64 addresses and counts as one."""
    assert origin == origin_of(host)


class Held(RuleBasedStateMachine):
    """Connections of three addresses that come, ask, are answered, stall and go."""

    def __init__(self) -> None:
        super().__init__()
        self.now_s = 0.0
        self.settings = WebSettings(
            max_connections=6, max_connections_per_address=4, request_s=10.0, stalled_s=60.0
        )
        self.connections = Connections(self.settings, lambda: self.now_s)
        self.number = 0
        self.open: dict[tuple[str, int], dict[str, Any]] = {}

    @rule(host=st.sampled_from(["10.0.0.1", "10.0.0.2", "10.0.0.3"]))
    def come(self, host: str) -> None:
        """A place is refused only where none of those who hold one waits."""
        self.number += 1
        address = (host, self.number)
        similar = [one for (other, _), one in self.open.items() if other == host]
        full = len(similar) >= self.settings.max_connections_per_address
        closable = similar if full else list(self.open.values())
        no_place = (full or len(self.open) >= self.settings.max_connections) and not any(
            one["waiting"] for one in closable
        )
        opened = socket.socket()
        assert self.connections.admit(opened, address) is not no_place
        if no_place:
            opened.close()
            return
        self.open[address] = {"socket": opened, "waiting": True, "since_s": self.now_s, "stalled_s": None}
        self.connections.attach(address, lambda: self.aborted(address))

    def aborted(self, address: tuple[str, int]) -> None:
        """Only those who wait or stall are closed."""
        one = self.open.pop(address)
        one["socket"].close()
        assert one["waiting"] or self.now_s - one["stalled_s"] > self.settings.stalled_s

    @precondition(lambda self: self.open)
    @rule(data=st.data(), what=st.sampled_from(["ask", "answered", "stall", "take", "go"]))
    def change(self, data: st.DataObject, what: str) -> None:
        """One of them does something."""
        address = data.draw(st.sampled_from(sorted(self.open)))
        one = self.open[address]
        if what == "ask":
            self.connections.mark_answering(address)
            one["waiting"] = False
        elif what == "answered":
            self.connections.mark_waiting(address)
            one.update(waiting=True, since_s=self.now_s)
        elif what == "go":
            self.connections.forget(socket.socket(), address)  # an older one of the same port
            self.connections.forget(one["socket"], address)
            self.open.pop(address)["socket"].close()
        else:
            self.connections.mark_stalled(address, what == "stall")
            one["stalled_s"] = self.now_s if what == "stall" else None

    @rule(passed_s=st.sampled_from([1.0, 5.0, 11.0, 61.0]))
    def expire(self, passed_s: float) -> None:
        """Nobody waits or stalls for longer than allowed."""
        self.now_s += passed_s
        self.connections.expire()
        for one in self.open.values():
            assert not one["waiting"] or self.now_s - one["since_s"] <= self.settings.request_s
            assert one["stalled_s"] is None or self.now_s - one["stalled_s"] <= self.settings.stalled_s

    @invariant()
    def bounded(self) -> None:
        """What is held is what is open, and never too many."""
        hosts = [host for host, _ in self.open]
        assert len(self.connections) == len(self.open) <= self.settings.max_connections
        assert all(hosts.count(host) <= self.settings.max_connections_per_address for host in hosts)

    def teardown(self) -> None:
        for one in self.open.values():
            one["socket"].close()


TestHeld = Held.TestCase
TestHeld.settings = hypothesis_settings(
    max_examples=60, stateful_step_count=40, derandomize=True, deadline=None
)
