"""A car that drives on vcan0, and the machine set up for tpmsd.service as an owner would."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.hil.guest.rig import simulating, wait_until
from tests.hil.guest.service.manager import drop_in, systemctl

HERE = Path(__file__).resolve().parent
CONFIG = Path("/etc/tpmsd/tpmsd.toml")
TOOLS = Path("/usr/local/lib/hil")
WATCHDOG_S = 5
PTY = "DeviceAllow=char-pts rw"
"""The one thing that the unit has to be told: that a receiver may be a pseudo terminal here."""


@dataclass(frozen=True)
class Car:
    """What drives."""

    folder: Path
    pty: Path


@pytest.fixture(scope="session")
def car(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Car]:
    """A car at its own pace; its receiver belongs to the group that serial lines belong to."""
    folder, pty = tmp_path_factory.mktemp("car") / "drive", Path("/run/gnss")
    drive = ("--duration", "900", "--route", "test-track", "--seed", "4")
    with simulating(folder, *drive, "--live", "vcan0", "--pty", pty):
        wait_until(pty.exists, "the car drives")
        shutil.chown(os.path.realpath(pty), "root", "dialout")
        Path(os.path.realpath(pty)).chmod(0o660)
        yield Car(folder, pty)


@pytest.fixture(scope="session")
def machine(car: Car) -> Iterator[Car]:
    """Configuration and drop-in in place; the service not started yet."""
    CONFIG.parent.mkdir(exist_ok=True)
    more = "\n[monitor]\nlearn_s = 10.0\n\n[state]\ninterval_s = 2.0\n"
    CONFIG.write_text((car.folder / "vehicle.toml").read_text() + more)
    shutil.copy(car.folder / "bus.dbc", CONFIG.parent)
    for file in CONFIG.parent.iterdir():
        file.chmod(0o644)
    TOOLS.mkdir(parents=True)
    for name in ("hung.py", "probe.py"):
        shutil.copy(HERE / name, TOOLS)
    drop_in("tpmsd.service", f"[Service]\nWatchdogSec={WATCHDOG_S}\n{PTY}\n")
    yield car
    systemctl("stop", "tpmsd.service", check=False)
