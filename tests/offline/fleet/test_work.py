"""All stages of one drive, and what the tables make of it."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as parquet
import pytest

import tpmsd
from tpmsd.offline.drives.drive import Drive
from tpmsd.offline.drives.playing import recording_of
from tpmsd.offline.fleet.find import find_drives
from tpmsd.offline.fleet.parameters import NAMES
from tpmsd.offline.fleet.store import Store
from tpmsd.offline.fleet.tables import write_tables
from tpmsd.offline.fleet.work import STAGES, make_result, work_on
from tpmsd.offline.inference.recording import Recording


def test_a_drive_through_all_stages(tmp_path: Path) -> None:
    """Replay, calibration and diagnosis of a drive fit into 200 kB and are those of the Python API."""
    drive = tpmsd.simulate(duration_s=120.0, seed=5, route="rural")
    folder = drive.save(tmp_path / "van-1" / "monday")
    store = Store.create(tmp_path / "store")
    (entry,) = find_drives([str(folder)])
    store.add(entry)

    assert "done" == work_on(str(store.path), entry.key, STAGES, "run")
    assert next(store.bytes_per_result()) < 200_000
    result = store.result(entry.key)
    assert result is not None
    expected = tpmsd.diagnose(folder)
    assert expected.verdict == result["diagnose"]["verdict"]
    assert [one.effect for one in expected.findings] == [
        one["effect"] for one in result["diagnose"]["findings"]
    ]

    counts = write_tables(store)
    assert (4, 2 * len(NAMES)) == (counts["wheels"], counts["statistics"])
    rows = parquet.read_table(store.tables / "statistics.parquet").to_pylist()
    (mean,) = [one for one in rows if one["parameter"] == "radius_mean" and one["level"] == "car"]
    radii = tpmsd.calibrate(folder).radii_m.values()
    # At 20 m/s here, at the drive's own speed there: what growth may make of that is in the deviation.
    relative = sum(radii) / 4 / 0.316 - 1.0
    assert abs(mean["value"] - relative) < 3.0 * mean["std"] + 1e-3


def test_calibration_and_diagnosis_share_one_decoding(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The drive is read twice in all: once in the daemon's steps for the replay, once as arrays."""
    folder = tpmsd.simulate(duration_s=100.0, seed=5, route="rural").save(tmp_path / "van" / "monday")
    read: list[str] = []

    def counted(drive: Drive, name: str | None = None) -> Recording:
        read.append(drive.name)
        return recording_of(drive, name)

    monkeypatch.setattr("tpmsd.offline.drives.playing.recording_of", counted)
    result = make_result(str(folder))
    assert (["monday"], "done") == (read, result["status"])
    assert result["calibrate"]["statistics"] is not None
