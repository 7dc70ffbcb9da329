"""Logs in the formats of other tools, by python-can's readers: ASC, BLF, TRC and MF4.

In: a path. Out: frames (MF4 is read in a process of its own); what a reader cannot take goes to `note`.
The text formats are read on after a bad line, which python-can's readers alone would not do; a binary file
ends where it is damaged. A further format is one more row of `log.READERS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import TextIO, cast

import can

from tpmsd.foundation.child_reader import ChildReadError, installed
from tpmsd.foundation.errors import InputError
from tpmsd.onboard.sources.can.candump_line import EXTENDED_MASK
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.can.log_lines import AscLines, LogLines
from tpmsd.onboard.sources.can.log_mf4 import read_mf4
from tpmsd.onboard.sources.can.packed_bounds import check_blf

LONGEST_BYTES = 64
"""Data of a CAN FD frame."""

Note = Callable[[int, str], None]


def read_by_python_can(suffix: str, path: Path, note: Note) -> Iterator[CanFrame]:
    """Return frames of an .asc, .blf, .trc or .mf4 file."""
    if suffix == ".asc":
        return _read_text(path, note, AscLines, can.ASCReader)
    if suffix == ".trc":
        return _read_text(path, note, LogLines, can.TRCReader)
    if suffix == ".blf":
        return _read_blf(path, note)
    return _read_mf4(path, note)


def _read_text(
    path: Path,
    note: Note,
    lines_type: type[LogLines],
    open_reader: Callable[[TextIO], Iterable[can.Message]],
) -> Iterator[CanFrame]:
    """Yield frames of a text log; a bad line is noted and skipped, as far as the reader gets beyond it."""
    with closing(lines_type(path)) as lines:
        reader = open_reader(cast(TextIO, lines))
        while True:
            before = lines.number
            try:
                for message in reader:
                    yield frame_of(message, lines.number, lines.start_s)
                return
            except Exception as error:
                # Whatever their parsing of a damaged line raises: ValueError, IndexError, KeyError, ...
                if lines.number == before or lines.closed:
                    # It fails without reading on: no line is to blame, so there is no going on.
                    note(lines.number, f"cannot be read as {path.suffix[1:].upper()}: {_reason(error)}")
                    return
                note(lines.number, f"{_reason(error)}: {lines.current.strip()[:60]!r}")
                lines.resume()


def _read_blf(path: Path, note: Note) -> Iterator[CanFrame]:
    size = path.stat().st_size
    try:
        with path.open("rb") as file:
            check_blf(file)
        with can.BLFReader(path) as reader:
            for message in reader:
                yield frame_of(message)
            if reader.file_size > size:
                note(0, f"cut short: {size} of {reader.file_size} bytes")
    except Exception as error:
        # struct.error, zlib.error, BLFParseError, ValueError, ...: damaged from here on.
        note(0, f"cannot be read on as BLF: {_reason(error)}")


def _read_mf4(path: Path, note: Note) -> Iterator[CanFrame]:
    if not installed("asammdf"):
        raise InputError(path, "MF4 needs the package asammdf: pip install 'tpmsd[mf4]'")
    try:
        yield from read_mf4(path)
    except ChildReadError as error:
        note(0, f"cannot be read on as MF4: {error}")


def frame_of(message: can.Message, line: int = 0, start_s: float = 0.0) -> CanFrame:
    """Return python-can's message as a frame; ValueError for what cannot be one."""
    if not math.isfinite(message.timestamp):
        raise ValueError("no time stamp")
    if not 0 <= message.arbitration_id <= EXTENDED_MASK:
        raise ValueError("an identifier of more than 29 bits")
    if len(message.data) > LONGEST_BYTES:
        raise ValueError(f"{len(message.data)} bytes of data")
    return CanFrame(
        message.timestamp + start_s,
        "" if message.channel is None else str(message.channel),
        message.arbitration_id,
        message.is_extended_id and not message.is_error_frame,
        message.is_fd,
        message.is_error_frame,
        message.is_remote_frame,
        bytes(message.data),
        line,
    )


def _reason(error: Exception) -> str:
    """Return an error's type and text as one line of bounded length."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}{f' ({text[:120]})' if text else ''}"
