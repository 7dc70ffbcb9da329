"""Packed logs that were made to eat memory or time: refused in one line, within 10 s and 300 MB."""

from __future__ import annotations

import io
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import can
import pytest

from tpmsd.onboard.sources.can.log import read_can_log
from tpmsd.onboard.sources.can.packed_bounds import MAX_CONTAINER_BYTES, check_blf, check_mf4

MB = 1 << 20
READ = r"""
import re, sys
from pathlib import Path
from tpmsd.foundation.errors import InputError
from tpmsd.onboard.sources.can.log import read_can_log
try:
    print(sum(1 for _ in read_can_log(Path(sys.argv[1]))), "frames")
except InputError as error:
    print(error)
# Not ru_maxrss, which counts the parent before the fork.
print(int(re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())[1]) // 1024)
"""


def blf(*containers: bytes, method: int = 2) -> bytes:
    """A BLF file of these containers."""
    out = b"LOGG" + struct.pack("<L", 144) + bytes(136)
    for content in containers:
        body = struct.pack("<H6xL4x", method, len(content)) + (
            zlib.compress(content, 1) if method == 2 else content
        )
        out += struct.pack("<4sHHLL", b"LOBJ", 16, 1, 16 + len(body), 10) + body
        out += bytes(len(body) % 4)
    return out


def inner(size: int, kind: int = 1, body: bytes = bytes(32)) -> bytes:
    """An object in a container, with the size that it states."""
    return struct.pack("<4sHHLL", b"LOBJ", 32, 1, size, kind) + body


def mf4(unpacked: int, data: bytes) -> bytes:
    """A start of MF4 and one packed block."""
    body = zlib.compress(data, 1)
    block = struct.pack("<4s4xQQ2sBBLQQ", b"##DZ", 48 + len(body), 0, b"DT", 0, 0, 0, unpacked, len(body))
    return b"MDF     4.10    python  " + bytes(40) + block + body


HOSTILE = {
    "bomb.blf": (lambda: blf(bytes(320 * MB)), "a container that unpacks to more than 16 MB"),
    "many bombs.blf": (lambda: blf(*[inner(900 * MB) + bytes(15 * MB)] * 22), "an object of 943718400 bytes"),
    "no size.blf": (lambda: blf(inner(0)), "an object of 0 bytes"),
    "no size, unknown.blf": (lambda: blf(inner(0).replace(b"\x01\x00", b"\x07\x00")), "of 0 bytes"),
    "huge object.blf": (lambda: blf() + struct.pack("<4sHHLL", b"LOBJ", 16, 1, 0xFFFFFFFF, 10), "4294967295"),
    "bomb.mf4": (lambda: mf4(MB, bytes(320 * MB)), "a packed block that unpacks to more than 16 MB"),
    "huge.mf4": (lambda: mf4(1 << 40, bytes(MB)), "a packed block of 1099511627776 bytes"),
    "many.mf4": (lambda: mf4(15 * MB, bytes(15 * MB)) * 18, "256 MB of data"),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_a_packed_log_that_is_a_trap_is_refused_within_bounds(tmp_path: Path, name: str) -> None:
    """One line that says what is wrong; 10 s and 300 MB at most."""
    make, reason = HOSTILE[name]
    path = tmp_path / name.replace(" ", "-")
    path.write_bytes(make())
    done = subprocess.run(
        [sys.executable, "-c", READ, str(path)], capture_output=True, text=True, timeout=50.0
    )

    line, peak_mb = done.stdout.splitlines()
    assert (0, "") == (done.returncode, done.stderr)
    assert reason in line
    assert int(peak_mb) < 300


@pytest.mark.parametrize("suffix", [".blf", ".mf4"])
def test_a_sound_log_is_within_bounds(tmp_path: Path, suffix: str) -> None:
    """What python-can writes passes, over many containers, and all its frames are read."""
    if suffix == ".mf4":
        pytest.importorskip("asammdf")
    path = tmp_path / f"log{suffix}"
    with can.Logger(path) as writer:
        for k in range(9000):
            writer.on_message_received(can.Message(1.7e9 + 1e-3 * k, 0x100, False, data=bytes(8), channel=0))
    with path.open("rb") as file:
        (check_blf if suffix == ".blf" else check_mf4)(file)
    assert 9000 == sum(1 for _ in read_can_log(path))


def test_objects_are_followed_over_containers() -> None:
    """An object that begins in one container and ends in another hides none that comes after it."""
    text = inner(64, body=bytes(48)) * 5 + inner(7)
    for cut in range(1, len(text)):
        with pytest.raises(ValueError, match="an object of 7 bytes"):
            check_blf(io.BytesIO(blf(text[:cut], text[cut:] + bytes(64))))
    check_blf(io.BytesIO(blf(bytes(MAX_CONTAINER_BYTES - 64), method=0)))
