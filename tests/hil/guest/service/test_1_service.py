"""tpmsd.service in systemd: started, asked, killed, stopped dead, and ended in order.

The tests follow one another on one service, as the life of a daemon does.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

from tests.hil.guest.rig import ask, wait_until
from tests.hil.guest.service.conftest import CONFIG, PTY, TOOLS, WATCHDOG_S, Car
from tests.hil.guest.service.manager import (
    UNITS,
    journal,
    messages,
    pid,
    show,
    sibling,
    systemctl,
    wait_for_message,
)

UNIT = "tpmsd.service"
SOCKET = "/run/tpmsd/status.sock"
PYTHON = "/usr/lib/tpmsd/bin/python"
MAY = {"can", "state directory", "runtime directory", "null", "unseen others"}
"""What the probe may do: its work, and nothing else."""


def test_it_is_ready_when_ticks_run(machine: Car) -> None:
    """`systemctl start` returns when there are ticks, not before."""
    systemctl("start", UNIT)
    document = ask(SOCKET)

    assert document["ticks"] > 0
    assert ("active", "running") == (show(UNIT, "ActiveState"), show(UNIT, "SubState"))
    assert any("first tick" in line for line in messages(UNIT))


def test_systemctl_status_tells_how_the_tyres_are() -> None:
    """One line that a person can use."""
    line = re.compile(r"(learning|monitoring) 4 wheels, .*; \d+ km/h; bus ok; receiver ok; ")
    wait_until(lambda: line.match(show(UNIT, "StatusText")), "the status line follows")
    said = systemctl("status", UNIT)

    assert re.search(f'Status: "{line.pattern}', said), said
    assert "Tyre monitor without pressure sensors" in said


def test_two_that_hang_are_started_beside_it(machine: Car) -> None:
    """One never makes a tick, the other makes twenty; what systemd does with them is seen later."""
    changes = {"Restart": "no", "WatchdogSec": str(WATCHDOG_S)}
    never = f"{PYTHON} {TOOLS}/hung.py 0 {hung_config('never')}"
    hung = f"{PYTHON} {TOOLS}/hung.py 20 {hung_config('hung')}"
    # On a busy machine it is looked at later than the unit's own time to start would allow.
    sibling("never", {**changes, "ExecStart": never, "TimeoutStartSec": "600"})
    sibling("hung", {**changes, "ExecStart": hung})
    systemctl("start", "--no-block", "never.service", "hung.service")


def hung_config(name: str) -> Path:
    """A configuration with its own socket and without state."""
    path = CONFIG.with_name(f"{name}.toml")
    text = CONFIG.read_text().split("[state]")[0]
    text += f'\n[status]\nsocket = "/run/{name}/status.sock"\n\n[state]\nfile = ""\n'
    path.write_text(text.replace(str(Path("/run/gnss")), "/dev/none"))
    path.chmod(0o644)
    return path


def test_it_has_no_capability() -> None:
    """A user of its own, no capability in any set, no way to gain one, system calls filtered."""
    status = dict(
        line.split(":\t", 1)
        for line in Path(f"/proc/{pid(UNIT)}/status").read_text().splitlines()
        if ":\t" in line
    )

    assert {"0000000000000000"} == {status[f"Cap{kind}"] for kind in ("Inh", "Prm", "Eff", "Bnd", "Amb")}
    assert ("1", "2") == (status["NoNewPrivs"], status["Seccomp"])
    assert "0" not in status["Uid"].split()


def test_it_can_do_its_work_and_nothing_else(machine: Car) -> None:
    """A program in the same confinement reaches the bus and its own folders; all else is refused."""
    unit = sibling(
        "probe",
        {
            "Type": "oneshot",
            "ExecStart": f"{PYTHON} {TOOLS}/probe.py",
            "Restart": "no",
            "NotifyAccess": "none",
        },
        more="RemainAfterExit=yes",
    )
    systemctl("start", unit)
    said = next(line for line in messages(unit) if line.startswith("{"))
    results = json.loads(said)
    systemctl("stop", unit)

    assert MAY == {name for name, result in results.items() if result == "ok"}


def test_a_killed_daemon_is_restarted_with_what_it_had_learned() -> None:
    """`kill -9` once the tyres are learned: back within seconds, and monitoring without learning again."""
    wait_until(lambda: ask(SOCKET).get("learning_fraction") == 1.0, "it has learned", 180.0)
    saved_s = state_file().stat().st_mtime
    wait_until(lambda: state_file().stat().st_mtime > saved_s, "that is saved")
    killed = pid(UNIT)
    os.kill(killed, signal.SIGKILL)
    wait_until(
        lambda: show(UNIT, "NRestarts") == "1" and show(UNIT, "ActiveState") == "active", "it is restarted"
    )
    after = wait_until(watching, "its wheels are heard")

    assert pid(UNIT) not in (0, killed)
    assert 1.0 == after["learning_fraction"]
    assert {"monitoring"} >= {wheel["state"] for wheel in after["wheels"].values()} - {"unavailable"}
    wait_for_message(UNIT, "taken up what was learned before")


def watching() -> dict[str, Any]:
    """The status once wheels are learned or monitored; empty before."""
    document = ask(SOCKET)
    states = {wheel["state"] for wheel in document.get("wheels", {}).values()}
    return document if states & {"learning", "monitoring"} else {}


def state_file() -> Path:
    return Path("/var/lib/private/tpmsd/state.json")


def test_a_daemon_that_stands_still_is_caught_by_the_watchdog() -> None:
    """SIGSTOP: no tick, no word to systemd; it is ended and started again."""
    stopped = pid(UNIT)
    os.kill(stopped, signal.SIGSTOP)
    wait_until(
        lambda: show(UNIT, "NRestarts") == "2" and show(UNIT, "ActiveState") == "active", "it is restarted"
    )

    assert stopped != pid(UNIT)
    assert any("Watchdog timeout" in line for line in messages(UNIT))


def test_one_that_takes_too_much_memory_is_restarted_with_what_it_had_learned() -> None:
    """With `MemoryMax` below what it needs the kernel kills it; with the unit's own it is back by itself."""
    before = int(show(UNIT, "NRestarts"))
    systemctl("set-property", "--runtime", UNIT, "MemoryMax=8M")
    wait_until(lambda: int(show(UNIT, "NRestarts")) > before, "it is killed and started again")
    systemctl("set-property", "--runtime", UNIT, "MemoryMax=512M")
    after = wait_until(watching, "its wheels are heard")

    assert any("oom-kill" in line for line in messages(UNIT))
    assert 1.0 == after["learning_fraction"]


def test_the_receiver_may_go_and_come(machine: Car) -> None:
    """A status says what is there: bus and receiver are heard again after the restarts."""
    wait_until(
        lambda: (d := ask(SOCKET)) and (d["can"]["state"], d["gnss"]["state"]) == ("ok", "ok"),
        "both are heard",
    )


def test_a_hung_estimator_is_caught_by_the_watchdog() -> None:
    """The loop turned and answered, yet no tick was made: systemd ended it within the watchdog's time."""
    wait_until(lambda: "failed" == show("hung.service", "ActiveState"), "the watchdog bites")

    assert "watchdog" == show("hung.service", "Result")
    assert "0" != show("hung.service", "ActiveEnterTimestampMonotonic")
    assert any("first tick" in line for line in messages("hung.service"))


def test_one_that_never_ticks_is_never_ready() -> None:
    """A loop that turns without ticks is no start: systemd still waits for it."""
    wait_for_message("never.service", "tpmsd watches")
    time.sleep(2.0)

    assert "activating" == show("never.service", "ActiveState")
    assert ask("/run/never/status.sock")["ticks"] == 0
    systemctl("stop", "never.service")
    assert "0" == show("never.service", "ActiveEnterTimestampMonotonic")


def test_the_journal_is_readable() -> None:
    """Every line has a priority and no time stamp of its own; there is never a traceback."""
    own = [entry for entry in journal(UNIT) if entry.get("SYSLOG_IDENTIFIER") == "tpmsd"]

    assert len(own) >= 6
    assert {"6", "4", "3", "2"} >= {entry["PRIORITY"] for entry in own}
    assert [] == [
        entry["MESSAGE"] for entry in own if entry["MESSAGE"][:2].isdigit() or "<" in entry["MESSAGE"][:1]
    ]
    assert [] == [line for line in messages(UNIT) if "Traceback" in line]


def test_nothing_is_written_outside_its_folders() -> None:
    """Every file on this machine that belongs to the service's user lies in its state or runtime folder."""
    user = str(Path(f"/proc/{pid(UNIT)}").stat().st_uid)
    # All that was ever written to this machine's root is in the upper layer of its overlay.
    places = ["/mnt/machine/mnt/upper", "/run", "/dev/shm"]
    places += [f"/var/{folder}/private" for folder in ("lib", "cache", "log")]
    found = subprocess.run(
        ["find", *places, "-xdev", "-user", user], capture_output=True, text=True
    ).stdout.split()
    own = {path for path in found if not path.startswith(("/var/lib/private/tpmsd", "/run/tpmsd"))}

    assert "/run/tpmsd/status.sock" in found
    assert str(state_file()) in found
    assert set() == own


def test_it_stops_in_order() -> None:
    """`systemctl stop`: state saved, socket gone, success."""
    before_s = state_file().stat().st_mtime
    systemctl("stop", UNIT)

    assert ("inactive", "success", "0") == (
        show(UNIT, "ActiveState"),
        show(UNIT, "Result"),
        show(UNIT, "ExecMainStatus"),
    )
    assert state_file().stat().st_mtime >= before_s
    assert not Path(SOCKET).exists()
    wait_for_message(UNIT, "stopping: SIGTERM")


def test_a_wrong_configuration_is_not_tried_again(machine: Car) -> None:
    """Exit code 2, the reason in the journal, no restart."""
    unit = "wrong"
    config = CONFIG.with_name(f"{unit}.toml")
    config.write_text(CONFIG.read_text() + "\n[nonsense]\nx = 1\n")
    config.chmod(0o644)
    service = sibling(unit, {"ExecStart": f"/usr/lib/tpmsd/bin/tpmsd run --config {config}"})
    (UNITS / f"{service}.d").mkdir(exist_ok=True)
    (UNITS / f"{service}.d" / "pty.conf").write_text(f"[Service]\n{PTY}\n")
    systemctl("daemon-reload")
    systemctl("start", service, check=False)

    assert ("failed", "2", "0") == (
        show(service, "ActiveState"),
        show(service, "ExecMainStatus"),
        show(service, "NRestarts"),
    )
    assert any("[nonsense]" in line for line in messages(service))
