"""Messages to a service manager, received on a real datagram socket."""

from __future__ import annotations

import os
import socket
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest

from tpmsd.onboard.sinks.sd_notify import Notifier


@pytest.fixture(params=["path", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[socket.socket, str]]:
    """A service manager's socket and the address it hands out."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as server:
        server.settimeout(5)
        if request.param == "path":
            address = str(tmp_path / "notify")
            server.bind(address)
        else:
            address = f"@tpmsd-test-{uuid.uuid4()}"
            server.bind("\0" + address[1:])
        yield server, address


def test_each_message_arrives_as_systemd_spells_it(manager: tuple[socket.socket, str]) -> None:
    """Ready, status, watchdog and stopping arrive in order, one datagram each."""
    server, address = manager
    notifier = Notifier(address, 10_000_000)
    sent = [
        notifier.ready("learning"),
        notifier.status("4 wheels\nREADY=0  monitored"),
        notifier.watchdog(),
        notifier.stopping("state saved"),
    ]
    assert [True] * 4 == sent
    assert [
        b"READY=1\nSTATUS=learning",
        b"STATUS=4 wheels READY=0 monitored",
        b"WATCHDOG=1",
        b"STOPPING=1\nSTATUS=state saved",
    ] == [server.recv(4096) for _ in range(4)]
    notifier.close()


def test_a_manager_that_comes_back_is_received_again(tmp_path: Path) -> None:
    """While nobody listens messages are lost without an error; afterwards they arrive."""
    address = str(tmp_path / "notify")
    notifier = Notifier(address)
    assert notifier.watchdog() is False
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as server:
        server.bind(address)
        assert notifier.watchdog() is True
        assert b"WATCHDOG=1" == server.recv(64)
    notifier.close()


def test_a_manager_that_does_not_read_blocks_nobody(tmp_path: Path) -> None:
    """Once the queue is full messages are dropped, at once."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as server:
        server.bind(str(tmp_path / "notify"))
        notifier = Notifier(str(tmp_path / "notify"))
        results = [notifier.watchdog() for _ in range(5000)]
        notifier.close()
    assert (True, False) == (results[0], results[-1])


@pytest.mark.parametrize("address", [None, "", "@", "/", "vsock:2:1234", "relative/path", "/with\0nul"])
def test_without_a_usable_address_nothing_happens(address: str | None) -> None:
    """No socket, no message, no error."""
    notifier = Notifier(address, 1_000_000)
    assert [False] * 4 == [notifier.ready(), notifier.watchdog(), notifier.stopping(), notifier.status("x")]


def test_the_environment_says_where_and_how_often() -> None:
    """NOTIFY_SOCKET and WATCHDOG_USEC are taken up; the period is half the time-out."""
    environment = {"NOTIFY_SOCKET": "/run/systemd/notify", "WATCHDOG_USEC": "30000000", "WATCHDOG_PID": "77"}
    assert 15.0 == Notifier.from_environment(environment, pid=77).watchdog_period_s
    assert Notifier.from_environment(environment, pid=78).watchdog_period_s is None
    assert Notifier.from_environment(environment, pid=78).enabled
    assert not Notifier.from_environment({}).enabled


@pytest.mark.parametrize("usec", ["", "0", "-5", "soon", "1e6", "9" * 30, "²"])
def test_a_watchdog_that_is_no_number_is_none(usec: str) -> None:
    """Nonsense in WATCHDOG_USEC switches the watchdog off."""
    environment = {"NOTIFY_SOCKET": "/run/notify", "WATCHDOG_USEC": usec}
    assert Notifier.from_environment(environment, pid=os.getpid()).watchdog_period_s is None


def test_no_status_is_longer_than_a_line_can_be(tmp_path: Path) -> None:
    """A long status is cut, so that the datagram always fits."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as server:
        server.bind(str(tmp_path / "notify"))
        notifier = Notifier(str(tmp_path / "notify"))
        assert notifier.status("ü" * 100_000)
        assert "STATUS=" + "ü" * 256 == server.recv(65536).decode()
        notifier.close()
