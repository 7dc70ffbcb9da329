"""Signals as something to wait for, in this very process."""

from __future__ import annotations

import select
import signal
import socket
from collections.abc import Iterator

import pytest

from tpmsd.onboard.daemon.signals import STOP_SIGNALS, SignalPipe


@pytest.fixture(autouse=True)
def usual() -> Iterator[None]:
    """The signals as a terminal has them; afterwards those of the process that tests."""
    before = {number: signal.signal(number, signal.SIG_DFL) for number in STOP_SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def readable(pipe: SignalPipe) -> bool:
    """Whether the descriptor says that a signal has come."""
    return bool(select.select([pipe], [], [], 0.0)[0])


@pytest.mark.parametrize("number", STOP_SIGNALS)
def test_a_signal_that_stops_is_read_once(number: signal.Signals) -> None:
    """Without a signal nothing is read, and nobody waits for it; each is read once and ends no process."""
    with SignalPipe() as pipe:
        assert (False, []) == (readable(pipe), pipe.read())
        signal.raise_signal(number)
        assert (True, [number]) == (readable(pipe), pipe.read())
        assert (False, []) == (readable(pipe), pipe.read())


def test_other_signals_wake_the_loop_and_do_not_stop_it() -> None:
    """A program around the daemon may have handlers of its own."""
    came: list[int] = []
    before = signal.signal(signal.SIGUSR1, lambda number, _: came.append(number))
    try:
        with SignalPipe() as pipe:
            signal.raise_signal(signal.SIGUSR1)
            signal.raise_signal(signal.SIGINT)
            assert [signal.SIGINT] == pipe.read()
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert [signal.SIGUSR1] == came


def test_what_was_installed_before_is_put_back() -> None:
    """Handlers and wake-up descriptor of the program around it are its own again, and the pipe is closed."""
    came: list[int] = []
    for number in STOP_SIGNALS:
        signal.signal(number, lambda number, _: came.append(number))
    reader, writer = socket.socketpair()
    with reader, writer:
        writer.setblocking(False)
        reader.settimeout(5.0)
        signal.set_wakeup_fd(writer.fileno())
        try:
            with SignalPipe() as pipe:
                signal.raise_signal(signal.SIGHUP)
            for number in STOP_SIGNALS:
                signal.raise_signal(number)
        finally:
            installed = signal.set_wakeup_fd(-1)
        assert writer.fileno() == installed
        assert bytes(STOP_SIGNALS) == reader.recv(16)
    assert (list(STOP_SIGNALS), -1) == (came, pipe.fileno())


def test_a_hang_up_that_nohup_switched_off_stays_off() -> None:
    """It is no reason to stop, nor is its handler exchanged."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with SignalPipe() as pipe:
        assert signal.SIG_IGN is signal.getsignal(signal.SIGHUP)
        signal.raise_signal(signal.SIGHUP)
        assert [] == pipe.read()
    assert signal.SIG_IGN is signal.getsignal(signal.SIGHUP)


def test_more_signals_than_the_pipe_holds_are_borne_in_silence(capfd: pytest.CaptureFixture[str]) -> None:
    """One byte that says "stop" is enough; a thousand fill the buffer, which is no matter for the log."""
    with SignalPipe() as pipe:
        for _ in range(1000):
            signal.raise_signal(signal.SIGTERM)
        assert {signal.SIGTERM} == set(pipe.read())
    assert ("", "") == capfd.readouterr()
