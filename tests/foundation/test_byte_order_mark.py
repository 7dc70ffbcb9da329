"""The byte order mark that Windows tools write in front of UTF-8 costs no reader its first line."""

from __future__ import annotations

import codecs
import gzip
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.offline.signals.test_vbo import HEADER
from tpmsd.car.config.dbc import load_dbc
from tpmsd.car.physics.model_file import load_model
from tpmsd.foundation.text_file import names_configuration, open_log, read_text
from tpmsd.offline.fleet.find_drives import car_model_name
from tpmsd.offline.signals.read import read_signals
from tpmsd.offline.signals.vbo import read_vbo
from tpmsd.offline.simulator.inject_can import log_lines
from tpmsd.offline.tables.read_table import read_table
from tpmsd.onboard.sources.can.log import read_can_log
from tpmsd.onboard.sources.gnss.nmea_log import bears_host_times, read_nmea_log

CANDUMP = b"(1719820800.1) can0 0B0#11\n(1719820800.2) can0 0B0#22\n"
ASC = b"base hex timestamps absolute\n0.100 1 0B0 Rx d 1 11\n0.200 1 0B0 Rx d 1 22\n"
TRC = b";$FILEVERSION=1.1\n1) 100.0 Rx 00B0 1 11\n2) 200.0 Rx 00B0 1 22\n"
RMC = b"$GNRMC,103000.00,A,4800.0,N,01100.0,E,10.0,90.0,010724,,,A"
VBO = HEADER[HEADER.index("[column names]") :].encode() + b"7 100000.00 3000 -600 50 90 0 0 0 0 0 0\n" * 2
MODEL = b'[[effect]]\nname = "centrifugal_growth"\ncoefficient = 2e-06\n'


def frames(path: Path) -> Any:
    return list(read_can_log(path))


def sentences(path: Path) -> Any:
    return bears_host_times(path), list(read_nmea_log(path))


READERS: list[tuple[str, bytes, Callable[[Path], Any]]] = [
    ("can.log", CANDUMP, frames),
    ("can.log.gz", CANDUMP, frames),
    ("can.asc", ASC, frames),
    ("can.trc", TRC, frames),
    ("gnss.nmea", b"(1719820800.1) " + RMC + b"\n", sentences),
    ("gnss.nmea.gz", RMC + b"\n", sentences),
    ("log.csv", b"time_s,a\n1,2\n2,3\n", lambda path: read_table(path).column("time_s").tolist()),
    ("signals.csv", b"time_s,speed_mps\n1,2\n2,3\n", lambda path: read_signals(path).time_s.tolist()),
    ("drive.vbo", VBO, lambda path: read_vbo(path, lambda line: None).sources),
    ("bus.dbc", b'BO_ 176 A: 8 X\n SG_ B : 0|8@1+ (1,0) [0|0] "" X\n', lambda p: str(load_dbc(p).messages)),
    ("model.toml", MODEL, load_model),
    (
        "vehicle.toml",
        b"[vehicle]\nwheelbase_m = 2.6\n",
        lambda p: (names_configuration(p), car_model_name(p)),
    ),
]


@pytest.mark.parametrize(("name", "content", "read"), READERS, ids=[name for name, *_ in READERS])
def test_a_byte_order_mark_costs_no_line(
    name: str, content: bytes, read: Callable[[Path], Any], tmp_path: Path
) -> None:
    """Each reader gives the same with the mark as without it, numbers of lines included."""
    found = []
    for mark in (b"", codecs.BOM_UTF8):
        data = mark + content
        (tmp_path / name).write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
        found.append(read(tmp_path / name))

    assert repr(found[0]) == repr(found[1])


def test_a_mark_is_text_where_it_stands_elsewhere(tmp_path: Path) -> None:
    """The mark is left out at the beginning alone; what is shorter than it stays whole."""
    for content, text in ((b"a\xef\xbb\xbf\n", "a\xef\xbb\xbf\n"), (b"\xef\xbb", "\xef\xbb"), (b"", "")):
        (tmp_path / "f").write_bytes(content)
        with open_log(tmp_path / "f") as file:
            assert text == file.read()
    (tmp_path / "f").write_bytes(codecs.BOM_UTF8 + b"1234")
    assert "1234" == read_text(tmp_path / "f", 7, "a text")


def test_damaged_compressed_data_is_raised_by_the_first_read(tmp_path: Path) -> None:
    """Opening takes any file; the reader of the log hears of the damage where it expects it."""
    for content in (b"no gzip", gzip.compress(np.random.default_rng(1).bytes(99))[:12]):
        (tmp_path / "f.gz").write_bytes(content)
        with open_log(tmp_path / "f.gz") as file, pytest.raises((OSError, EOFError)):
            file.read()


def test_an_injection_keeps_the_mark_apart_from_the_first_frame(tmp_path: Path) -> None:
    """Frames are rewritten line by line, so the mark is a line of its own and the file stays the same."""
    (tmp_path / "can.log").write_bytes(codecs.BOM_UTF8 + CANDUMP)
    lines = list(log_lines(tmp_path / "can.log"))

    assert [codecs.BOM_UTF8, *CANDUMP.splitlines(keepends=True)] == lines
