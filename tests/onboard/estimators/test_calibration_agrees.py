"""On line and off line on the same real drives: radii of the default filter against those of `calibrate`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tpmsd
from tpmsd.foundation.wheels import RL, RR
from tpmsd.offline.calibration.calibrate import calibrate
from tpmsd.offline.drives.reading import DESK_RATE_HZ, read_ticks
from tpmsd.offline.inference.recording import record
from tpmsd.onboard.estimators.build import build_estimator

STEADY_MPS, STEADY_S = 20.0, 300.0


@pytest.mark.parametrize("name", ["van-motorway-a", "van-motorway-b"])
def test_the_vans_rear_radii_are_those_of_calibrate(name: str, recordings: Path) -> None:
    """Over the steady part of a motorway drive (above 20 m/s, after 5 min) the mean rear radii are within
    0.3 mm of those of `calibrate`, whose reference is the drive's mean square speed; at every tick of it the
    stated standard deviation is at most 0.3 mm and the radius within three of both together."""
    drive = tpmsd.load(recordings / name)
    ticks = read_ticks(drive.recording, drive.config, DESK_RATE_HZ)
    off_line, _ = calibrate([record(ticks, drive.config, name)], drive.config.vehicle)
    filter_ = build_estimator(drive.config, np.random.default_rng(1))
    assert DESK_RATE_HZ == drive.config.filter.rate_hz
    begun = ticks[0].time_s
    steady = [
        said
        for said in (filter_.step(tick) for tick in ticks)
        if said.time_s - begun > STEADY_S and said.speed_mps > STEADY_MPS
    ]
    assert len(steady) > 1500
    for wheel, label in ((RL, "rl"), (RR, "rr")):
        expected = off_line.wheels[label].radius_m - drive.config.vehicle.wheel_radius_m[wheel]
        found = np.array([said.deviation_m[wheel] for said in steady])
        std = np.sqrt([said.covariance_m2[wheel, wheel] for said in steady])
        assert expected == pytest.approx(found.mean(), abs=0.3e-3)
        assert std.max() < 0.3e-3
        assert np.all(np.abs(found - expected) < 3.0 * np.hypot(std, off_line.wheels[label].radius_std_m))
