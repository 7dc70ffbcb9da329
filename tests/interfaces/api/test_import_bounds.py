"""Tables made to cost memory or time, or to bring bytes of other files: one line and exit code 3."""

from __future__ import annotations

import re
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from tests.interfaces.api.test_from_tables import straight
from tests.interfaces.api.test_tables import MAP, frame_of, hdf5

MAX_MB = 300
"""Resident memory of the command and of its child."""
WRAPPED = """
import re, resource, sys
from pathlib import Path
from tpmsd.interfaces.cli.main import main
code = main(sys.argv[1:])
own = int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])
child = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
print(max(own, child) // 1024)
sys.exit(code)
"""


def columns() -> list[str]:
    return list(frame_of(*straight(1.0)).columns)


def huge_hdf5(path: Path) -> None:
    """A few kB that state 500 million values each."""
    with h5py.File(path, "w") as file:
        for name in columns():
            file.create_dataset(name, (500_000_000,), "f8", chunks=(1000,))


def huge_chunk(path: Path) -> None:
    """Ten values in a chunk of 500 million."""
    with h5py.File(path, "w") as file:
        for name in columns():
            file.create_dataset(name, (10,), "f8", chunks=(500_000_000,), maxshape=(None,), compression=9)


def huge_parquet(path: Path) -> None:
    """Equal values, which pack to next to nothing."""
    block = pa.table({name: np.zeros(1_000_000) for name in columns()})
    with parquet.ParquetWriter(path, block.schema, compression="zstd") as writer:
        for _ in range(20):
            writer.write_table(block)


def long_line(path: Path) -> None:
    """300 MB without an end of line."""
    with path.open("wb") as file:
        file.write(",".join(columns()).encode() + b"\n")
        for _ in range(300):
            file.write(b"1," * (1 << 19))


def long_row(path: Path) -> None:
    """A row of quoted fields, each of which ends a line."""
    with path.open("wb") as file:
        file.write(",".join(columns()).encode() + b"\n" + b'"1\n",' * 2_000_000)


def damaged(write: Callable[[Path], None]) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        write(path)
        whole = bytearray(path.read_bytes())
        for at in range(8, len(whole) - 8, 7):
            whole[at] ^= 0x55
        path.write_bytes(whole)

    return make


def sound_parquet(path: Path) -> None:
    frame_of(*straight(1.0)).to_parquet(path)


def sound_hdf5(path: Path) -> None:
    hdf5(frame_of(*straight(1.0)), path)


def external(path: Path) -> None:
    """The values lie in another file of this machine."""
    secret = path.with_name("secret")
    secret.write_bytes(bytes(8000))
    with h5py.File(path, "w") as file:
        for name in columns():
            file.create_dataset(name, (1000,), "f8", external=[(str(secret), 0, 8000)])


def virtual(path: Path) -> None:
    """The values are a view of another file's."""
    sound_hdf5(path.with_name("other.h5"))
    with h5py.File(path, "w") as file:
        for name in columns():
            layout = h5py.VirtualLayout((10,), "f8")
            layout[:] = h5py.VirtualSource(str(path.with_name("other.h5")), name, (10,))
            file.create_virtual_dataset(name, layout)


def linked(path: Path) -> None:
    """A name that stands for a data set of another file."""
    sound_hdf5(path.with_name("other.h5"))
    sound_hdf5(path)
    with h5py.File(path, "a") as file:
        name = columns()[1]
        del file[name]
        file[name] = h5py.ExternalLink(str(path.with_name("other.h5")), name)


HOSTILE: dict[str, tuple[Callable[[Path], None], str]] = {
    "huge.h5": (huge_hdf5, "500000000 values; of a table at most 16000000"),
    "chunk.h5": (huge_chunk, "500000000 values; of a table at most 16000000"),
    "huge.parquet": (huge_parquet, "20000000 values; of a table at most 16000000"),
    "line.csv": (long_line, "a row of more than 1048576 characters"),
    "row.csv": (long_row, "a row of more than 1048576 characters"),
    "damaged.parquet": (damaged(sound_parquet), "Parquet"),
    "damaged.h5": (damaged(sound_hdf5), "HDF5"),
    "external.h5": (external, "its values lie in another file, which is not read"),
    "virtual.h5": (virtual, "its values lie in another file, which is not read"),
    "linked.h5": (linked, "a link to another file is not followed"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_table_is_refused_within_bounds(name: str, tmp_path: Path) -> None:
    """One line, exit code 3, 300 MB and 20 s at most, and no drive is written."""
    make, reason = HOSTILE[name]
    make(tmp_path / name)
    (tmp_path / "map.toml").write_text(MAP)
    before_s = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    done = subprocess.run(
        [sys.executable, "-c", WRAPPED, "import", str(tmp_path / name),
         "--map", str(tmp_path / "map.toml"), str(tmp_path / "drive")],
        capture_output=True, text=True, timeout=120.0, check=False,
    )  # fmt: skip
    taken_s = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before_s

    assert 3 == done.returncode, done.stderr
    (line,) = done.stderr.splitlines()
    assert re.match(r"tpmsd: .*/" + re.escape(name), line)
    assert reason in line
    assert not (tmp_path / "drive").exists()
    assert int(done.stdout) < MAX_MB
    assert taken_s < 20.0
