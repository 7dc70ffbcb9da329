"""What the tests on a real bus share: the daemon as a process, listeners and players that are not ours.

Nothing here imports tpmsd: what leaves the daemon is read as any other program would.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shlex
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cantools
from crccheck.crc import Crc8SaeJ1850

from tests.conftest import REPO

TPMSD = shlex.split(os.environ.get("TPMSD_HIL_COMMAND", "tpmsd"))
ENVIRONMENT = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1"}
PROMPT = shlex.split(os.environ.get("TPMSD_HIL_PROMPT", ""))
"""Before a command that plays a car: a car keeps its time, whatever else this one processor has to do."""
PATIENCE_S = 60.0
"""A busy machine takes its time; nothing here is judged by it."""

STATUS_ID, ALARM_ID = 0x6F0, 0x6F1
_DATA_ID = {STATUS_ID: 0xF0, ALARM_ID: 0xF1}
_LINE = re.compile(r"\((\d+\.\d+)\) (\S+) ([0-9A-F]+)#(#?)([0-9A-FR]*)$")


@dataclass(frozen=True)
class Frame:
    """A line of `candump -L`."""

    time_s: float
    channel: str
    identifier: int
    extended: bool
    fd: bool
    data: bytes


def parse(line: str) -> Frame | None:
    """One line of candump; None for what is not whole (it may still be written to)."""
    match = _LINE.match(line)
    if match is None or "R" in match[5]:
        return None
    fd = bool(match[4])
    return Frame(
        float(match[1]), match[2], int(match[3], 16), len(match[3]) > 3, fd, bytes.fromhex(match[5][fd:])
    )


class Listener:
    """`candump` on one interface: a program that knows nothing of ours."""

    def __init__(self, channel: str, file: Path, *filters: str) -> None:
        self._file = file
        target = ",".join((channel, *filters))
        self._out = file.open("wb")
        before = sockets()
        self._process = subprocess.Popen(["candump", "-L", target], stdout=self._out, stderr=subprocess.PIPE)
        # It ends at once where there is no such interface.
        wait_until(lambda: sockets() > before or self._process.poll() is not None, "candump listens")
        assert self._process.poll() is None, f"candump cannot listen on {channel}"

    def frames(self, *identifiers: int) -> list[Frame]:
        """All that was heard so far, or that of some identifiers."""
        lines = self._file.read_text("ascii", "replace").splitlines()
        frames = [frame for frame in map(parse, lines) if frame is not None]
        return [frame for frame in frames if not identifiers or frame.identifier in identifiers]

    def close(self) -> None:
        end(self._process)
        self._out.close()


def sockets() -> int:
    """Receivers of CAN frames that this machine's kernel knows."""
    lists = Path("/proc/net/can").glob("rcvlist_*")
    return sum(len(file.read_text("ascii").splitlines()) for file in lists)


def decode(frames: list[Frame]) -> list[dict[str, Any]]:
    """tpmsd's frames by its DBC, with cantools; the checksum by another library than the daemon's own."""
    database: Any = cantools.database.load_file(REPO / "dbc" / "tpmsd.dbc")
    decoded = []
    for frame in frames:
        assert checksum(frame) == frame.data[0], frame
        values = database.decode_message(frame.identifier, frame.data)
        decoded.append({"time_s": frame.time_s, **{name: plain(value) for name, value in values.items()}})
    return decoded


def plain(value: Any) -> Any:
    """Numbers as they are, words as words."""
    return value if isinstance(value, int | float) else str(value)


def checksum(frame: Frame) -> int:
    """CRC-8/SAE-J1850 over the data id and bytes 1 to 7, as docs/reference/can-output.md says."""
    return int(Crc8SaeJ1850.calc(bytes((_DATA_ID[frame.identifier],)) + frame.data[1:]))


def end(process: subprocess.Popen[Any], number: signal.Signals = signal.SIGTERM) -> int:
    """End a process and wait for it; its exit code."""
    if process.poll() is None:
        process.send_signal(number)
    try:
        process.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    for stream in (process.stdin, process.stdout, process.stderr):
        if stream is not None:
            stream.close()
    return int(process.returncode)


def wait_until(true: Callable[[], Any], what: str, timeout_s: float = PATIENCE_S) -> Any:
    """The first result that is true; AssertionError with `what` if there is none in time."""
    end_s = time.monotonic() + timeout_s
    while time.monotonic() < end_s:
        result = true()
        if result:
            return result
        time.sleep(0.05)
    raise AssertionError(f"not within {timeout_s:.0f} s: {what}")


class Daemon:
    """`tpmsd run` as a process of its own."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        """`folder` holds vehicle.toml and its DBC; socket, state and log go there, too."""
        self.folder = folder
        self.socket, self.state, self.log_file = folder / "s.sock", folder / "state.json", folder / "log"
        command = [*TPMSD, "run", "--config", str(folder), *arguments]
        command += ["--socket", str(self.socket), "--state", str(self.state)]
        with self.log_file.open("wb") as log:
            self.process = subprocess.Popen(command, stderr=log, env=ENVIRONMENT)

    def status(self) -> dict[str, Any]:
        """The status document, by the socket; empty if nobody answers."""
        return ask(self.socket)

    def ready(self) -> dict[str, Any]:
        """The status once there are ticks."""
        return self.until(lambda status: status["ticks"] > 0, "first tick")

    def until(self, true: Callable[[dict[str, Any]], Any], what: str, timeout_s: float = PATIENCE_S) -> Any:
        """The first status of which that holds."""
        last: dict[str, Any] = {}

        def holds() -> dict[str, Any] | None:
            nonlocal last
            last = self.status() or last
            return last if last and true(last) else None

        try:
            return wait_until(holds, what, timeout_s)
        except AssertionError as error:
            raise AssertionError(f"{error}\n{json.dumps(last)}\n{self.log()}") from None

    def log(self) -> str:
        return self.log_file.read_text("utf-8", "replace")

    def stop(self) -> int:
        """SIGTERM; the exit code."""
        return end(self.process)


def ask(path: Path | str) -> dict[str, Any]:
    """What a status socket answers."""
    with contextlib.suppress(OSError, ValueError), socket.socket(socket.AF_UNIX) as client:
        client.settimeout(5.0)
        client.connect(str(path))
        client.sendall(b"status\n")
        answer = b""
        while chunk := client.recv(65536):
            answer += chunk
        document: dict[str, Any] = json.loads(answer)
        return document
    return {}


@contextlib.contextmanager
def running(folder: Path, *arguments: str) -> Iterator[Daemon]:
    """A daemon, ended by all means."""
    daemon = Daemon(folder, *arguments)
    try:
        yield daemon
    finally:
        daemon.process.kill()
        daemon.process.wait()


@contextlib.contextmanager
def listening(channel: str, file: Path, *filters: str) -> Iterator[Listener]:
    """candump, ended by all means."""
    listener = Listener(channel, file, *filters)
    try:
        yield listener
    finally:
        listener.close()


def run(*command: str | Path, **options: Any) -> str:
    """A command that must succeed; what it prints."""
    done = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, env=ENVIRONMENT, timeout=300, **options
    )
    assert done.returncode == 0, f"{command}: {done.stderr[-1000:]}"
    return done.stdout


def simulate(*arguments: str | Path) -> subprocess.Popen[bytes]:
    """`tpmsd simulate` as a process of its own."""
    return subprocess.Popen(
        [*PROMPT, *TPMSD, "simulate", *map(str, arguments)],
        env=ENVIRONMENT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


@contextlib.contextmanager
def simulating(*arguments: str | Path) -> Iterator[subprocess.Popen[bytes]]:
    """A simulator, ended by all means."""
    process = simulate(*arguments)
    try:
        yield process
    finally:
        end(process)
