"""Wheel speeds in coarse steps: the bias that is stated, and where it is said."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.car.config.conftest import Make
from tpmsd.car.config.check import check
from tpmsd.car.config.coarse_speed import coarse_step_warning, truncation_bias
from tpmsd.interfaces.cli.main import main

KMH = 1.0 / 3.6


def test_the_stated_bias_is_that_of_truncated_speeds() -> None:
    """Way by the receiver over turns by speeds that are cut down to steps of 1 km/h, around 20 m/s."""
    speeds = np.random.default_rng(3).uniform(15.0, 25.0, 200_000)
    truncated = np.floor(speeds / KMH) * KMH

    assert truncation_bias(KMH) == pytest.approx(speeds.sum() / truncated.sum() - 1.0, rel=0.01)


def test_steps_of_a_kilometre_per_hour_are_reported_with_the_bias() -> None:
    """2.2 mm of 316 at 20 m/s; a sixteenth of that step is fine."""
    text = coarse_step_warning(KMH, 0.316)

    assert text is not None
    assert "steps of 1 km/h" in text
    assert "2.2 mm larger at 20 m/s" in text
    assert coarse_step_warning(KMH / 16.0, 0.316) is None


def test_check_warns_of_them_once(make: Make) -> None:
    """A factor of 1 km/h in the DBC: one warning, at the line of the role."""
    wheels = ("fl", "fr", "rl", "rr")
    edits = [(f'count_{w} = "WHEELS.CNT_{w.upper()}"', f'speed_{w} = "SPEEDS.V_{w.upper()}"') for w in wheels]
    file = make(*edits)
    dbc = file.parent / "bus.dbc"
    text = dbc.read_text(encoding="utf-8")
    dbc.write_text(re.sub(r"(SG_ V_\w+ : \S+ \()[^,]*,", r"\g<1>1,", text), encoding="utf-8")
    warned = [warning for warning in check(file).warnings if "steps of" in warning.text]

    assert 1 == len(warned)
    assert "can.signals" in warned[0].text


def test_a_replay_warns_of_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The commands that read a drive say it, too."""
    drive = tmp_path / "drive"
    assert 0 == main(["simulate", str(drive), "--bus", "speeds", "--duration", "30"])
    dbc = drive / "bus.dbc"
    dbc.write_text(dbc.read_text().replace('(0.01,-67.67) [-67.67|587.68] "km/h"', '(1,0) [0|587.68] "km/h"'))
    capsys.readouterr()
    main(["replay", str(drive)])

    assert "speeds in steps of 1 km/h" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("device", "reason"),
    [
        ("gpsd://localhost", "an address, not a serial line"),
        ("gpsd://localhost:x", "not a port"),
        ("http://localhost", "not a source of fixes"),
    ],
)
def test_an_address_is_no_device(make: Make, device: str, reason: str) -> None:
    """`device` is a serial line; an address belongs to `source`, and the line says so."""
    file = make(('device = "/dev/ttyACM0"', f'device = "{device}"'))
    (problem,) = check(file).problems

    assert reason in problem.text
    assert ('source = "gpsd://localhost"' in problem.text) == (device == "gpsd://localhost")


def test_check_says_what_it_looked_at(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a drive it says that none was read; with one it names the drive."""
    drive = tmp_path / "drive"
    assert 0 == main(["simulate", str(drive), "--duration", "30"])
    capsys.readouterr()
    assert 0 == main(["check", str(drive)])
    alone = capsys.readouterr().out
    assert 0 == main(["check", str(drive), "--drive", str(drive)])
    held = capsys.readouterr().out

    assert "No drive was read" in alone
    assert f"Nothing in the drive {drive} contradicts it." in held
    assert "No drive was read" not in held
