"""All stages of one drive, and what the tables make of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow.parquet as parquet
import pytest
from cantools.database import Database

import tpmsd
from tpmsd.offline.drives.drive import load
from tpmsd.offline.drives.playing import replay_drive, replays_at_desk_rate
from tpmsd.offline.drives.reading import FolderRecording, read_ticks
from tpmsd.offline.fleet.find_drives import find_drives
from tpmsd.offline.fleet.parameters import NAMES
from tpmsd.offline.fleet.store import Store
from tpmsd.offline.fleet.tables import write_tables
from tpmsd.offline.fleet.work import STAGES, make_result, work_on_drive
from tpmsd.onboard.sources.drive import FolderStream
from tpmsd.onboard.timeline.tick import Tick


def test_a_drive_through_all_stages(tmp_path: Path) -> None:
    """Replay, calibration and diagnosis of a drive fit into 200 kB and are those of the Python API."""
    drive = tpmsd.simulate(duration_s=120.0, seed=5, route="rural")
    folder = drive.save(tmp_path / "van-1" / "monday")
    store = Store.create(tmp_path / "store")
    (entry,) = find_drives([str(folder)])
    store.add(entry)

    assert "done" == work_on_drive(str(store.path), entry.key, STAGES, "run")
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


def test_all_stages_share_one_decoding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The drive is opened once, and what follows the replay is as if it had been read for it alone."""
    folder = tpmsd.simulate(duration_s=100.0, seed=5, route="rural").save(tmp_path / "van" / "monday")
    opened: list[Path] = []
    inner = FolderRecording.open

    def counted(recording: FolderRecording, *args: Any) -> tuple[FolderStream, Database]:
        opened.append(recording.folder)
        return inner(recording, *args)

    monkeypatch.setattr(FolderRecording, "open", counted)
    result = make_result(str(folder))
    assert (1, "done") == (len(opened), result["status"])
    alone = make_result(str(folder), ("calibrate",))
    assert 2 == len(opened)
    assert result["calibrate"]["statistics"] is not None
    assert alone["calibrate"] == result["calibrate"]


def test_a_replay_at_another_rate_makes_other_ticks(tmp_path: Path) -> None:
    """With ticks at 20 Hz in the car the drive is read again; at 10 Hz the replay's ticks are those read."""
    folder = tpmsd.simulate(duration_s=30.0, seed=5).save(tmp_path / "van" / "monday")
    drive = load(folder)
    ticks: list[Tick] = []
    replay_drive(drive, collected=ticks)
    assert replays_at_desk_rate(drive)
    assert list(map(repr, read_ticks(drive.recording, drive.config))) == list(map(repr, ticks))
    with (folder / "vehicle.toml").open("a") as file:
        file.write("\n[filter]\nrate_hz = 20.0\n")
    assert not replays_at_desk_rate(load(folder))
