"""The daemon as a process that is maltreated: stopped, starved, filled up, and asked by too many."""

from __future__ import annotations

import json
import os
import pty
import resource
import signal
import socket
import stat
import time
import tty
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from tests.onboard.daemon.fakes import car
from tests.onboard.daemon.test_run_command import PATIENCE_S, daemon, ended, wait_for
from tpmsd.car.config.model import Config
from tpmsd.onboard.sinks.state_file import load_state
from tpmsd.onboard.sinks.status_client import read_status

MALICIOUS = [
    b"\x00" * 10_000,
    b"{" * 4000 + b"\n",
    b'{"request": {"request": "watch"}}\n',
    b'{"request": "' + b"A" * 4000 + b"\n",
    b"GET / HTTP/1.1\r\nHost: x\r\n\r\n",
    b"\xff\xfe\n",
    b"[" * 100_000,
    b'{"request": 1e999}\n',
]


@contextmanager
def receiver() -> Iterator[tuple[int, str]]:
    """A pseudo terminal: the descriptor to write to, and the name of the device."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    try:
        yield master, os.ttyname(slave)
    finally:
        os.close(master)
        os.close(slave)


def ask(path: Path, request: bytes) -> bytes:
    """What the daemon answers, up to the end of the connection."""
    with socket.socket(socket.AF_UNIX) as client:
        client.settimeout(PATIENCE_S)
        client.connect(str(path))
        try:
            client.sendall(request)
            answer = b""
            while chunk := client.recv(65536):
                answer += chunk
        except (BrokenPipeError, ConnectionResetError):
            return b""
    return answer


def until(path: Path, what: str, wanted: Any) -> dict[str, Any]:
    """The status document once `wanted(document)` holds."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        document = read_status(path)
        if wanted(document):
            return document
        time.sleep(0.05)
    raise AssertionError(f"never: {what}; {document}")


def started(folder: Path, device: str, extra: str = "") -> Config:
    config, _ = car(folder, f'[gnss]\ndevice = "{device}"\n{extra}')
    return config


def test_a_stopped_daemon_goes_on_where_it_was(tmp_path: Path) -> None:
    """SIGSTOP for two seconds, then SIGCONT: said in the log and by the counts, ticks go on, a clean stop."""
    with receiver() as (_, device):
        config = started(tmp_path, device)
        with daemon("--config", tmp_path) as process:
            before = wait_for("ticks", config.status.socket)
            process.send_signal(signal.SIGSTOP)
            time.sleep(2.0)
            process.send_signal(signal.SIGCONT)
            wanted = before["ticks"] + 30
            after = until(config.status.socket, "more ticks", lambda d: d["ticks"] >= wanted)
            code, log = ended(process, signal.SIGTERM)

    assert 0 == code
    assert after["missed_deadlines"] >= 15
    assert "the loop was" in log
    assert "Traceback" not in log


def test_memory_that_runs_out_does_not_end_the_daemon(tmp_path: Path) -> None:
    """With hardly any memory left, noise on the line and a hundred clients are borne, and ticks go on."""
    with receiver() as (line, device):
        config = started(tmp_path, device)
        with daemon("--config", tmp_path) as process:
            wait_for("ticks", config.status.socket)
            size = int(Path(f"/proc/{process.pid}/statm").read_text("ascii").split()[0]) * 4096
            resource.prlimit(process.pid, resource.RLIMIT_AS, (size + (2 << 20),) * 2)
            for _ in range(200):
                try:
                    os.write(line, b"\x00\xff$GP" * 800)
                except BlockingIOError:
                    time.sleep(0.005)
            with ExitStack() as clients:
                for _ in range(100):
                    client = clients.enter_context(socket.socket(socket.AF_UNIX))
                    client.connect(str(config.status.socket))
                    client.sendall(b"watch\n")
                before = read_status(config.status.socket)
                after = until(
                    config.status.socket, "more ticks", lambda d: d["ticks"] >= before["ticks"] + 10
                )
            code, log = ended(process, signal.SIGTERM)

    assert 0 == code
    assert "bytes but no sentence: wrong baud rate?" == after["gnss"]["detail"]
    assert "Traceback" not in log


def test_clients_of_every_kind_leave_the_ticks_alone(tmp_path: Path) -> None:
    """A hundred clients that watch, some that never read, and malicious ones: ticks keep their rate."""
    config, _ = car(tmp_path)
    with daemon("--config", tmp_path) as process, ExitStack() as clients:
        wait_for("ticks", config.status.socket)
        for _ in range(100):
            client = clients.enter_context(socket.socket(socket.AF_UNIX))
            client.connect(str(config.status.socket))
            client.sendall(b"watch\n")  # and then never reads
        began, before = time.monotonic(), read_status(config.status.socket)
        answers = [ask(config.status.socket, request) for request in MALICIOUS]
        after = until(config.status.socket, "more ticks", lambda d: d["ticks"] >= before["ticks"] + 20)
        elapsed_s = time.monotonic() - began
        descriptors = len(list(Path(f"/proc/{process.pid}/fd").iterdir()))
        code, log = ended(process, signal.SIGTERM)

    assert 0 == code
    assert all("error" in json.loads(answer) for answer in answers if answer)
    assert 20 <= after["ticks"] - before["ticks"] <= 10 * elapsed_s + 8
    assert descriptors < 100 + 30
    assert "Traceback" not in log


def test_a_full_disk_costs_the_state_and_nothing_else(tmp_path: Path) -> None:
    """While no file may grow the state is not saved, which is said once; when it may again, that is said."""
    config, _ = car(tmp_path, "interval_s = 1.0\n")
    assert config.state.file is not None
    with daemon("--config", tmp_path, "--speed-up", "5") as process:
        wait_for("ticks", config.status.socket)
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))
        before = read_status(config.status.socket)["ticks"]
        until(config.status.socket, "ticks", lambda d: d["ticks"] >= before + 100)
        saved = config.state.file.exists()
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
        until(config.status.socket, "ticks", lambda d: d["ticks"] >= before + 200)
        code, log = ended(process, signal.SIGTERM)

    assert 0 == code
    assert not saved
    assert 1 == log.count("cannot save the state")
    assert 1 == log.count("saved again")
    assert load_state(config.state.file) is not None


def test_the_socket_is_not_for_everybody(tmp_path: Path) -> None:
    """By default owner and group may ask, and nobody else."""
    config, _ = car(tmp_path)
    with daemon("--config", tmp_path) as process:
        wait_for("ticks", config.status.socket)
        found = config.status.socket.stat().st_mode
        code, _ = ended(process, signal.SIGTERM)

    assert 0 == code
    assert stat.S_ISSOCK(found)
    assert 0o660 == stat.S_IMODE(found)
