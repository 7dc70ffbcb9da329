"""Simulated drives for the tests of this package.

`recorded` reads a drive of the program's own simulator through the whole path from files; `recording_of` lays
out one of the independent worlds without files.
"""

from __future__ import annotations

from pathlib import Path

from bench.campaigns.offline.calibrate_recording import configured, recording_of
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config
from tpmsd.car.physics.motion import Motion
from tpmsd.interfaces.cli.drive_reading import read_ticks
from tpmsd.offline.inference.recording import Recording, record
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive

__all__ = ["configured", "recorded", "recording_of"]


def recorded(folder: Path, spec: DriveSpec, motion: Motion | None = None) -> tuple[Recording, Config]:
    write_drive(folder, simulate_drive(spec, motion))
    config = load_config(folder)
    return record(read_ticks(folder, config), config, folder.name), config
