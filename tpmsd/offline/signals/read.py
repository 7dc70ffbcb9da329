"""Tables of signals from files: `signals.csv`, `signals.csv.gz` or `signals.parquet` in a drive folder.

In: a folder or a file. Out: `SignalTable`; InputError with file, line and reason where it cannot be used.
"""

from __future__ import annotations

import csv
import gzip
import io
import math
import zlib
from array import array
from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from tpmsd.car.config.problems import escaped_lines
from tpmsd.foundation.errors import InputError
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.signals.columns import FILES, TIME, is_known, signals_file
from tpmsd.offline.tables.native import MAX_COLUMNS, NativeTable

LARGEST_BYTES = 500_000_000
"""Text that is read of a file at most, unpacked."""
MAX_VALUES = 64_000_000
"""Numbers kept of a file in CSV: 512 MB, two hours of eight columns at 1 kHz."""
LONGEST_LINE = 1 << 20
_BLOCK_CHARS = 1 << 22
LARGEST_VALUE = 1e12
"""Times since any epoch and Pascals lie below; squares of readings stay finite."""
_EMPTY = {"", "nan", "NaN", "NA", "null"}


@dataclass(frozen=True)
class SignalTable:
    """Columns of one length by name, empty cells NaN; rows in the order of time, each time once."""

    file: Path
    columns: Mapping[str, FloatArray]
    unknown: tuple[str, ...] = ()
    """Columns that were left out."""

    @property
    def time_s(self) -> FloatArray:
        """Return the times of the rows on the recording's own clock."""
        return self.columns[TIME]


def read_signals(path: Path) -> SignalTable:
    """Return the table in a file, or in a drive folder."""
    file = signals_file(path) if path.is_dir() else path
    if file is None:
        raise InputError(path, f"no table of signals ({' '.join(FILES)})")
    if not file.is_file():
        raise InputError(file, "no such file")
    names, table = _read_parquet(file) if file.suffix == ".parquet" else _read_csv(file)
    _check_rises(file, table)
    return _sort_rows(file, table, tuple(escaped_lines(name) for name in names if not is_known(name)))


def _check_names(file: Path, names: list[str]) -> None:
    """Raise InputError unless each column has a name of its own, and one of them is the time."""
    if len(names) > MAX_COLUMNS:
        raise InputError(file, f"{len(names)} columns; at most {MAX_COLUMNS} are read", 1)
    if TIME not in names:
        raise InputError(file, f"no column {TIME}", 1)
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(file, escaped_lines(f"column {twice} stands twice"), 1)


def _check_rises(file: Path, table: dict[str, FloatArray]) -> None:
    """Check that the times of each known column never descend; InputError with the line of the first that
    does. Columns may stand below one another, each with times of its own."""
    time = table[TIME]
    rows = []
    for name, values in table.items():
        there = np.flatnonzero(np.isfinite(values) & np.isfinite(time))
        falls = np.flatnonzero(np.diff(time[there]) < 0.0)
        if name != TIME and len(falls):
            rows.append((int(there[falls[0] + 1]), float(time[there[falls[0]]]), name))
    if rows:
        row, before_s, name = min(rows)
        reason = f"{TIME} of {name} descends from {before_s:g} to {time[row]:g}"
        if file.suffix == ".parquet":
            raise InputError(file, f"row {row + 1}: {reason}")
        raise InputError(file, reason, _line_of_row(file, row))


def _line_of_row(file: Path, row: int) -> int:
    """Return the line of a row of values."""
    for first, block in islice(_text_blocks(file), 1, None):
        lines = [first + k for k, line in enumerate(block.split("\n")) if line.strip()]
        if row < len(lines):
            return lines[row]
        row -= len(lines)
    raise InputError(file, "changed while it was read")


def _sort_rows(file: Path, table: dict[str, FloatArray], unknown: tuple[str, ...]) -> SignalTable:
    """Return the table with rows in the order of time; rows of one time are merged."""
    time = table[TIME]
    good = np.isfinite(time)
    if good.sum() < 2:
        raise InputError(file, "fewer than two rows with a time")
    order = np.flatnonzero(good)[np.argsort(time[good], kind="stable")]
    kept = {name: values[order] for name, values in table.items()}
    first = np.concatenate([[True], np.diff(kept[TIME]) > 1e-9])
    if not first.all():
        group = np.cumsum(first) - 1
        merged: dict[str, FloatArray] = {}
        for name, values in kept.items():
            out = np.full(int(group[-1]) + 1, np.nan)
            there = np.isfinite(values)
            out[group[there]] = values[there]
            merged[name] = out
        kept = merged
    return SignalTable(file, kept, unknown)


def _text_blocks(file: Path) -> Generator[tuple[int, str]]:
    """Yield the header, then blocks of whole lines, each with the number of its first line; line ends are
    unified.

    InputError for what cannot be read, is no text, or is too large unpacked.
    """
    number, total, most = 1, 0, 0
    try:
        with gzip.open(file) if file.suffix == ".gz" else file.open("rb") as packed:
            lines = io.TextIOWrapper(packed, encoding="utf-8-sig")
            while block := lines.read(most) + lines.readline(LONGEST_LINE):
                total += len(block)
                if total > LARGEST_BYTES:
                    raise InputError(file, f"more than {LARGEST_BYTES} characters, unpacked")
                if len(block) >= most + LONGEST_LINE:
                    line = number + block.count("\n")
                    raise InputError(file, f"a line of more than {LONGEST_LINE} characters", line)
                yield number, block
                number, most = number + block.count("\n"), _BLOCK_CHARS
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or str(error) or "cannot be read"
        raise InputError(file, f"cannot be read: {reason}") from None


def _read_csv(file: Path) -> tuple[list[str], dict[str, FloatArray]]:
    """Return the names of all columns of a CSV file, and the values of those that are known."""
    with closing(_text_blocks(file)) as blocks:
        _, head = next(blocks, (1, ""))
        names = [name.strip().strip('"') for name in head.split(",")]
        _check_names(file, names)
        known = [k for k, name in enumerate(names) if is_known(name)]
        parts: list[FloatArray] = []
        left = MAX_VALUES
        for first, block in blocks:
            if not block.strip():
                continue
            quick = _parse_plain_block(block, len(names))
            values = _parse_block(file, first, block, names, known) if quick is None else quick[:, known]
            _check_magnitudes(file, values, parts, [names[k] for k in known])
            parts.append(values)
            left -= values.size
            if left < 0:
                raise InputError(file, f"more than {MAX_VALUES} values", first)
    if not parts:
        raise InputError(file, "no rows")
    table = np.concatenate(parts)
    return names, {names[k]: table[:, column] for column, k in enumerate(known)}


def _check_magnitudes(
    file: Path, values: FloatArray, before: Sequence[FloatArray], names: Sequence[str]
) -> None:
    """Raise InputError with the line of a value that is infinite or larger than a reading can be."""
    rows, columns = np.nonzero(np.abs(values) > LARGEST_VALUE)
    if len(rows):
        finite = np.isfinite(values[rows[0], columns[0]])
        reason = _too_large_message(names[columns[0]]) if finite else "is infinite"
        line = _line_of_row(file, sum(map(len, before)) + int(rows[0]))
        raise InputError(file, f"{names[columns[0]]} {reason}", line)


def _too_large_message(name: str) -> str:
    """Return what is wrong with a value that is too large: for a time, probably the unit."""
    hint = ": milliseconds or less since 1970? It is in seconds" if name == TIME else ""
    return f"is beyond {LARGEST_VALUE:g}{hint}"


def _parse_plain_block(block: str, width: int) -> FloatArray | None:
    """Return the values of a block of plain numbers without an empty cell; None where there is
    anything else.
    """
    try:
        values = np.loadtxt(io.StringIO(block), delimiter=",", ndmin=2, comments=None)
    except ValueError:
        return None
    return values if values.shape[1] == width else None


def _parse_block(
    file: Path, first: int, block: str, names: Sequence[str], known: Sequence[int]
) -> FloatArray:
    """Return the known columns cell by cell, empty ones NaN; InputError with the line of a cell that is no
    number.
    """
    values = array("d")
    for line, text in enumerate(block.split("\n"), first):
        if not text.strip():
            continue
        try:
            cells = next(csv.reader([text]))
        except csv.Error as error:
            raise InputError(file, f"not CSV: {error}", line) from None
        if len(cells) != len(names):
            raise InputError(file, f"{len(cells)} cells, the header has {len(names)}", line)
        try:
            values.extend([math.nan if cells[k].strip() in _EMPTY else float(cells[k]) for k in known])
        except ValueError:
            bad = next(cells[k] for k in known if not _is_number(cells[k]))
            raise InputError(file, f"{bad[:40]!r} is not a number", line) from None
    return np.array(values, dtype=np.float64).reshape(-1, len(known))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell.strip() in _EMPTY
    return True


def _read_parquet(file: Path) -> tuple[list[str], dict[str, FloatArray]]:
    """Return the names of all columns of a Parquet file, and the values of those that are known, read in a
    process of its own."""
    with closing(NativeTable(file)) as table:
        names = list(table.names)
        _check_names(file, names)
        known = {name: table.column(name) for name in names if is_known(name)}
    for name, values in known.items():
        if not len(values):
            raise InputError(file, "no rows")
        if len(beyond := np.flatnonzero(np.abs(values) > LARGEST_VALUE)):
            raise InputError(file, escaped_lines(f"row {beyond[0] + 1}: {name} {_too_large_message(name)}"))
    return names, known
