"""`tpmsd run` as a process: exit codes, signals, state over a restart, status socket, journal."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.onboard.daemon.fakes import ServiceManagerSocket, car, hear_signals
from tpmsd.interfaces.cli.main import main
from tpmsd.onboard.sinks.state_file import load_state
from tpmsd.onboard.sinks.status_client import read_status

PATIENCE_S = 20.0


def command(*arguments: str | Path) -> list[str]:
    return [sys.executable, "-m", "tpmsd", "run", *map(str, arguments)]


@contextmanager
def daemon(*arguments: str | Path, **environment: str) -> Iterator[subprocess.Popen[str]]:
    """A daemon of its own process, which is ended by all means."""
    process = subprocess.Popen(
        command(*arguments),
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", **environment},
        preexec_fn=hear_signals,
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def wait_for(what: str, path: Path) -> Any:
    """The status document, once the daemon answers with ticks."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        try:
            document = read_status(path)
        except Exception:
            time.sleep(0.05)
            continue
        if document["ticks"] > 0:
            return document
        time.sleep(0.05)
    raise AssertionError(f"no daemon with {what}")


def ended(process: subprocess.Popen[str], number: signal.Signals) -> tuple[int, str]:
    """Exit code and log of a daemon that gets a signal."""
    process.send_signal(number)
    _, log = process.communicate(timeout=PATIENCE_S)
    return process.returncode, log


def test_sigterm_stops_in_order_with_the_state_saved(tmp_path: Path) -> None:
    """READY once there are ticks, the status on the socket, then SIGTERM: state saved, STOPPING said, exit
    0."""
    config, _ = car(tmp_path)
    manager = ServiceManagerSocket(tmp_path / "notify.sock")
    with daemon("--config", tmp_path, "--speed-up", "5", NOTIFY_SOCKET=str(manager.path)) as process:
        document = wait_for("ticks", config.status.socket)
        ready = manager.received()
        asked = subprocess.run(
            [sys.executable, "-m", "tpmsd", "status", "--socket", str(config.status.socket), "--json"],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
        )
        code, log = ended(process, signal.SIGTERM)
    received = manager.received()
    manager.close()

    assert 0 == code
    assert ("waiting", "off") == (document["can"]["state"], document["gnss"]["state"])
    assert {"fl", "fr", "rl", "rr"} == set(document["wheels"])
    assert (0, "fake") == (asked.returncode, json.loads(asked.stdout)["can"]["channel"])
    assert "READY=1" in ready
    assert "STOPPING=1" in received
    assert config.state.file is not None
    payload = load_state(config.state.file)
    assert payload is not None
    assert {"estimator", "monitor"} == set(payload["pipeline"])
    assert not config.status.socket.exists()
    assert "stopping: SIGTERM" in log
    assert "Traceback" not in log


def test_a_hangup_stops_it_too(tmp_path: Path) -> None:
    """A terminal that goes away ends the daemon as SIGTERM does."""
    config, _ = car(tmp_path)
    with daemon("--config", tmp_path, "--speed-up", "5") as process:
        wait_for("ticks", config.status.socket)
        code, log = ended(process, signal.SIGHUP)

    assert (0, True) == (code, "stopping: SIGHUP" in log)


def test_what_was_learned_is_taken_up_at_the_next_start(tmp_path: Path) -> None:
    """The second run says that it took up the state of the first, and keeps what the first had saved."""
    config, _ = car(tmp_path)
    assert config.state.file is not None
    first = subprocess.run(
        command("--config", tmp_path, "--speed-up", "10", "--duration", "5"),
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    saved = load_state(config.state.file)
    second = subprocess.run(
        command("--config", tmp_path, "--speed-up", "10", "--duration", "5"),
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )

    assert (0, 0) == (first.returncode, second.returncode)
    assert saved is not None
    assert "taken up what was learned before" not in first.stderr
    assert f"{config.state.file}: taken up what was learned before" in second.stderr


def test_a_damaged_state_is_set_aside_and_said(tmp_path: Path) -> None:
    """Garbage where the state should be costs one line, not the start."""
    config, _ = car(tmp_path)
    assert config.state.file is not None
    config.state.file.write_bytes(os.urandom(200))
    done = subprocess.run(
        command("--config", tmp_path, "--speed-up", "10", "--duration", "5"),
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )

    assert 0 == done.returncode
    assert (tmp_path / "state.json.damaged-1").is_file()
    assert 1 == done.stderr.count("set aside as state.json.damaged-1, starting without it")
    assert load_state(config.state.file) is not None


def test_the_log_fits_the_journal(tmp_path: Path) -> None:
    """For the journal every line begins with its priority and bears no time; elsewhere it bears the time."""
    car(tmp_path, '[gnss]\ndevice = "nowhere"\n')
    arguments = ("--config", tmp_path, "--speed-up", "10", "--duration", "5", "-v")
    environment = {**os.environ, "JOURNAL_STREAM": "8:12345"}
    journal = subprocess.run(command(*arguments), capture_output=True, text=True, env=environment)
    environment.pop("JOURNAL_STREAM")
    plain = subprocess.run(command(*arguments), capture_output=True, text=True, env=environment)

    assert [] == [line for line in journal.stderr.splitlines() if not re.match(r"<[2-7]>\S", line)]
    assert "<4>receiver nowhere: no such device; trying again until it is back" in journal.stderr
    assert "<7>" in journal.stderr
    assert [] == [
        line
        for line in plain.stderr.splitlines()
        if not re.match(r"\d\d:\d\d:\d\d (DEBUG|INFO|WARNING)", line)
    ]


def test_a_second_daemon_gives_way(tmp_path: Path) -> None:
    """A second daemon on the state file, or on the socket alone, ends with one line and exit 1."""
    config, _ = car(tmp_path)
    with daemon("--config", tmp_path) as process:
        wait_for("ticks", config.status.socket)
        second, third = (
            subprocess.run(
                command("--config", tmp_path, *state), capture_output=True, text=True, timeout=PATIENCE_S
            )
            for state in ((), ("--state", tmp_path / "other.json"))
        )
        code, log = ended(process, signal.SIGINT)

    assert (0, True) == (code, "stopping: SIGINT" in log)
    assert (1, 1) == (second.returncode, third.returncode)
    assert f"another tpmsd (process {process.pid}) keeps its state there" in second.stderr.splitlines()[-1]
    assert third.stderr.splitlines()[-1].endswith("another tpmsd is answering on it")


def test_the_command_line_overrides_and_is_recorded(tmp_path: Path) -> None:
    """Interface, channel and device of the command line are what runs, and what the recording says."""
    car(tmp_path)
    arguments = ["run", "--config", str(tmp_path), "--channel", "another", "--device", "nowhere"]
    arguments += ["--record", str(tmp_path / "drive"), "--speed-up", "20", "--duration", "5"]
    code = main(arguments)
    text = (tmp_path / "drive" / "vehicle.toml").read_text()

    assert 0 == code
    assert 'channel = "another"' in text
    assert 'device = "nowhere"' in text
    assert {"vehicle.toml", "bus.dbc", "can.log", "gnss.nmea"} == {
        path.name for path in (tmp_path / "drive").iterdir()
    }
    stamps = re.findall(r"^\((\d+\.\d{6})\) \$PTPMSD$", (tmp_path / "drive" / "gnss.nmea").read_text(), re.M)
    assert 4 <= len(stamps) <= 12


def test_state_and_socket_can_be_set_on_the_command_line(tmp_path: Path) -> None:
    """One configuration serves two daemons: each has the state file and the socket it is told."""
    config, _ = car(tmp_path)
    assert config.state.file is not None
    socket, state = tmp_path / "other" / "s.sock", tmp_path / "other" / "kept.json"
    with daemon("--config", tmp_path, "--speed-up", "5", "--state", state, "--socket", socket) as process:
        wait_for("ticks", socket)
        code, _log = ended(process, signal.SIGTERM)

    assert 0 == code
    assert load_state(state) is not None
    assert [False, False] == [config.state.file.exists(), config.status.socket.exists()]


@pytest.mark.parametrize(
    ("extra", "arguments", "says"),
    [
        ("", ["--config", "{folder}/none.toml"], "none.toml: no such file"),
        ("[nonsense]\nx = 1\n", ["--config", "{folder}"], "[nonsense]"),
        ("", ["--config", "{folder}", "--interface", "soketcan"], "did you mean socketcan?"),
        ("", ["--config", "{folder}", "--channel", " "], "--channel is empty"),
        ("", ["--config", "{folder}", "--dbc", "{folder}/other.dbc"], "no such DBC file"),
        ("", ["--config", "{folder}", "--speed-up", "0"], "speed-up 0 is outside"),
        ("", ["--config", "{folder}", "--duration", "-3"], "--duration -3"),
        ("", ["--config", "{folder}", "--record", "{folder}/bus.dbc/x"], "cannot record to"),
        ("", ["--config", "{folder}", "--speed-up", "fast"], "invalid float value"),
    ],
)
def test_wrong_usage_and_configuration_exit_2(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], extra: str, arguments: list[str], says: str
) -> None:
    """Whatever is wrong before the start ends with what is wrong and exit code 2."""
    car(tmp_path)
    (tmp_path / "vehicle.toml").write_text((tmp_path / "vehicle.toml").read_text() + extra)
    code = main(["run", *(argument.format(folder=tmp_path) for argument in arguments)])
    said = capfd.readouterr().err

    assert 2 == code
    assert says in said
    assert "Traceback" not in said


def test_a_signal_that_the_dbc_lacks_exits_2(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Names are checked against the DBC before anything is opened, with the nearest spelling."""
    car(tmp_path)
    file = tmp_path / "vehicle.toml"
    file.write_text(file.read_text().replace("WHEELS.RL", "WHEELS.LR"))

    assert 2 == main(["run", "--config", str(tmp_path)])
    assert "WHEELS.LR" in capfd.readouterr().err


def test_the_help_explains(capfd: pytest.CaptureFixture[str]) -> None:
    """The help names every option, gives examples and the exit codes."""
    assert 0 == main(["run", "--help"])
    said = capfd.readouterr().out
    for option in ("config", "interface", "channel", "dbc", "device", "record", "speed-up", "duration"):
        assert f"--{option}" in said
    assert "--state FILE" in said
    assert "--socket PATH" in said
    assert "examples:" in said
    assert "exit codes:" in said
