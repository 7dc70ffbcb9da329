"""Each format of table through the command line, in a process of its own, as a user runs it."""

from __future__ import annotations

import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from tests.interfaces.api.test_from_tables import straight
from tests.interfaces.api.test_tables import MAP, frame_of, hdf5, mf4
from tpmsd.offline.tables.read_table import SUFFIXES
from tpmsd.onboard.sources.can.packed_bounds import _DZ, MAX_BLOCK_BYTES


def run(*arguments: Any) -> subprocess.CompletedProcess[str]:
    """A command as it is started from a shell: nothing is imported before."""
    command = [sys.executable, "-m", "tpmsd", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def mdf3(frame: pd.DataFrame, path: Path) -> None:
    from asammdf import MDF, Signal

    with MDF(version="3.30") as file:
        for name in frame.columns[1:]:
            known = frame[name].notna().to_numpy()
            times = frame["t_ms"].to_numpy()[known] / 1e3
            file.append(Signal(frame[name].to_numpy()[known], times, name=name, unit=""))
        file.save(path, overwrite=True)


def separated(mark: str, decimal: str = ".") -> Callable[[pd.DataFrame, Path], None]:
    return lambda frame, path: frame.to_csv(path, index=False, sep=mark, decimal=decimal)


WRITERS: dict[str, Callable[[pd.DataFrame, Path], None]] = {
    ".csv": separated(","),
    ".tsv": separated("\t"),
    ".txt": separated(";", ","),
    ".parquet": lambda frame, path: frame.to_parquet(path),
    ".mf4": mf4,
    ".mdf": mdf3,
    ".mat": hdf5,
    ".h5": hdf5,
    ".hdf5": hdf5,
}


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_import_reads_every_format(suffix: str, tmp_path: Path) -> None:
    """A table in each format that `import` knows becomes a drive with all its readings."""
    table = tmp_path / f"log{suffix}"
    WRITERS[suffix](frame_of(*straight(10.0)), table)
    (tmp_path / "map.toml").write_text(MAP)
    done = run("import", table, "--map", tmp_path / "map.toml", tmp_path / "drive")

    assert (0, "") == (done.returncode, done.stderr)
    assert "10 s, 2000 frames, 96 sentences" in done.stdout  # 500 of each wheel, RMC, GGA and GST of 32 fixes
    assert len((tmp_path / "drive" / "can.log").read_text().splitlines()) == 2000


def packed_block() -> bytes:
    """An MF4 block that says that it unpacks to more than a block may."""
    packed = zlib.compress(bytes(1000))
    return _DZ.pack(b"##DZ", _DZ.size, 0, b"DT", 0, 0, 0, MAX_BLOCK_BYTES + 1, len(packed)) + packed


@pytest.mark.parametrize(
    ("content", "reason"),
    [(b"MDF     4.10 and no more", "not an MF4 file"), (packed_block(), "a packed block of 16777217 bytes")],
)
def test_import_bounds_what_mf4_unpacks_to(content: bytes, reason: str, tmp_path: Path) -> None:
    """A damaged MF4 table, or one that would unpack without bound, ends with one line and exit code 3."""
    (tmp_path / "log.mf4").write_bytes(content)
    (tmp_path / "map.toml").write_text(MAP)
    done = run("import", tmp_path / "log.mf4", "--map", tmp_path / "map.toml", tmp_path / "drive")

    assert 3 == done.returncode
    (line,) = done.stderr.splitlines()
    assert reason in line
