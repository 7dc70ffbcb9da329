"""The noise that a path is estimated with: what a drive without disturbances leaves of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.offline.dynamics.drives import folder, loaded
from tpmsd.offline.dynamics.path import Setup
from tpmsd.offline.dynamics.search import Search

CHANNELS = ("yaw_rate", "accel_lat", "velocity_lat")
RECORDED = (0.002, 0.05, 0.02)
"""Standard deviations of the world's sensors."""


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_part_of_a_sensors_noise_is_taken_for_motion(tmp_path: Path, seed: int) -> None:
    """Nothing disturbs this car: disturbances stay below a fifth of a reading's noise, which is all there."""
    baseline, drive = loaded(folder(tmp_path / "d", (), "three-dof", 100.0, seed), "three-dof")
    search = Search(Setup(baseline, drive, CHANNELS))
    rows = len(drive.time_s)

    # four standard deviations of a standard deviation from so many rows
    assert search.noise.outputs == pytest.approx(np.array(RECORDED), rel=4.0 / np.sqrt(2.0 * rows))
    assert np.all(search.noise.disturbance < 0.2 * RECORDED[1])
