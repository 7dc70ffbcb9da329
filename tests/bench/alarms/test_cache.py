"""Estimates that are remembered are those that were made."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.campaigns.onboard.alarms.cache import code_of, key_of
from bench.campaigns.onboard.alarms.play import LegResult, replay_leg
from bench.worlds.trip_cars import draw_car
from bench.worlds.trips import Driven, Leg, Loss, drive_leg


@pytest.fixture(scope="module")
def leaking() -> Driven:
    """A tyre that goes flat."""
    car = draw_car(np.random.default_rng(6), "development", 6)
    return drive_leg(car, Leg(seed=2, road="track", duration_s=180.0, losses=(Loss(3, 0.35, 120.0),)))


@pytest.fixture(scope="module")
def fresh(leaking: Driven) -> LegResult:
    """What is said of it without a memory."""
    return replay_leg(leaking)


def at_alarm(outcome: LegResult) -> float | None:
    return outcome.said[0].time_s


def test_a_leg_is_received_equally_with_and_without_memory(
    leaking: Driven, fresh: LegResult, tmp_path: Path
) -> None:
    """Cut short by its alarm, from what was kept of that, to its end, and again: to the last bit."""
    cut = replay_leg(leaking, stop=at_alarm, memory=tmp_path)
    again = replay_leg(leaking, stop=at_alarm, memory=tmp_path)
    longer = replay_leg(leaking, memory=tmp_path)
    remembered = replay_leg(leaking, memory=tmp_path)

    assert fresh.said
    assert cut == again
    assert cut.played_s < fresh.played_s
    assert fresh == longer == remembered


def test_what_is_remembered_is_not_estimated_again(leaking: Driven, tmp_path: Path) -> None:
    """Kept estimates are given back as they are: altered ones show."""
    replay_leg(leaking, memory=tmp_path)
    (file,) = tmp_path.glob("*.npz")
    with np.load(file) as kept:
        rows, snapshots = kept["rows"], kept["snapshots"]
    rows[:, 1:5] = 0.0
    np.savez(file, rows=rows, snapshots=snapshots)

    assert not replay_leg(leaking, memory=tmp_path).raised("deflation")


def test_another_state_before_is_another_memory(leaking: Driven, fresh: LegResult, tmp_path: Path) -> None:
    """What was learned before is part of the key."""
    before = fresh.state
    replay_leg(leaking, memory=tmp_path)
    assert before
    outcome = replay_leg(leaking, before, memory=tmp_path)

    assert 2 == len(list(tmp_path.glob("*.npz")))
    assert replay_leg(leaking, before) == outcome
    shutil.rmtree(tmp_path)


def test_the_key_is_of_readings_and_of_code(leaking: Driven) -> None:
    """One reading more or less is another key; the code is the estimator's with all that it imports."""
    from tpmsd.car.config.model import CanConfig, Config, FilterConfig, VehicleConfig
    from tpmsd.onboard.estimators.build import build_estimator

    vehicle = VehicleConfig((0.3, 0.3, 0.3, 0.3), 1.5, 1.5, 2.6)
    roles = {f"wheel_count_{wheel}": f"W.{wheel}" for wheel in ("fl", "fr", "rl", "rr")}
    config = Config(vehicle, CanConfig(roles, Path("bus.dbc")))
    estimator = build_estimator(config, np.random.default_rng(1))
    drive = leaking.drive
    other = replace(drive, gyro=drive.gyro + np.eye(1, len(drive.gyro))[0])
    slower = replace(config, filter=FilterConfig(rate_hz=5.0))
    names = [path.stem for path in code_of(["tpmsd.onboard.estimators.bank.mixture"])]

    keys = [
        key_of(drive, config, estimator, False),
        key_of(drive, config, estimator, True),
        key_of(other, config, estimator, False),
        key_of(drive, slower, estimator, False),
    ]
    assert keys[0] == key_of(drive, config, estimator, False)
    assert 4 == len(set(keys))
    assert {"mixture", "error_state", "grade", "kinematics"} <= set(names)
    assert "monitor" not in names
