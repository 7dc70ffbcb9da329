"""Starts and stops programs for the tests, on free ports of the loopback, in a folder of their own."""

from __future__ import annotations

import contextlib
import os
import pty
import shutil
import signal
import socket
import subprocess
import sys
import time
import tty
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

import pytest

PATHS = f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"
"""Debian keeps gpsd and mosquitto where an ordinary user does not look."""

PATIENCE_S = 60.0

Value = TypeVar("Value")


def program(name: str) -> str:
    """Its path; skips the test, with the reason, where it is not installed."""
    found = shutil.which(name, path=PATHS)
    if found is None:
        pytest.skip(f"{name} is not installed")
    return found


def free_port() -> int:
    """A port of the loopback that nobody listens on."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


def wait_for(what: str, ask: Callable[[], Value | None], patience_s: float = 15.0) -> Value:
    """What `ask` says as soon as it says something true."""
    end_s = time.monotonic() + patience_s
    while not (answer := ask()):
        assert time.monotonic() < end_s, f"{what}: not within {patience_s:g} s"
        time.sleep(0.02)
    return answer


def listens(port: int) -> bool:
    """Whether somebody accepts connections there."""
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
        return True
    return False


class Server:
    """One program that can be killed and started again."""

    def __init__(self, command: Sequence[str], log: Path, port: int) -> None:
        self.command, self.log, self.port = list(command), log, port
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it, and wait until it listens."""
        with self.log.open("ab") as log:
            self._process = subprocess.Popen(self.command, stdout=log, stderr=log, stdin=subprocess.DEVNULL)
        wait_for(f"{self.command[0]} (see {self.log})", self._is_up)

    def _is_up(self) -> bool:
        assert self._process is not None
        assert self._process.poll() is None, self.log.read_text("utf-8", "replace")[-2000:]
        return listens(self.port)

    def stop(self, number: signal.Signals = signal.SIGTERM) -> None:
        """Stop it; SIGKILL for a crash."""
        process, self._process = self._process, None
        if process is not None:
            process.send_signal(number)
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait(10.0)

    def __enter__(self) -> Server:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


class Process:
    """A program of tpmsd that may be killed and started again."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self._command = [sys.executable, "-m", "tpmsd", *arguments]
        self._log = folder / f"{'-'.join(arguments[:2])}.log"
        self._process: subprocess.Popen[bytes] | None = None
        self.start()

    def start(self) -> None:
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(self._command, stdout=log, stderr=log)

    @property
    def pid(self) -> int:
        assert self._process is not None
        return self._process.pid

    def lives(self) -> bool:
        assert self._process is not None
        return self._process.poll() is None

    def end(self, number: signal.Signals) -> int:
        assert self._process is not None
        self._process.send_signal(number)
        return self._process.wait(PATIENCE_S)


@contextlib.contextmanager
def raw_pty() -> Iterator[tuple[int, str]]:
    """A pseudo terminal without line discipline: the descriptor to write to, and the path to read from."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    path = os.ttyname(slave)
    Path(path).chmod(0o666)  # gpsd gives up root
    try:
        yield master, path
    finally:
        os.close(master)
        os.close(slave)
