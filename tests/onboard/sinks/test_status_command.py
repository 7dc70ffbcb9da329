"""`tpmsd status` against real sockets: a daemon that answers, and everything that may stand in its place."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from tests.beside import beside
from tests.onboard.daemon.fakes import hear_signals
from tpmsd.car.config.model import StatusConfig
from tpmsd.interfaces.cli.main import main
from tpmsd.interfaces.cli.status_table import render_status
from tpmsd.onboard.sinks.status_client import MAX_LINE_BYTES, StatusError, read_status, watch_status
from tpmsd.onboard.sinks.status_server import StatusServer

DOCUMENT: dict[str, Any] = {
    "version": 1,
    "tpmsd": "0.2.0",
    "time": 10.0,
    "wheels": {"rl": {"state": "monitoring", "change_mm": -0.1, "change_std_mm": 0.1}},
    "alarms": [],
}


@contextmanager
def daemon(path: Path, updates: int | None = None) -> Iterator[None]:
    """A status server in a thread, publishing every 20 ms; it closes after so many updates."""
    server = StatusServer(path, lambda: DOCUMENT)
    server.open()

    def loop(over: threading.Event) -> None:
        done = 0
        while not over.wait(0.02) and done != updates:
            done += server.watchers > 0
            server.publish(time.monotonic())
        server.close()

    with beside(loop):
        yield


@contextmanager
def stranger(path: Path, behave: Callable[[socket.socket], None]) -> Iterator[None]:
    """Somebody else on the socket, who treats one connection as `behave` says."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(str(path))
        listener.listen()

        def loop() -> None:
            connection, _ = listener.accept()
            with connection, suppress(OSError):  # once the client has gone we may go, too
                behave(connection)

        thread = threading.Thread(target=loop, daemon=True)
        thread.start()
        yield
        thread.join(timeout=5)


def test_status_shows_the_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The table goes to standard output, and nothing else anywhere."""
    with daemon(tmp_path / "s"):
        code = main(["status", "--socket", str(tmp_path / "s")])
    assert (0, render_status(DOCUMENT), "") == (code, *capsys.readouterr())


@pytest.mark.parametrize("option", [["--json"], ["--json", "-"]])
def test_status_gives_json_on_standard_output(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: list[str]
) -> None:
    """--json without a file is standard output."""
    with daemon(tmp_path / "s"):
        code = main(["status", *option, "--socket", str(tmp_path / "s")])
    assert (0, DOCUMENT) == (code, json.loads(capsys.readouterr().out))


def test_status_gives_json_to_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """--json FILE writes the document there, and standard output stays empty."""
    with daemon(tmp_path / "s"):
        code = main(["status", "--json", str(tmp_path / "out.json"), "--socket", str(tmp_path / "s")])
    assert (0, DOCUMENT, "") == (
        code,
        json.loads((tmp_path / "out.json").read_text()),
        capsys.readouterr().out,
    )


def test_the_socket_may_come_from_the_configuration(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """--config FILE asks on the socket of its [status] table."""
    (tmp_path / "bus.dbc").write_text('VERSION ""\n')
    signals = "\n".join(f'wheel_count_{wheel} = "W.{wheel}"' for wheel in ("rl", "rr"))
    (tmp_path / "vehicle.toml").write_text(
        "[vehicle]\nwheel_radius_m = 0.316\ntrack_front_m = 1.53\ntrack_rear_m = 1.52\nwheelbase_m = 2.63\n"
        f'[can]\ndbc = "bus.dbc"\n[can.signals]\n{signals}\n[status]\nsocket = "{tmp_path / "s"}"\n'
    )
    with daemon(tmp_path / "s"):
        code = main(["status", "--config", str(tmp_path / "vehicle.toml")])
    assert (0, render_status(DOCUMENT), "") == (code, *capsys.readouterr())


def test_watching_shows_each_update_until_the_daemon_goes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One table at once and one per update; the end of the daemon is one line and exit code 1."""
    with daemon(tmp_path / "s", updates=3):
        code = main(["status", "--watch", "--socket", str(tmp_path / "s")])
    out, err = capsys.readouterr()
    assert (1, f"tpmsd: {tmp_path / 's'}: tpmsd has closed the connection\n") == (code, err)
    assert "\n".join([render_status(DOCUMENT)] * 4) == out


def test_watching_as_json_is_one_line_per_update(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """--watch --json writes JSON lines, to standard output or to a file."""
    for option in (["--json"], ["--json", str(tmp_path / "log")]):
        with daemon(tmp_path / "s", updates=2):
            main(["status", "--watch", *option, "--socket", str(tmp_path / "s")])
        text = capsys.readouterr().out if len(option) == 1 else (tmp_path / "log").read_text()
        assert [DOCUMENT] * 3 == [json.loads(line) for line in text.splitlines()]


def test_ctrl_c_ends_watching_in_peace(tmp_path: Path) -> None:
    """An interrupt while watching is the normal way out: exit code 0 and no message."""
    command = [sys.executable, "-m", "tpmsd", "status", "--watch", "--json", "--socket", str(tmp_path / "s")]
    with daemon(tmp_path / "s"):
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, preexec_fn=hear_signals
        )
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=10)
    assert (0, b"") == (process.returncode, err)


# ---- what may stand in its place


def failure(path: Path, capsys: pytest.CaptureFixture[str], *options: str) -> tuple[int, str]:
    code = main(["status", "--socket", str(path), *options])
    out, err = capsys.readouterr()
    assert out == ""
    assert 1 == err.count("\n")
    return code, err.rstrip("\n")


def test_no_socket_is_one_clear_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A path where nothing is: asks whether tpmsd is running."""
    path = tmp_path / "s"
    expected = (
        f"tpmsd: there is no socket {path}: is tpmsd running? (--socket PATH or --config FILE names another)"
    )
    assert (1, expected) == failure(path, capsys)


def test_no_daemon_is_one_clear_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A socket that a killed daemon left behind."""
    path = tmp_path / "s"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as dead:
        dead.bind(str(path))
    assert (1, f"tpmsd: nobody answers on {path}: tpmsd is not running") == failure(path, capsys)


def test_a_file_that_is_no_socket_is_one_clear_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A configuration file given by mistake."""
    (tmp_path / "s").write_text("")
    assert (1, f"tpmsd: {tmp_path / 's'} is not a socket") == failure(tmp_path / "s", capsys)


def test_a_path_through_a_file_is_one_clear_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What the system says is passed on where there is nothing better to say."""
    (tmp_path / "f").write_text("")
    path = tmp_path / "f" / "s"
    assert (1, f"tpmsd: cannot ask on {path}: Not a directory") == failure(path, capsys)


def test_a_path_too_long_is_wrong_usage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No socket can have that path: exit code 2."""
    code, line = failure(tmp_path / ("s" * 200), capsys)
    assert (2, "at most 107 are possible") == (code, line[line.index("at most") : line.rindex(":")])


def test_no_permission_is_one_clear_line() -> None:
    """A socket of another group: who may not ask is told where to look."""
    if os.geteuid() != 0:
        pytest.skip("needs root to become somebody else")
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        path = Path(folder) / "s"
        server = StatusServer(path, lambda: DOCUMENT, mode=0o600)
        server.open()
        reader, writer = os.pipe()
        child = os.fork()
        if child == 0:
            os.setuid(65534)
            try:
                read_status(path)
            except StatusError as error:
                os.write(writer, str(error).encode())
            os._exit(0)
        os.close(writer)
        os.waitpid(child, 0)
        said = os.read(reader, 4096).decode()
        os.close(reader)
        server.close()
    assert f"no permission to ask on {path}: are you in the group that owns it?" == said


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (b"", "tpmsd has closed the connection"),
        (b"SSH-2.0-OpenSSH_9.2\r\n", "what answers is not tpmsd (no JSON)"),
        (b"[1, 2]\n", "what answers is not tpmsd (no JSON object)"),
        (b"[" * 50_000 + b"\n", "what answers is not tpmsd (no JSON)"),
        (b"{}\n", "what answers is not tpmsd (no version)"),
        (b'{"version": 1, "whe', "what answers is not tpmsd (half a line)"),
        (
            b"\x00" * (MAX_LINE_BYTES + 70_000),
            f"what answers is not tpmsd (more than {MAX_LINE_BYTES} bytes)",
        ),
        (b'{"error": "too many\\u001b[2J clients"}\n', "tpmsd says: too many [2J clients"),
        (b'{"version": 9}\n', "the daemon's status has version 9, this tpmsd reads 1"),
    ],
)
def test_a_strange_answer_is_one_clear_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], answer: bytes, reason: str
) -> None:
    """Garbage, half lines, floods and errors of the daemon end in one line and exit code 1."""

    def behave(connection: socket.socket) -> None:
        connection.recv(4096)
        connection.sendall(answer)

    with stranger(tmp_path / "s", behave):
        assert (1, f"tpmsd: {tmp_path / 's'}: {reason}") == failure(tmp_path / "s", capsys)


def test_a_daemon_that_hangs_is_not_waited_for_for_ever(tmp_path: Path) -> None:
    """Silence, and a trickle that never ends a line, are given up after the time-out."""

    def silent(connection: socket.socket) -> None:
        connection.recv(4096)
        connection.recv(1)

    def trickle(connection: socket.socket) -> None:
        while connection.send(b" "):
            time.sleep(0.01)

    for number, behave in enumerate((silent, trickle)):
        path = tmp_path / f"s{number}"
        with stranger(path, behave):
            start_s = time.monotonic()
            with pytest.raises(StatusError) as caught:
                read_status(path, timeout_s=0.3)
            assert f"{path}: tpmsd does not answer (waited 0.3 s)" == str(caught.value)
            assert 0.25 < time.monotonic() - start_s < 2.0


def test_a_watched_daemon_that_stops_ticking_is_reported(tmp_path: Path) -> None:
    """After the first document silence counts as hanging, too."""

    def once(connection: socket.socket) -> None:
        connection.sendall(json.dumps(DOCUMENT).encode() + b"\n")
        connection.recv(4096)
        connection.recv(1)

    with stranger(tmp_path / "s", once):
        documents = watch_status(tmp_path / "s", timeout_s=0.2)
        assert DOCUMENT == next(documents)
        with pytest.raises(StatusError, match="does not answer"):
            next(documents)


@pytest.mark.parametrize(
    "arguments", [["--sockets", "x"], ["--socket"], ["--socket", "a", "--config", "b"], ["surplus"]]
)
def test_wrong_usage_is_exit_code_two(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Unknown, incomplete and contradicting options."""
    assert 2 == main(["status", *arguments])
    assert "usage: tpmsd" in capsys.readouterr().err


def test_help_names_the_default_socket(capsys: pytest.CaptureFixture[str]) -> None:
    """--help says where it asks if nothing is given."""
    assert 0 == main(["status", "--help"])
    assert str(StatusConfig().socket) in capsys.readouterr().out
