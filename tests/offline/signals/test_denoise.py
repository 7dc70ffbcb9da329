"""Speed as an input: its noise goes, its motion stays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.offline.dynamics.drives import folder
from tpmsd.car.config.dynamics import load_car
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.signals.denoise import smooth_series
from tpmsd.offline.signals.drive import make_drive
from tpmsd.offline.signals.read import read_signals


def _braking(hz: float) -> tuple[FloatArray, FloatArray]:
    """Return times and a speed that brakes and speeds up by 3 m/s2 in turn, each begun within 0.3 s."""
    time = np.arange(0.0, 120.0, 1.0 / hz)
    rate = 3.0 * np.tanh(np.sin(time / 2.0) / 0.075)
    return time, 20.0 + np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1])) / hz])


@pytest.mark.parametrize(("hz", "noise", "left"), [(20.0, 0.1, 0.6), (50.0, 0.05, 0.5), (100.0, 0.05, 0.4)])
def test_noise_of_a_speed_goes_and_its_motion_is_not_delayed(hz: float, noise: float, left: float) -> None:
    time, speed = _braking(hz)
    readings = speed + np.random.default_rng(1).normal(0.0, noise, len(time))
    error = smooth_series(time, readings, 5.0) - speed
    rate = np.gradient(speed, time)
    assert np.std(error) < left * noise
    assert abs(float(np.sum(error * rate) / np.sum(rate**2))) < 0.002  # seconds of delay


def test_a_speed_without_noise_stays_as_it_is() -> None:
    time, speed = _braking(50.0)
    assert np.array_equal(smooth_series(time, speed, 5.0), speed)


def test_what_is_missing_lies_between_its_neighbours() -> None:
    time, speed = _braking(50.0)
    readings = np.where(np.arange(len(time)) % 5 == 2, speed, np.nan)
    readings[3000:4000] = np.nan
    noisy = readings + np.random.default_rng(2).normal(0.0, 0.05, len(time))
    out = smooth_series(time, noisy, 5.0)
    known = np.flatnonzero(np.isfinite(noisy))
    assert np.all(out[: known[0]] == out[known[0]])
    ends = out[[known[known < 3000][-1], known[known >= 4000][0]]]
    assert np.all((out[3000:4000] >= ends.min()) & (out[3000:4000] <= ends.max()))
    assert np.isfinite(out).all()


def test_the_speed_of_a_drive_loses_its_noise(tmp_path: Path) -> None:
    where = folder(tmp_path / "drive", duration_s=20.0)
    table, car = read_signals(where), load_car(where)
    clean = make_drive(table, car, "single-track", "clean")[1].inputs.speed_mps
    noise = np.random.default_rng(3).normal(0.0, 0.3, len(clean))
    noisy = replace(table, columns={**table.columns, "speed_mps": table.columns["speed_mps"] + noise})
    speed = make_drive(noisy, car, "single-track", "noisy")[1].inputs.speed_mps
    assert np.std(speed - clean) < 0.35 * 0.3
