"""A drive with a puncture, replayed once for all tests of the Python face and of tables."""

from __future__ import annotations

from pathlib import Path

import pytest

import tpmsd
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive

ONSET_S = 90.0
FAULT = tpmsd.Fault("puncture", 2.0, wheel="rl", onset_s=ONSET_S)


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    spec = DriveSpec(duration_s=160.0, seed=3, faults=(FAULT,))
    return write_drive(tmp_path_factory.mktemp("drives") / "nail", simulate_drive(spec))


@pytest.fixture(scope="session")
def replay(folder: Path) -> tpmsd.Replay:
    return tpmsd.replay(folder)
