"""Lines of `candump -L` as arrays: what is alike is read at once.

In: whole lines of text. Out: a `FrameBlock`, and the lines that are no frames. Pure.

Lines of one length whose '#' stands in one place are read together. The grammar is that of
`log_candump`: the first of them is matched by its expression, which says where stamp, identifier and data
stand. Lines with digits there, and the same characters everywhere else, would match it in the same way. The
others are tried with a template of their own, and what is left goes through the line parser one by one. Where
it was built, compiled code (`_candump.c`) reads the commonest lines beforehand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tpmsd.foundation.kernels import loaded
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.sources.can.block import CLASSIC_BYTES, ERROR, FD, REMOTE, FrameBlock, block_of
from tpmsd.onboard.sources.can.candump_line import (
    ERROR_FLAG,
    EXTENDED_MASK,
    LINE,
    MAX_STANDARD,
    parse_candump_line,
)
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.can.signal_plan import EXTENDED

compiled = loaded("candump")

LONGEST_CHARS = 256
"""The longest line that is read in this way: CAN FD with 64 bytes takes about 170."""
MAX_SHAPES = 64
"""Lengths of line (with the column of the '#') that are read together, the commonest first."""
MAX_TEMPLATES = 8
"""Templates that are tried on the lines of one shape: channels, directions, flags of CAN FD."""
EXACT_BELOW = 9.0e15
"""Digits of a stamp are one integer; below 2^53 it is exact, and so is its division by a power of ten."""

_TENS = np.array([float(10**power) for power in range(22)])
_HEX = np.full(256, 255, dtype=np.uint8)
for _digit, _character in enumerate("0123456789abcdef"):
    _HEX[ord(_character)] = _HEX[ord(_character.upper())] = _digit

Bad = Callable[[int, str], None]
"""Called with a line's number and its text."""


@dataclass(frozen=True, slots=True)
class _Template:
    """Columns of the parts of a line: the stamp's digits, identifier, data, and the rest."""

    whole: NDArray[np.intp]
    fraction: NDArray[np.intp]
    identifier: NDArray[np.intp]
    data: NDArray[np.intp]
    other: NDArray[np.intp]
    channel: str
    flags: int


def _template(line: str) -> _Template | None:
    """Return the template of a line from its own columns; None if it is no frame."""
    match = LINE.match(line)
    if match is None:
        return None
    stamp, dot = match.span(1), line.index(".")
    identifier = match.span(3 if match[3] is not None else 4)
    fd = match[7] is not None
    data = match.span(7 if fd else 5) if fd or match[5] is not None else (0, 0)
    used = {dot: False}
    for first, last in (stamp, identifier, data):
        used.update((column, column != dot) for column in range(first, last))
    return _Template(
        np.arange(stamp[0], dot),
        np.arange(dot + 1, stamp[1]),
        np.arange(*identifier),
        np.arange(*data),
        np.array([column for column in range(len(line)) if not used.get(column, False)], dtype=np.intp),
        match[2],
        FD * fd + REMOTE * (match[6] is not None),
    )


class _LineTable:
    """A row per line, filled by and by."""

    def __init__(self, lines: int) -> None:
        self.found = np.zeros(lines, dtype=bool)
        self.time_s = np.zeros(lines)
        self.identifier = np.zeros(lines, dtype=np.uint32)
        self.flags = np.zeros(lines, dtype=np.uint8)
        self.size = np.zeros(lines, dtype=np.uint8)
        self.data = np.zeros((lines, CLASSIC_BYTES), dtype=np.uint8)
        self.channel = np.zeros(lines, dtype=np.intp)
        self.channels: dict[str, int] = {}

    def widen(self, size: int) -> None:
        """Make room for `size` bytes of data in each row: frames of CAN FD have up to 64."""
        if size > self.data.shape[1]:
            wider = np.zeros((len(self.data), size), dtype=np.uint8)
            wider[:, : self.data.shape[1]] = self.data
            self.data = wider

    def put(self, frames: list[CanFrame], at: list[int]) -> None:
        """Put frames into the rows `at`."""
        if not frames:
            return
        block = block_of(frames)
        self.widen(block.data.shape[1])
        numbers = np.array([self.channels.setdefault(name, len(self.channels)) for name in block.channels])
        self.time_s[at], self.identifier[at], self.flags[at] = block.time_s, block.identifier, block.flags
        self.size[at], self.channel[at] = block.size, numbers[block.channel]
        self.data[at, : block.data.shape[1]] = block.data
        self.found[at] = True

    def block(self, first_line: int) -> FrameBlock:
        """Return the rows that were filled; the first line given has the number `first_line`."""
        whole = FrameBlock(
            self.time_s,
            self.identifier,
            self.flags,
            self.size,
            self.data,
            self.channel,
            np.arange(first_line, first_line + len(self.found), dtype=np.int64),
            tuple(self.channels),
        )
        return whole if self.found.all() else whole.select(self.found)


def parse_lines(text: str, first_line: int, bad: Bad) -> FrameBlock:
    """Return the frames of whole lines (each with its line end); `bad` is called for each line that is none,
    blank ones aside, in their order."""
    raw = text.encode("latin-1")
    rows = _LineTable(raw.count(b"\n"))
    if _read_compiled(raw, rows):
        return rows.block(first_line)
    buffer = np.frombuffer(raw, dtype=np.uint8)
    ends = np.flatnonzero(buffer == ord("\n"))
    starts = np.concatenate([[0], ends[:-1] + 1])
    lengths, hash_columns = ends - starts, _hash_columns(buffer, starts, ends)
    readable = (hash_columns >= 0) & (lengths < LONGEST_CHARS) & ~rows.found
    shapes = np.where(readable, lengths * LONGEST_CHARS + hash_columns, 0)
    often = np.bincount(shapes)
    often[0] = 0
    for shape in np.argsort(-often, kind="stable")[:MAX_SHAPES].tolist():
        if not often[shape]:
            break
        _read_shape(buffer, raw, starts, np.flatnonzero(shapes == shape), shape // LONGEST_CHARS, rows)
    frames: list[CanFrame] = []
    at: list[int] = []
    for row in np.flatnonzero(~rows.found).tolist():
        line = text[starts[row] : ends[row]]
        frame = parse_candump_line(line, first_line + row)
        if frame is not None:
            frames.append(frame)
            at.append(row)
        elif line.strip():
            bad(first_line + row, line)
    rows.put(frames, at)
    return rows.block(first_line)


def _read_compiled(raw: bytes, rows: _LineTable) -> bool:
    """Fill the rows of the commonest lines on the channel of the first one; return whether those are all."""
    first = raw[: raw.index(b"\n")].decode("latin-1")
    match = LINE.match(first)
    if match is None or compiled is None:
        return False
    channel = match[2].encode("latin-1")
    found = compiled.lines(raw, channel, rows.found, rows.time_s, rows.identifier, rows.size, rows.data)
    if found:
        rows.channels[match[2]] = 0
    return bool(found == len(rows.found))


def _hash_columns(
    buffer: NDArray[np.uint8], starts: NDArray[np.intp], ends: NDArray[np.intp]
) -> NDArray[np.intp]:
    """Return (lines,) the column of the first '#' in each line; -1 where there is none."""
    hashes = np.flatnonzero(buffer == ord("#"))
    if len(hashes) == len(starts) and bool(np.all((hashes > starts) & (hashes < ends))):
        return hashes - starts
    first = np.append(hashes, len(buffer))[np.searchsorted(hashes, starts)]
    return np.where(first < ends, first - starts, -1)


def _read_shape(
    buffer: NDArray[np.uint8],
    raw: bytes,
    starts: NDArray[np.intp],
    lines: NDArray[np.intp],
    length: int,
    rows: _LineTable,
) -> None:
    """Fill the rows of `lines`, all of one length and one column of the '#', by at most `MAX_TEMPLATES`
    templates."""
    for _ in range(MAX_TEMPLATES):
        if not len(lines):
            return
        begin = starts[lines[0]]
        template = _template(raw[begin : begin + length].decode("latin-1"))
        if template is None:
            lines = lines[1:]
            continue
        # Column by column: what is done to one character of all lines then goes over neighbouring bytes.
        text = np.ascontiguousarray(sliding_window_view(buffer, length)[starts[lines]].T)
        lines = lines[~_read_same_form(text, lines, template, rows)]


def _read_same_form(
    text: NDArray[np.uint8], lines: NDArray[np.intp], template: _Template, rows: _LineTable
) -> NDArray[np.bool_]:
    """Fill the rows of those lines (n,) that fit the template; return (n,) flags of them. `text` (length,
    n)."""
    digits = text[np.concatenate([template.whole, template.fraction])] - ord("0")
    nibbles = _HEX[text[np.concatenate([template.identifier, template.data])]]
    other = text[template.other]
    fits: NDArray[np.bool_] = (digits <= 9).all(axis=0)
    fits &= (nibbles < 16).all(axis=0)
    fits &= (other == other[:, :1]).all(axis=0)
    width = len(template.identifier)
    identifier = np.zeros(len(lines), dtype=np.int64)
    for nibble in nibbles[:width]:
        identifier = identifier << 4 | nibble
    if width == 3:
        fits &= identifier <= MAX_STANDARD
        flags = np.full(len(lines), template.flags)
    else:
        error = identifier & ERROR_FLAG != 0
        flags = template.flags + ERROR * error
        identifier = identifier & EXTENDED_MASK | np.where(error, 0, EXTENDED)
    fit = slice(None) if fits.all() else fits
    at = lines[fit]
    size = len(template.data) // 2
    rows.widen(size)
    rows.found[at] = True
    rows.time_s[at] = _stamps(text[:, fit], digits[:, fit], template)
    rows.identifier[at] = identifier[fit]
    rows.flags[at] = flags[fit]
    rows.size[at] = size
    rows.channel[at] = rows.channels.setdefault(template.channel, len(rows.channels))
    if size:
        rows.data[at, :size] = (nibbles[width::2] << 4 | nibbles[width + 1 :: 2])[:, fit].T
    return fits


def _stamps(text: NDArray[np.uint8], digits: NDArray[np.uint8], template: _Template) -> FloatArray:
    """Return the (n,) time stamps, s, exactly as `float` reads them; `text` (length, n), `digits` (d, n)."""
    count = len(digits)
    whole = _TENS[count - 1 :: -1] @ digits.astype(np.float64)
    if bool((whole < EXACT_BELOW).all()):
        return np.asarray(whole / _TENS[len(template.fraction)])
    stamps = np.ascontiguousarray(text[template.whole[0] : template.fraction[-1] + 1].T)
    return np.array([float(stamp) for stamp in stamps.view(f"S{count + 1}").ravel()])
