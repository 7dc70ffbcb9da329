"""The demonstration: the right wheel on the bus, and an exit code that can say no."""

from __future__ import annotations

import io
import math
import re
import subprocess
import sys
from pathlib import Path

import can
import cantools.database
import pytest
from cantools.database.can import Database

from tests.conftest import REPO
from tpmsd.car.config.model import AlarmsConfig
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.cli.demo_panel import Panel
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind, MonitorReport, WheelReport, WheelState
from tpmsd.onboard.sinks.can_frames import CanReporter


@pytest.mark.parametrize("method", ["gaussian-sum", "mpf-pn"])
def test_the_demonstration_finds_the_wheel(tmp_path: Path, method: str) -> None:
    """Another wheel than the usual one is announced on the bus, its frame decoded; the exit code is 0."""
    options = ["--wheel", "fr", "--speed-up", "36", "--seed", "5", "--method", method]
    done = subprocess.run(
        [sys.executable, "-m", "tpmsd.interfaces.cli.demo", *options],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=tmp_path,
    )
    lines = done.stdout.splitlines()
    alarm = next(index for index, line in enumerate(lines) if "ALARM       front right deflation" in line)

    assert 0 == done.returncode
    assert "" == done.stderr
    assert "\x1b" not in done.stdout
    assert re.search(r"front right deflation -\d\.\d mm \(\d+(\.\d)? %\), \d+ s after", lines[alarm])
    assert re.match(r" +frame +6F1#[0-9A-F]{16}$", lines[alarm + 1])
    assert "Deflation_FR=alarm" in lines[alarm + 2] + lines[alarm + 3]
    assert any("  learning " in line for line in lines[:alarm])
    # MPF-PN knows the radii later, and may find the loss before all four wheels are learned.
    assert any("  monitoring " in line for line in (lines[:alarm] if method == "gaussian-sum" else lines))
    assert lines[-2].startswith("Found on the bus: front right, ")
    assert lines[-2].endswith("No other wheel was announced.")
    assert lines[-1].startswith("Next, ")
    assert "at most 8 s" in lines[0]


@pytest.fixture(scope="module")
def database() -> Database:
    """What everybody may know of tpmsd's frames."""
    loaded = cantools.database.load_file(str(REPO / "dbc" / "tpmsd.dbc"))
    assert isinstance(loaded, Database)
    return loaded


def report(alarm: AlarmEvent | None, fresh: bool = True) -> MonitorReport:
    wheels = tuple(
        WheelReport(wheel, WheelState.MONITORING, 1e-3, 1e-4, -2e-3, 1e-4, 0.0, 0.0) for wheel in WHEELS
    )
    alarms = () if alarm is None else (alarm,)
    return MonitorReport(0.0, wheels, alarms, alarms if fresh else (), 1.0)


def received(panel: Panel, reporter: CanReporter, now_s: float, alarm: AlarmEvent | None) -> None:
    for frame in reporter.frames(now_s, report(alarm, now_s == 0.0)):
        panel.decode(can.Message(arbitration_id=frame.arbitration_id, data=frame.data, is_extended_id=False))


def test_the_panel_shows_an_alarm_once(database: Database) -> None:
    """An alarm frame is repeated while the alarm is active; a driver is told once."""
    out = io.StringIO()
    panel = Panel(database, out, False, lambda: 163.0, 150.0)
    reporter = CanReporter(AlarmsConfig())
    alarm = AlarmEvent(0.0, AlarmKind.DEFLATION, "rl", "raised", -2e-3, 1e-4, 0.995, "lost 2 mm")
    for tick in range(50):
        received(panel, reporter, 0.1 * tick, alarm)
    panel.show()

    assert [("deflation", "rl")] == [(a.kind, a.wheel) for a in panel.alarms]
    assert 1 == out.getvalue().count("ALARM       rear left deflation -2.0 mm (0 %), 13 s after")
    assert (
        "  2:43  monitoring  fl  -2.00  fr  -2.00  rl  -2.00  rr  -2.00  mm since learned" in out.getvalue()
    )


class Terminal(io.StringIO):
    """A stream that is a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("columns", [60, 72, 120])
@pytest.mark.parametrize("term", ["xterm", "dumb"])
def test_the_panel_keeps_within_the_terminal(
    database: Database, monkeypatch: pytest.MonkeyPatch, columns: int, term: str
) -> None:
    """From 60 columns on no line is as wide as the terminal; a dumb one gets no control sequences."""
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setenv("TERM", term)
    out = Terminal()
    panel = Panel(database, out, False, lambda: 163.0, 150.0)
    alarm = AlarmEvent(0.0, AlarmKind.DEFLATION, "rl", "raised", -2e-3, 1e-4, 0.995, "lost 2 mm")
    received(panel, CanReporter(AlarmsConfig()), 0.0, alarm)
    panel.show()
    text = out.getvalue()
    lines = re.sub(r"\x1b\[[0-9;]*[A-Za-z]", "", text).replace("\r", "\n").splitlines()

    assert max(map(len, lines)) < columns
    assert ("\x1b" in text) == (term == "xterm")
    assert "2:43  monitoring  fl  -2.00" in text
    assert "Deflation_RL=alarm" in text


def test_the_panel_trusts_no_damaged_frame(database: Database) -> None:
    """A frame whose checksum is wrong is counted and shows nothing."""
    panel = Panel(database, io.StringIO(), False, lambda: math.nan, 150.0)
    frame = CanReporter(AlarmsConfig()).frames(0.0, report(None))[0]
    damaged = frame.data[:5] + bytes((frame.data[5] ^ 1,)) + frame.data[6:]
    panel.decode(can.Message(arbitration_id=frame.arbitration_id, data=damaged, is_extended_id=False))

    assert 1 == panel.damaged
    assert [] == panel.alarms
