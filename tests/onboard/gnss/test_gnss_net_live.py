"""Receivers over the network: against servers on the loopback."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Iterator

import pytest

from tpmsd.onboard.sources.gnss.net_live import TcpReceiver, UdpReceiver
from tpmsd.onboard.sources.gnss.serial_live import ReceiverGone


@contextlib.contextmanager
def server(port: int = 0) -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", port)) as listener:
        listener.settimeout(5.0)
        yield listener


def read_some(receiver: TcpReceiver | UdpReceiver, patience_s: float = 5.0) -> bytes:
    end_s = time.monotonic() + patience_s
    while not (data := receiver.read()):
        assert time.monotonic() < end_s
        time.sleep(0.002)
    return data


def test_a_stream_is_read_after_the_greeting() -> None:
    """Opening does not wait; once connected the greeting is sent, and what comes is read."""
    with server() as listener:
        receiver = TcpReceiver("tcp", "localhost", listener.getsockname()[1], b"hello\n")
        receiver.open()
        connection, _ = listener.accept()
        with connection:
            connection.settimeout(5.0)
            assert b"" == receiver.read()
            assert b"hello\n" == connection.recv(100)
            connection.sendall(b"$GNRMC")
            assert b"$GNRMC" == read_some(receiver)
            assert receiver.fileno() >= 0
        receiver.close()
        receiver.close()
    with pytest.raises(ReceiverGone, match="not open"):
        receiver.read()


def test_a_server_that_goes_is_reported_and_found_again() -> None:
    """A closed connection and a refused one each end in one line; opening again later succeeds."""
    with server() as listener:
        port = listener.getsockname()[1]
        receiver = TcpReceiver("tcp://localhost", "127.0.0.1", port)
        receiver.open()
        listener.accept()[0].close()
        with pytest.raises(ReceiverGone, match="has closed the connection"):
            read_some(receiver)
    with pytest.raises(ReceiverGone, match="nobody listens there"):
        receiver.open()
        read_some(receiver)
    with server(port) as listener:
        receiver.open()
        connection, _ = listener.accept()
        connection.sendall(b"again")
        assert b"again" == read_some(receiver)
        connection.close()
    receiver.close()


def test_a_host_that_never_answers_does_not_hold_anybody_up() -> None:
    """Opening and reading return at once while a connection is not made."""
    with socket.socket() as full:
        full.bind(("127.0.0.1", 0))
        full.listen(0)
        port = full.getsockname()[1]
        blockers = [socket.socket() for _ in range(4)]
        for blocker in blockers:  # a queue that is full answers nobody
            blocker.setblocking(False)
            blocker.connect_ex(("127.0.0.1", port))
        receiver = TcpReceiver("tcp", "127.0.0.1", port, b"hello")
        began_s = time.monotonic()
        receiver.open()
        assert [b""] * 20 == [receiver.read() for _ in range(20)]
        assert time.monotonic() - began_s < 0.5
        for blocker in [*blockers, receiver]:
            blocker.close()


def test_a_name_is_looked_up_beside_the_loop() -> None:
    """A name that nobody knows ends in one line, and never holds the caller up for long."""
    receiver = TcpReceiver("tcp", "no-such-host.invalid", 1)
    began_s = time.monotonic()
    reasons = set()
    while "its name is not found" not in " ".join(reasons) and time.monotonic() - began_s < 30.0:
        asked_s = time.monotonic()
        with pytest.raises(ReceiverGone) as gone:
            receiver.open()
        assert time.monotonic() - asked_s < 0.5
        reasons.add(gone.value.reason)
        time.sleep(0.05)

    assert any(reason.startswith("its name is not found") for reason in reasons)


def test_datagrams_are_whole_lines() -> None:
    """Datagrams come one by one, each closed with a line end; nothing is heard on another address."""
    receiver = UdpReceiver("udp", "127.0.0.1", 0)
    receiver.open()
    assert receiver._socket is not None
    address = receiver._socket.getsockname()
    assert "127.0.0.1" == address[0]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(b"$GNRMC,cut", address)
        sender.sendto(b"$GNGGA,1\r\n", address)
        assert b"$GNRMC,cut\r\n" == read_some(receiver)
        assert b"$GNGGA,1\r\n\r\n" == read_some(receiver)
    other = UdpReceiver("udp", "127.0.0.1", address[1])
    with pytest.raises(ReceiverGone, match="another program listens there"):
        other.open()
    receiver.close()
