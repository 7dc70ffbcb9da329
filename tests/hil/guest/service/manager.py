"""systemd as the tests see it: units, their properties, their journal."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

from tests.hil.guest.rig import wait_until

UNITS = Path("/etc/systemd/system")
SHIPPED = Path("/usr/lib/systemd/system")


def systemctl(*arguments: str, check: bool = True) -> str:
    """What systemctl prints; AssertionError with its complaint if it fails."""
    done = subprocess.run(
        ["systemctl", "--no-pager", *arguments], capture_output=True, text=True, timeout=120
    )
    if check and done.returncode:
        reported = subprocess.run(
            ["journalctl", "-n", "30", "--no-pager", "-o", "cat"], capture_output=True, text=True
        )
        raise AssertionError(f"systemctl {arguments}: {done.stderr}{done.stdout}\n{reported.stdout}")
    return done.stdout


def show(unit: str, name: str) -> str:
    """One property of a unit."""
    return systemctl("show", "--value", "-p", name, unit).strip()


def pid(unit: str) -> int:
    return int(show(unit, "MainPID"))


def drop_in(unit: str, text: str, name: str = "hil") -> None:
    """Settings of this test machine beside those of the unit."""
    folder = UNITS / f"{unit}.d"
    folder.mkdir(exist_ok=True)
    (folder / f"{name}.conf").write_text(text)
    systemctl("daemon-reload")


def journal(unit: str) -> list[dict[str, Any]]:
    """The entries of a unit, those of systemd about it included."""
    said = subprocess.run(
        ["journalctl", "-u", unit, "-o", "json", "--no-pager"], capture_output=True, text=True
    )
    return [json.loads(line) for line in said.stdout.splitlines()]


def messages(unit: str) -> list[str]:
    return [str(entry.get("MESSAGE", "")) for entry in journal(unit)]


def wait_for_message(unit: str, text: str, least: int = 1, timeout_s: float = 60.0) -> None:
    """Until a message with that text was written so many times."""
    wait_until(
        lambda: sum(text in line for line in messages(unit)) >= least, f"{unit} says {text!r}", timeout_s
    )


def sibling(name: str, changes: dict[str, str], more: str = "") -> str:
    """The shipped tpmsd.service under another name, with its own folders and other directives."""
    lines = []
    changes = {"StateDirectory": name, "RuntimeDirectory": name, **changes}
    for line in (SHIPPED / "tpmsd.service").read_text().splitlines():
        key = line.split("=")[0]
        lines.append(f"{key}={changes.pop(key)}" if key in changes else line)
        if line == "[Service]" and more:
            lines.append(more)
    assert not changes, f"not in the unit: {changes}"
    (UNITS / f"{name}.service").write_text("\n".join(lines) + "\n")
    systemctl("daemon-reload")
    return f"{name}.service"
