"""A plain NMEA log finds the bus's clock by the speeds that both saw."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.car.config.load import load_config
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.drives.reading import FolderRecording
from tpmsd.offline.simulator.clock import Clocks
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.onboard.sources.align import align


def _speed(time_s: FloatArray) -> FloatArray:
    """A drive whose speed never repeats itself, m/s."""
    return 15.0 + 6.0 * np.sin(time_s / 17.0) + 4.0 * np.sin(time_s / 41.3 + 1.0) + 3.0 * np.sin(time_s / 7.1)


@settings(derandomize=True, deadline=None, max_examples=25)
@given(
    offset_s=st.floats(-90_000.0, 90_000.0),
    period_s=st.sampled_from([0.1, 0.2, 1.0]),
    start_s=st.floats(0.0, 200.0),
    span_s=st.floats(150.0, 350.0),
)
def test_any_constant_offset_is_found(
    offset_s: float, period_s: float, start_s: float, span_s: float
) -> None:
    """A receiver that saw a part of the drive on another clock is put back to within a tenth of a second."""
    wheel_time = np.arange(0.0, 600.0, 0.05)
    fix_time = np.arange(start_s, start_s + span_s, period_s)
    noise = np.random.default_rng(1).normal(0.0, 0.1, fix_time.size)
    found = align(wheel_time, _speed(wheel_time), fix_time - offset_s, _speed(fix_time) + noise)
    assert found is not None
    assert found.trusted
    assert found.offset_s == pytest.approx(offset_s, abs=0.1)


def test_speeds_of_another_drive_are_not_trusted() -> None:
    """Two different drives have no offset that fits."""
    time_s = np.arange(0.0, 600.0, 0.1)
    other = 15.0 + np.cumsum(np.random.default_rng(2).normal(0.0, 0.15, time_s.size))
    found = align(time_s, _speed(time_s), time_s, other)
    assert found is None or not found.trusted


def test_a_constant_speed_tells_no_offset() -> None:
    """Where nothing changes there is nothing to compare."""
    time_s = np.arange(0.0, 300.0, 0.1)
    assert align(time_s, np.full(time_s.size, 20.0), time_s, np.full(time_s.size, 20.0)) is None


def test_too_little_data_tells_no_offset() -> None:
    """A handful of fixes is refused rather than guessed from."""
    time_s = np.arange(0.0, 300.0, 0.1)
    assert align(time_s, _speed(time_s), time_s[:5], _speed(time_s[:5])) is None


def test_a_log_without_host_times_is_put_onto_the_clock_of_the_bus(tmp_path: Path) -> None:
    """The sentences' UTC is shifted by the 37.5 s that the bus's clock is ahead of it, and a note says so."""
    spec = DriveSpec(duration_s=90.0, seed=3, clocks=Clocks(host_offset_s=37.5))
    folder = write_drive(tmp_path / "drive", simulate_drive(spec))
    log = folder / "gnss.nmea"
    log.write_text(re.sub(r"^\(\d+\.\d+\) ", "", log.read_text("ascii"), flags=re.MULTILINE), "ascii")
    notes: list[str] = []
    stream, _ = FolderRecording(folder).open(load_config(folder / "vehicle.toml"), notes.append)

    assert 37.5 == pytest.approx(stream.gnss_offset_s, abs=0.15)
    assert [] != [note for note in notes if "shifted by +37." in note]
