"""A calibration is a baseline: tyres are held against it from the first drive on, until a reset."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from tests.onboard.monitor.drives import ALL, RADIUS_M, REAR, VEHICLE, Player, monitor, one, said
from tpmsd.car.config.model import CalibrationConfig, MonitorConfig
from tpmsd.onboard.monitor.baseline.reference import CAR, RadiusReference
from tpmsd.onboard.monitor.monitor import Monitor
from tpmsd.onboard.monitor.sampling.conditions import Conditions
from tpmsd.onboard.monitor.settings import REFERENCE

STD_M = 5e-5
CALIBRATION = CalibrationConfig(
    reference_speed_mps=20.0,
    radius_std_fl_m=STD_M,
    radius_std_fr_m=STD_M,
    radius_std_rl_m=STD_M,
    radius_std_rr_m=STD_M,
)
SOUND = (0.0, 0.0, 0.0, 0.0)


def calibrated(calibration: CalibrationConfig = CALIBRATION, wheels: tuple[int, ...] = ALL) -> Player:
    made = Monitor(VEHICLE, MonitorConfig(), wheels, calibration=calibration)
    return Player(made, dt_s=2.0, offset_m=SOUND)


def test_what_a_calibration_tells_of_the_radii() -> None:
    """Left against right of an axle at the calibration's own speed, on no drive in particular: twice the
    variance of a radius and of what one wheel did on those drives. All wheels alike: wider, by warmth."""
    reference = RadiusReference(VEHICLE)
    reference.learn_calibration(np.full(4, STD_M), 20.0, [0, 1, 2, 3])
    h = reference.features(Conditions(400.0, 0.0, (0.5, 0.5), 0.0, 0.0))
    h[:, CAR:] = 0.0
    spread = h @ reference.covariance @ h.T
    apart = np.array([0.0, 0.0, 1.0, -1.0])
    own = (STD_M / RADIUS_M) ** 2 + REFERENCE.drift_own_std**2
    assert 2.0 * own == pytest.approx(float(apart @ spread @ apart), rel=0.02)
    assert math.sqrt(spread.mean()) > 2.0 * math.sqrt(own)
    assert np.abs(h @ reference.mean).max() < 1e-4


@pytest.mark.parametrize("wheels", [ALL, REAR])
def test_a_tyre_that_is_soft_when_the_next_drive_begins_is_found(wheels: tuple[int, ...]) -> None:
    """25 % soft, 0.58 % of the radius, from the first second: a deflation against what was calibrated. The
    same car without a calibration may have a mixed set, and nothing is said."""
    player = calibrated(wheels=wheels)
    events = player.play(120.0, one(2, -0.0058))
    assert [("deflation", "rl", "raised")] == said(events)
    assert "" == events[0].since
    assert "of radius since calibrated, " in events[0].reason
    guessed = Player(monitor(wheels), dt_s=2.0, offset_m=SOUND)
    assert [] == guessed.play(120.0, one(2, -0.0058))


def test_all_tyres_that_are_soft_when_the_next_drive_begins_are_found() -> None:
    """The receiver shows 25 % lost by all four, far beyond warmth, weather and growth."""
    events = calibrated().play(900.0, (-0.0058,) * 4)
    assert {("deflation", wheel, "raised") for wheel in ("fl", "fr", "rl", "rr")} == set(said(events))


@pytest.mark.parametrize(
    "change",
    [
        pytest.param((0.0003, 0.0003, -0.0015, -0.0015), id="a full boot"),
        pytest.param((-0.0012,) * 4, id="cold tyres"),
        pytest.param((0.0010,) * 4, id="hot tyres"),
        pytest.param((0.0004, -0.0004, 0.0003, -0.0003), id="wind"),
    ],
)
def test_what_drives_do_is_no_alarm(change: tuple[float, ...]) -> None:
    """A quarter of an hour and more of what load and weather do to tyres of a calibrated car: nothing."""
    assert [] == calibrated().play(1000.0, change)


def test_after_a_reset_the_calibration_is_history() -> None:
    """Other tyres, which are smaller on both axles: accepted, and what they are is normal from then on."""
    player = calibrated()
    assert [] == player.play(60.0)
    assert player.monitor.reset("winter")[0]
    assert player.monitor.sets.undecided
    smaller = (-0.006,) * 4
    assert [] == player.play(600.0, smaller)
    assert "accepted" == player.monitor.learning().reset
    assert not player.monitor.baseline.calibrated
    assert [] == player.play(600.0, smaller)
    worse = player.play(120.0, (-0.006, -0.006, -0.014, -0.006))
    assert ("deflation", "rl", "raised") in said(worse)
    assert all("since learned" in event.reason for event in worse)


def test_it_holds_after_a_restart_and_not_after_a_state_that_was_reset() -> None:
    """A saved monitor takes up what it had, calibrated or not."""
    player = calibrated()
    player.play(120.0)
    for name, remains in (("", True), ("winter", False)):
        if name:
            player.monitor.reset(name)
            player.play(900.0)
        saved = json.loads(json.dumps(player.monitor.snapshot(), allow_nan=False))
        again = calibrated()
        again.monitor.restore(saved)
        assert remains is again.monitor.baseline.calibrated


@pytest.mark.parametrize(
    "calibration",
    [
        CalibrationConfig(),
        replace(CALIBRATION, radius_std_fl_m=None),
        replace(CALIBRATION, reference_speed_mps=None),
        replace(CALIBRATION, radius_std_rl_m=0.002),
    ],
)
def test_a_calibration_that_says_too_little_is_none(calibration: CalibrationConfig) -> None:
    """A wheel without a standard deviation, no speed, or radii known worse than learning asks: learned as a
    car that nobody knows."""
    assert not calibrated(calibration).monitor.baseline.ready
