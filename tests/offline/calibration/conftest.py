"""Drives that several tests of this package share, made once."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.worlds.kinematic import Drive, Spec, drive
from tpmsd.offline.simulator.bus import BusSpec
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive


@pytest.fixture(scope="session")
def town(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive folder: two and a half minutes in town, the rear pair's counts; true radii 318 and 315 mm."""
    spec = DriveSpec(
        route="city", duration_s=150.0, seed=3, bus=BusSpec(wheels=2), radius_offset_m=(0, 0, 2e-3, -1e-3)
    )
    folder = write_drive(tmp_path_factory.mktemp("drives") / "town", simulate_drive(spec))
    file = folder / "vehicle.toml"
    # A daemon of the tests keeps nothing and answers in the tests' own folder.
    extra = (
        f'\n[state]\nfile = ""\n\n[status]\nsocket = "{folder / "status.sock"}"  # a note of the operator\n'
    )
    file.write_text(file.read_text() + extra)
    return folder


@pytest.fixture(scope="session")
def country() -> Drive:
    """Five minutes on country roads in the world that shares no line with the program."""
    physics = {
        "load_transfer_lateral": {"coefficient": 1.5e-4},
        "track_width_error": {"rear_m": 0.05, "front_m": -0.04},
        "gnss_latency": {"latency_s": 0.15},
        "centrifugal_growth": {"coefficient": 1.2e-6},
    }
    return drive(Spec(duration_s=300.0, road="rural", radius_spread_m=2e-3, physics=physics), 5)
