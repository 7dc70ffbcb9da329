"""Fixtures that all tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parent.parent


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
