"""Logs in the formats of other tools, by python-can's readers: ASC, BLF, TRC and MF4.

In: a path. Out: frames; what a reader cannot take is told to `note`. The text formats are read on after a bad
line, which python-can's readers alone would not do; a binary file ends where it is damaged.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import TextIO, cast

import can

from tpmsd.errors import InputError
from tpmsd.sources.can_frame import CanFrame

Note = Callable[[int, str], None]


def read_by_python_can(path: Path, suffix: str, note: Note) -> Iterator[CanFrame]:
    """Frames of an .asc, .blf, .trc or .mf4 file."""
    if suffix == ".asc":
        return _read_text(path, note, _AscLines, lambda lines: can.ASCReader(lines, relative_timestamp=False))
    if suffix == ".trc":
        return _read_text(path, note, _Lines, can.TRCReader)
    if suffix == ".blf":
        return _read_blf(path, note)
    return _read_mf4(path, note)


class _Lines:
    """A text file, as far as python-can's readers need one, that knows the number of the line read last."""

    def __init__(self, path: Path) -> None:
        # Latin-1 takes any byte; universal newlines take all line ends, also mixed.
        self._file = path.open(encoding="latin-1")
        self.number = 0
        self.current = ""

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        self.current = next(self._file)
        self.number += 1
        return self.current

    def close(self) -> None:
        """Readers close the file at its end."""
        self._file.close()

    @property
    def closed(self) -> bool:
        """Whether the end was reached."""
        return self._file.closed

    def resume(self) -> None:
        """Called before a reader goes on after a bad line."""


class _AscLines(_Lines):
    """Lines of an ASC file with times since its start.

    The header says whether times are 'absolute' (since the start of the measurement) or 'relative' (since
    the line before); python-can takes both as absolute, so relative ones are summed up here.
    """

    _RELATIVE = re.compile(r"\s*base\s+\w+\s+timestamps\s+relative", re.IGNORECASE)
    _HEADER_END = re.compile(r"\s*(no\s+)?internal\s+events\s+logged|\s*begin\s+triggerblock", re.IGNORECASE)
    _TIME = re.compile(r"\s*(\d+\.\d+)(\s.*)", re.DOTALL)

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._relative = False
        self._in_header = True
        self._now_s = 0.0
        self._pushed: list[str] = []

    def __next__(self) -> str:
        if self._pushed:
            return self._pushed.pop()
        line = super().__next__()
        match = self._TIME.match(line)
        if self._in_header:
            self._relative |= self._RELATIVE.match(line) is not None
            self._in_header = match is None and self._HEADER_END.match(line) is None
        if match is None or not self._relative:
            return line
        self._now_s += float(match[1])
        return f"{self._now_s:.9f}{match[2]}"

    def resume(self) -> None:
        # Iterating again, the reader looks for a header, and would take the next frame for its end.
        if not self._in_header:
            self._pushed.append("internal events logged\n")


def _read_text(
    path: Path,
    note: Note,
    lines_type: type[_Lines],
    open_reader: Callable[[TextIO], Iterable[can.Message]],
) -> Iterator[CanFrame]:
    with closing(lines_type(path)) as lines:
        reader = open_reader(cast(TextIO, lines))
        while True:
            before = lines.number
            try:
                for message in reader:
                    yield _frame(message, lines.number)
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
        with can.BLFReader(path) as reader:
            for message in reader:
                yield _frame(message, 0)
            if reader.file_size > size:
                note(0, f"cut short: {size} of {reader.file_size} bytes")
    except Exception as error:
        # struct.error, zlib.error, BLFParseError, ValueError, ...: damaged from here on.
        note(0, f"cannot be read on as BLF: {_reason(error)}")


def _read_mf4(path: Path, note: Note) -> Iterator[CanFrame]:
    try:
        import asammdf  # noqa: F401
    except ImportError:
        raise InputError(path, "MF4 needs the package asammdf: pip install 'tpmsd[mf4]'") from None
    from can.io.mf4 import MF4Reader

    try:
        with MF4Reader(path) as reader:
            for message in reader:
                yield _frame(message, 0)
    except Exception as error:
        # asammdf raises dozens of types on damaged files.
        note(0, f"cannot be read on as MF4: {_reason(error)}")


def _frame(message: can.Message, line: int) -> CanFrame:
    if not math.isfinite(message.timestamp):
        raise ValueError("no time stamp")
    return CanFrame(
        message.timestamp,
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
    text = " ".join(str(error).split())
    return f"{type(error).__name__}{f' ({text[:120]})' if text else ''}"
