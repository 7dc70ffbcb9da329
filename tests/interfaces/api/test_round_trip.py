"""A recording's tick table, imported again, is the same drive."""

from __future__ import annotations

import gzip
import shutil
from itertools import takewhile
from pathlib import Path

import numpy as np
import pytest

import tpmsd
from bench.places import RECORDINGS
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.cli.main import main

REAL = sorted(path.parent.name for path in RECORDINGS.glob("*/vehicle.toml")) if RECORDINGS.is_dir() else []
SPAN_S = 20.0
"""Of each recording: all its columns are there by then."""


def stamp_s(line: bytes) -> float:
    """The host's time of a line."""
    return float(line[1 : line.index(b")")])


def beginning(recording: Path, folder: Path) -> Path:
    """The first seconds of a recording as a drive folder."""
    folder.mkdir()
    for name in ("vehicle.toml", "bus.dbc"):
        shutil.copy(recording / name, folder / name)
    with gzip.open(recording / "can.log.gz") as file:
        first = next(file)
        end_s = stamp_s(first) + SPAN_S
        (folder / "can.log").write_bytes(
            first + b"".join(takewhile(lambda line: stamp_s(line) < end_s, file))
        )
    with (recording / "gnss.nmea").open("rb") as file:
        lines = takewhile(lambda line: stamp_s(line) < end_s, file)
        (folder / "gnss.nmea").write_bytes(b"".join(lines))
    return folder


@pytest.mark.skipif(not REAL, reason="no recordings")
@pytest.mark.parametrize("name", REAL)
def test_every_recording_comes_back(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`replay --csv` and `--parquet` and then `import` give drives of the same rotations and fixes;
    signals of which the recording knows nothing are left out with a note."""
    drive = beginning(RECORDINGS / name, tmp_path / "drive")
    tables = {kind: tmp_path / f"ticks.{kind}" for kind in ("csv", "parquet")}
    assert 0 == main(["replay", str(drive), *(f"--{kind}={path}" for kind, path in tables.items())])
    (tmp_path / "map.toml").write_text(f'vehicle = "{drive / "vehicle.toml"}"\n')
    capsys.readouterr()
    assert 0 == main(["import", str(tables["parquet"]), str(tmp_path / "a")])
    noted = capsys.readouterr().err
    assert 0 == main(["import", str(tables["csv"]), f"--map={tmp_path / 'map.toml'}", str(tmp_path / "b")])

    for file in ("can.log", "gnss.nmea", "bus.dbc"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    before, after = (tpmsd.replay(folder).table for folder in (drive, tmp_path / "a"))
    assert before is not None
    assert after is not None
    # A wheel has turned nothing known before its first reading, so the first tick is another.
    _, here, there = np.intersect1d(before["time_s"].round(3), after["time_s"].round(3), return_indices=True)
    assert len(here) > 0.95 * len(before)
    for wheel in WHEELS:
        turned, again = (table[f"wheel_angle_{wheel}_rad"] for table in (before, after))
        assert (f"wheel_angle_{wheel}" in noted) == (not np.isfinite(turned).any())
        difference = (turned[here] - again[there])[np.isfinite(turned[here]) & np.isfinite(again[there])]
        assert np.isfinite(again).any() == np.isfinite(turned).any()
        if len(difference):
            assert np.ptp(difference) < 0.001
    for column in ("gnss_latitude_deg", "gnss_longitude_deg"):
        sent, read = (table[column][np.isfinite(table[column])] for table in (before, after))
        assert len(sent) > 10
        np.testing.assert_allclose(read, sent[: len(read)], atol=1e-8)
        assert len(sent) - len(read) <= 3  # those of the last holdback
    assert "accel_long" in noted
