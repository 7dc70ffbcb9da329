"""Fixtures that all tests share."""

from __future__ import annotations

import gc
import importlib
import os
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parent.parent
YOUNG_OBJECTS = 20_000
"""New objects after which garbage is looked for: some megabytes. After 700, which is usual, tests that make
many objects take up to a seventh longer."""


def pytest_collection_finish() -> None:
    """Modules and tests stay until the end: the collector of garbage need not look through them each time.

    Hypothesis asks the collector who refers to a generator, so what it registers comes before."""
    importlib.import_module("hypothesis")
    gc.collect()
    gc.freeze()
    gc.set_threshold(YOUNG_OBJECTS)


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder of real drives, by TPMSD_RECORDINGS or beside the repository; skips where there is none."""
    folder = Path(os.environ.get("TPMSD_RECORDINGS", REPO.parent / "shared" / "recordings"))
    if not folder.is_dir():
        pytest.skip(f"no real recordings at {folder} (set TPMSD_RECORDINGS)")
    return folder


@pytest.fixture(scope="session")
def recorded_dynamics() -> Path:
    """The folder of real cars' signals (TPMSD_DYNAMICS, or beside the real drives); skips where absent."""
    drives = Path(os.environ.get("TPMSD_RECORDINGS", REPO.parent / "shared" / "recordings"))
    folder = Path(os.environ.get("TPMSD_DYNAMICS", drives.parent / "dynamics"))
    if not folder.is_dir():
        pytest.skip(f"no signals of real cars at {folder} (set TPMSD_DYNAMICS)")
    return folder
