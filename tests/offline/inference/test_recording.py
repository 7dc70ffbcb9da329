"""Ticks laid out as arrays."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tpmsd.car.config.model import CanConfig, Config, GnssConfig, VehicleConfig
from tpmsd.offline.inference.recording import record
from tpmsd.onboard.timeline.tick import Fix, Tick

CONFIG = Config(
    VehicleConfig((0.3,) * 4, 1.5, 1.4, 2.6, steering_ratio=14.5),
    CanConfig({}, Path("bus.dbc")),
    GnssConfig(),
)


def test_a_recording_keeps_its_name_and_its_gaps() -> None:
    """A missing tick is NaN on the grid; fixes count from the drive's start; the name is the given one."""
    ticks = [
        Tick(k, 100.0 + 0.1 * k, 0.1, np.full(4, float(k)), np.full(4, 0.01), yaw_rate_radps=0.01 * k)
        for k in (1, 2, 4)
    ]
    fix = Fix(100.35, 0.5, 7.0, 8.0, 1.0, speed_mps=9.0, heading_rad=1.0)
    ticks[-1] = Tick(4, 100.4, 0.1, np.full(4, 4.0), np.full(4, 0.01), (fix,), yaw_rate_radps=0.04)
    recording = record(ticks, CONFIG, "monday")

    assert ("monday", 4, 14.5) == (recording.name, recording.ticks, recording.car.steering_ratio)
    assert [1.0, 2.0, 4.0] == [x for x in recording.rotation_rad[:, 0].tolist() if not math.isnan(x)]
    assert [True] == np.isnan(recording.rotation_rad[2:3, 0]).tolist()
    assert np.allclose([0.01, 0.02, 0.04], recording.inertial["yaw_rate_radps"][[0, 1, 3]])
    assert [0.35, 7.0, 9.0] == [
        round(float(value[0]), 6) for value in (recording.fix_time_s, recording.east_m, recording.speed_mps)
    ]


def test_a_drive_without_ticks_is_no_drive() -> None:
    """Nothing in, a clear reason out."""
    with pytest.raises(ValueError, match="holds no readings that belong together"):
        record([], CONFIG)
