"""Recordings of vehicle dynamics for the tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parent.parent.parent


@pytest.fixture(scope="session")
def recorded_dynamics() -> Path:
    """The folder of real cars' signals, where it is at hand."""
    folder = Path(os.environ.get("TPMSD_DYNAMICS", REPO.parent / "shared" / "dynamics"))
    if not folder.is_dir():
        pytest.skip(f"no recordings of vehicle dynamics at {folder} (set TPMSD_DYNAMICS)")
    return folder
