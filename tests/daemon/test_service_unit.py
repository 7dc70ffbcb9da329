"""The unit for systemd fits the daemon."""

from __future__ import annotations

import shutil
import subprocess
from collections import defaultdict

import pytest

from tests.conftest import REPO
from tpmsd.cli.run import DEFAULT_CONFIG
from tpmsd.config.model import StateConfig, StatusConfig
from tpmsd.errors import ConfigError

UNIT = REPO / "systemd" / "tpmsd.service"


def directives() -> dict[str, list[str]]:
    found: dict[str, list[str]] = defaultdict(list)
    for line in UNIT.read_text(encoding="utf-8").splitlines():
        if "=" in line and not line.startswith("#"):
            name, _, value = line.partition("=")
            found[name].append(value)
    return found


def test_the_unit_fits_the_daemons_defaults() -> None:
    """It waits for READY, feeds on the watchdog, gives the folders that the configuration expects, and does
    not restart what exits with a wrong configuration."""
    unit = directives()
    state, status = StateConfig().file, StatusConfig().socket
    assert state is not None

    assert ["notify"] == unit["Type"]
    assert unit["WatchdogSec"]
    assert state.parent.as_posix() == f"/var/lib/{unit['StateDirectory'][0]}"
    assert status.parent.as_posix() == f"/run/{unit['RuntimeDirectory'][0]}"
    assert [str(ConfigError.exit_code)] == unit["RestartPreventExitStatus"]
    assert unit["ExecStart"][0].endswith(f"/tpmsd run --config {DEFAULT_CONFIG}")
    assert "AF_CAN" in unit["RestrictAddressFamilies"][0].split()


def test_systemd_understands_the_unit() -> None:
    """systemd-analyze finds nothing to say about any directive."""
    analyze = shutil.which("systemd-analyze")
    if analyze is None:
        pytest.skip("no systemd-analyze here (Debian: apt-get install systemd)")
    said = subprocess.run([analyze, "verify", str(UNIT)], capture_output=True, text=True).stderr
    # That the program itself is not installed here says nothing about the unit.
    assert [] == [line for line in said.splitlines() if UNIT.name in line and "is not executable" not in line]
