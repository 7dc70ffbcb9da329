"""A real dbus-daemon between the bridge, run as a process of its own, and a listener."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from jeepney import DBusAddress, HeaderFields, MatchRule, message_bus, new_method_call
from jeepney.io.blocking import DBusConnection, open_dbus_connection
from jeepney.wrappers import unwrap_msg

from tests.connect.servers import program, wait_for
from tests.interfaces.bridges.documents import alarm, document, served
from tpmsd.interfaces.bridges.dbus import NAME, PATH

CONFIGURATION = """<busconfig><type>session</type><listen>unix:path={path}</listen><auth>EXTERNAL</auth>
<policy context="default"><allow send_destination="*"/><allow receive_sender="*"/><allow own="*"/>
<allow eavesdrop="false"/></policy></busconfig>"""


@contextlib.contextmanager
def bus(folder: Path) -> Iterator[None]:
    """A message bus at `folder`/bus."""
    path = folder / "bus"
    path.unlink(missing_ok=True)
    (folder / "bus.conf").write_text(CONFIGURATION.format(path=path), "utf-8")
    command = [program("dbus-daemon"), f"--config-file={folder / 'bus.conf'}", "--nofork", "--nopidfile"]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
        wait_for("the bus", path.exists)
        try:
            yield
        finally:
            process.kill()


@contextlib.contextmanager
def listener(folder: Path) -> Iterator[DBusConnection]:
    """A connection that hears the bridge's signals."""
    connection = open_dbus_connection(f"unix:path={folder / 'bus'}")
    rule = MatchRule(type="signal", interface=NAME, path=PATH)
    unwrap_msg(connection.send_and_get_reply(message_bus.AddMatch(rule), timeout=5.0))
    try:
        yield connection
    finally:
        connection.close()


@contextlib.contextmanager
def bridge(folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """The bridge as its users run it; it ends well."""
    command = [sys.executable, "-m", "tpmsd", "bridge", "dbus", "--socket", str(folder / "s")]
    with (
        (folder / "log").open("ab") as log,
        subprocess.Popen([*command, "--bus", f"unix:path={folder / 'bus'}"], stderr=log) as process,
    ):
        try:
            yield process
        finally:
            process.terminate()
            assert 0 == process.wait(10.0), (folder / "log").read_text("utf-8")


def received(connection: DBusConnection, member: str, patience_s: float = 15.0) -> tuple[Any, ...]:
    """What the next signal of that name says."""
    end_s = time.monotonic() + patience_s
    while True:
        message = connection.receive(timeout=max(end_s - time.monotonic(), 0.01))
        if message.header.fields.get(HeaderFields.member) == member:
            return tuple(message.body)


def test_alarms_are_signals(tmp_path: Path) -> None:
    """An alarm is raised and cleared by a signal each, health changes by one, and the state can be asked."""
    with served(tmp_path / "s") as daemon, bus(tmp_path), listener(tmp_path) as ear, bridge(tmp_path):
        assert ("ok",) == received(ear, "HealthChanged")
        daemon.document = document(alarm())
        assert ("deflation", "rl", 1000.0, -2.0, "soft") == received(ear, "AlarmRaised")
        state = new_method_call(DBusAddress(PATH, NAME, NAME), "GetState")
        (answer,) = unwrap_msg(ear.send_and_get_reply(state, timeout=10.0))
        assert "deflation" == json.loads(answer)["alarms"][0]["kind"]
        daemon.document = document()
        assert ("deflation", "rl", 1000.0) == received(ear, "AlarmCleared")


def test_the_state_is_answered_without_a_daemon(tmp_path: Path) -> None:
    """Every GetState is answered while no daemon runs."""
    with bus(tmp_path), listener(tmp_path) as ear, bridge(tmp_path):
        assert ("no daemon",) == received(ear, "HealthChanged")
        for _ in range(3):
            state = new_method_call(DBusAddress(PATH, NAME, NAME), "GetState")
            (answer,) = unwrap_msg(ear.send_and_get_reply(state, timeout=5.0))
            assert {} == json.loads(answer)


def test_a_bus_that_is_restarted_loses_no_alarm(tmp_path: Path) -> None:
    """An alarm that comes while the bus is away is told once it is back."""
    with served(tmp_path / "s") as daemon, contextlib.ExitStack() as first:
        first.enter_context(bus(tmp_path))
        with bridge(tmp_path) as process:
            wait_for("the name", lambda: "on the bus" in (tmp_path / "log").read_text("utf-8"))
            first.close()
            daemon.document = document(alarm(wheel="fr"))
            wait_for("the loss", lambda: "trying again" in (tmp_path / "log").read_text("utf-8"))
            # Held, so that it meets the new bus after the listener does.
            process.send_signal(signal.SIGSTOP)
            with bus(tmp_path), listener(tmp_path) as ear:
                process.send_signal(signal.SIGCONT)
                assert ("deflation", "fr", 1000.0, -2.0, "soft") == received(ear, "AlarmRaised")
