"""The units for systemd fit the daemon; `make test-hil` runs them in earnest."""

from __future__ import annotations

import shutil
import subprocess
from collections import defaultdict
from pathlib import Path

import pytest

from tests.conftest import REPO
from tpmsd.car.config.model import StateConfig, StatusConfig
from tpmsd.foundation.errors import ConfigError
from tpmsd.interfaces.cli.run import DEFAULT_CONFIG

SINGLE = REPO / "systemd" / "tpmsd.service"
TEMPLATE = REPO / "systemd" / "tpmsd@.service"
UNITS = pytest.mark.parametrize("unit", [SINGLE, TEMPLATE], ids=lambda path: path.name)
EXPOSURE = 15
"""Tenths: what `systemd-analyze security` may find at most."""
OWN = {"ExecStart", "StateDirectory", "RuntimeDirectory"}
"""Directives of [Service] in which the template differs."""


def directives(unit: Path) -> dict[str, list[str]]:
    found: dict[str, list[str]] = defaultdict(list)
    for line in unit.read_text(encoding="utf-8").replace("\\\n", "").splitlines():
        if "=" in line and not line.startswith("#"):
            name, _, value = line.partition("=")
            found[name].append(value)
    return found


def analyze(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """systemd-analyze; skips where it is missing."""
    program = shutil.which("systemd-analyze")
    if program is None:
        pytest.skip("no systemd-analyze here (Debian: apt-get install systemd)")
    return subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)


def test_the_unit_fits_the_daemons_defaults() -> None:
    """It waits for READY, feeds on the watchdog, gives the folders that the configuration expects, and does
    not restart what exits with a wrong configuration."""
    unit = directives(SINGLE)
    state, status = StateConfig().file, StatusConfig().socket
    assert state is not None

    assert ["notify"] == unit["Type"]
    assert unit["WatchdogSec"]
    assert state.parent.as_posix() == f"/var/lib/{unit['StateDirectory'][0]}"
    assert status.parent.as_posix() == f"/run/{unit['RuntimeDirectory'][0]}"
    assert [str(ConfigError.exit_code)] == unit["RestartPreventExitStatus"]
    assert unit["ExecStart"][0].endswith(f"/tpmsd run --config {DEFAULT_CONFIG}")
    assert "AF_CAN" in unit["RestrictAddressFamilies"][0].split()


def test_the_template_is_the_unit_with_its_own_folders() -> None:
    """What hardens the one hardens the other; state and socket lie in the instance's folders."""
    single, template = directives(SINGLE), directives(TEMPLATE)
    service = set(single) - {"Description", "After", "WantedBy"} - OWN
    command = template["ExecStart"][0]

    assert {name: single[name] for name in service} == {name: template[name] for name in service}
    assert f"--state %S/{template['StateDirectory'][0]}/" in command
    assert f"--socket %t/{template['RuntimeDirectory'][0]}/" in command
    assert ["sys-subsystem-net-devices-%i.device"] == template["BindsTo"]


@UNITS
def test_systemd_understands_the_unit(unit: Path, tmp_path: Path) -> None:
    """systemd-analyze finds nothing to say about any directive."""
    copy = tmp_path / unit.name.replace("@", "@can0")
    # That the program and its page are not installed here says nothing about the unit.
    text = (
        unit.read_text(encoding="utf-8")
        .replace("/opt/tpmsd/bin/tpmsd", "/bin/true")
        .replace("man:tpmsd(1) ", "")
    )
    copy.write_text(text, encoding="utf-8")
    said = analyze("verify", copy)

    assert [] == [line for line in said.stderr.splitlines() if "tpmsd" in line]
    assert 0 == said.returncode


@UNITS
def test_the_units_exposure_is_low(unit: Path) -> None:
    """`systemd-analyze security` rates it at no more than 1.5 of 10."""
    said = analyze("security", "--offline=yes", f"--threshold={EXPOSURE}", unit)

    assert 0 == said.returncode, said.stdout[-200:]
    assert "Overall exposure level" in said.stdout
