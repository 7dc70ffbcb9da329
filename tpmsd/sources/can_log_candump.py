"""Logs as `candump -L` writes them, also compressed with gzip.

In: the path of a `.log` or `.log.gz`. Out: frames; each line that is none is told to `note` and skipped.

    (1719820800.012345) can0 0B0#1122334455667788        standard identifier: three digits
    (1719820800.012345) can0 18FEF100#11223344 R         extended: eight; a direction may follow
    (1719820800.012345) can0 123##1001122                CAN FD: two #, one digit of flags
    (1719820800.012345) can0 123#R8                      remote frame, with its length
    (1719820800.012345) can0 20000080#0000000000000000   error frame
    (1719820800.012345) can0 123#1122334455667788_9      classic frame with its raw length code

Own parser, because python-can's stops at the first damaged line and takes four times as long.
"""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

from tpmsd.sources.can_frame import CanFrame

MAX_LINE_CHARS = 4096
_ERROR_FLAG = 0x20000000
_EXTENDED_MASK = 0x1FFFFFFF

_LINE = re.compile(
    r"\((\d{1,12}\.\d{1,9})\)[ \t]+(\S+)[ \t]+"
    r"(?:([0-9A-Fa-f]{3})|([0-9A-Fa-f]{8}))#"
    r"(?:((?:[0-9A-Fa-f]{2}){0,8})(?:_[0-9A-Fa-f])?"
    r"|(R)[0-9A-Fa-f]?(?:_[0-9A-Fa-f])?"
    r"|#[0-9A-Fa-f]((?:[0-9A-Fa-f]{2}){0,64}))"
    r"(?:[ \t]+[RT])?[ \t]*$",
    re.ASCII,
)
_USUAL = re.compile(
    r"\((\d{1,12}\.\d{1,9})\)[ \t]+(\S+)[ \t]+([0-7][0-9A-Fa-f]{2})#([0-9A-Fa-f]{0,16})$", re.ASCII
)
"""What nearly all lines are, a standard identifier with classic data, is matched in half the time."""


def parse_candump_line(line: str, number: int = 0) -> CanFrame | None:
    """The frame of one line; None if the line is not one."""
    usual = _USUAL.match(line)
    if usual is not None:
        stamp, name, standard, data = usual.groups()
        if len(data) % 2 == 0:
            identifier, payload = int(standard, 16), bytes.fromhex(data)
            return CanFrame(float(stamp), name, identifier, False, False, False, False, payload, number)
    match = _LINE.match(line)
    if match is None:
        return None
    time_s, channel, standard, extended, data, remote, fd_data = match.groups()
    if standard is not None:
        identifier = int(standard, 16)
        if identifier > 0x7FF:
            return None
        is_extended = is_error = False
    else:
        identifier = int(extended, 16)
        is_error = bool(identifier & _ERROR_FLAG)
        # Bits 31 and 30 are SocketCAN's flags for extended and remote; candump leaves them out.
        is_extended = not is_error
        identifier &= _EXTENDED_MASK
    return CanFrame(
        float(time_s),
        channel,
        identifier,
        is_extended,
        fd_data is not None,
        is_error,
        remote is not None,
        bytes.fromhex(data or fd_data or ""),
        number,
    )


def read_candump(path: Path, note: Callable[[int, str], None]) -> Iterator[CanFrame]:
    """Frames of the file. A compressed file that is cut short or damaged ends there, which is noted."""
    number = 0
    parse = parse_candump_line
    with _open(path) as file:
        try:
            while line := file.readline(MAX_LINE_CHARS):
                number += 1
                frame = parse(line, number)
                if frame is not None:
                    yield frame
                elif line.strip():
                    note(number, f"not a candump line: {_show(line)}")
                    # A binary file may have no line end for as long as it goes: it must not fill the memory.
                    while len(line) == MAX_LINE_CHARS and line[-1] != "\n":
                        line = file.readline(MAX_LINE_CHARS)
        except EOFError:
            note(number + 1, "the compressed file is cut short")
        except (OSError, zlib.error) as error:
            note(number + 1, f"the file cannot be read on: {error}")


def _open(path: Path) -> IO[str]:
    # Latin-1 takes any byte; universal newlines take all line ends, also mixed.
    if path.name.lower().endswith(".gz"):
        return gzip.open(path, "rt", encoding="latin-1")
    return path.open(encoding="latin-1")


def _show(line: str) -> str:
    text = line.strip()
    text = text if len(text) <= 60 else text[:57] + "..."
    return repr(text)
