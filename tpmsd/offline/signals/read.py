"""Tables of signals from files: `signals.csv`, `signals.csv.gz` or `signals.parquet` in a drive folder.

In: a folder or a file. Out: `SignalTable`; InputError with file, line and reason where it cannot be used.
"""

from __future__ import annotations

import csv
import gzip
import io
import zlib
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tpmsd.car.config.problems import escaped_lines
from tpmsd.foundation.errors import InputError
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.signals.columns import TIME, is_known
from tpmsd.offline.tables.native import NativeTable

FILES = ("signals.csv", "signals.csv.gz", "signals.parquet")
"""Names in a drive folder, in the order in which they are looked for."""
LARGEST_BYTES = 2_000_000_000
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


def signals_file(folder: Path) -> Path | None:
    """Return the table of signals in a drive folder; None where there is none."""
    return next((folder / name for name in FILES if (folder / name).is_file()), None)


def read_signals(path: Path) -> SignalTable:
    """Return the table in a file, or in a drive folder."""
    file = signals_file(path) if path.is_dir() else path
    if file is None:
        raise InputError(path, f"no table of signals ({' '.join(FILES)})")
    if not file.is_file():
        raise InputError(file, "no such file")
    names, values = _parquet(file) if file.suffix == ".parquet" else _text(file)
    if TIME not in names:
        raise InputError(file, f"no column {TIME}", 1)
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(file, escaped_lines(f"column {twice} stands twice"), 1)
    table = dict(zip(names, values.T, strict=True))
    _check_rises(file, table)
    return _ordered(file, table)


def _check_rises(file: Path, table: dict[str, FloatArray]) -> None:
    """Check that the times of each known column never descend; InputError with the line of the first that
    does. Columns may stand below one another, each with times of its own."""
    time = table[TIME]
    rows = []
    for name, values in table.items():
        there = np.flatnonzero(np.isfinite(values) & np.isfinite(time))
        falls = np.flatnonzero(np.diff(time[there]) < 0.0)
        if is_known(name) and name != TIME and len(falls):
            rows.append((int(there[falls[0] + 1]), float(time[there[falls[0]]]), name))
    if rows:
        row, before_s, name = min(rows)
        reason = f"{TIME} of {name} descends from {before_s:g} to {time[row]:g}"
        if file.suffix == ".parquet":
            raise InputError(file, f"row {row + 1}: {reason}")
        raise InputError(file, reason, _line_of(_content(file), row))


def _line_of(text: str, row: int) -> int:
    """Return the line of a row of values."""
    lines = (number for number, line in enumerate(text.split("\n"), 1) if number > 1 and line.strip())
    return next(number for k, number in enumerate(lines) if k == row)


def _ordered(file: Path, table: dict[str, FloatArray]) -> SignalTable:
    """Return the known columns with rows in the order of time; rows of one time become one."""
    time = table[TIME]
    good = np.isfinite(time)
    if good.sum() < 2:
        raise InputError(file, "fewer than two rows with a time")
    order = np.flatnonzero(good)[np.argsort(time[good], kind="stable")]
    unknown = tuple(escaped_lines(name) for name in table if not is_known(name))
    kept = {name: values[order] for name, values in table.items() if is_known(name)}
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


def _content(file: Path) -> str:
    """Return the text of a CSV file, gzipped or not."""
    try:
        if file.stat().st_size > LARGEST_BYTES:
            raise InputError(file, "larger than 2 GB")
        with gzip.open(file) if file.suffix == ".gz" else file.open("rb") as content:
            data = content.read(LARGEST_BYTES + 1)
        if len(data) > LARGEST_BYTES:
            raise InputError(file, f"unpacks to more than {LARGEST_BYTES} bytes")
        return data.decode("utf-8-sig")
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or str(error) or "cannot be read"
        raise InputError(file, f"cannot be read: {reason}") from None


def _text(file: Path) -> tuple[list[str], FloatArray]:
    """Return header and values of a CSV file."""
    text = _content(file)
    head, _, body = text.partition("\n")
    names = [name.strip().strip('"') for name in head.rstrip("\r").split(",")]
    quick = _quick(body, len(names))
    values = quick if quick is not None else _careful(file, text, len(names))
    rows, columns = np.nonzero(np.abs(values) > LARGEST_VALUE)
    if len(rows):
        name, value = names[columns[0]], values[rows[0], columns[0]]
        reason = f"is beyond {LARGEST_VALUE:g}" if np.isfinite(value) else "is infinite"
        raise InputError(file, escaped_lines(f"{name} {reason}"), _line_of(text, int(rows[0])))
    return names, values


def _quick(body: str, width: int) -> FloatArray | None:
    """Return the values of plain numbers without an empty cell; None where there is anything else."""
    if not body.strip():
        return None
    try:
        values = np.loadtxt(io.StringIO(body), delimiter=",", ndmin=2)
    except ValueError:
        return None
    return values if values.ndim == 2 and values.shape[1] == width and len(values) else None


def _careful(file: Path, text: str, width: int) -> FloatArray:
    """Return the values cell by cell, empty ones NaN; InputError with the line of a cell that is no
    number."""
    rows: list[list[float]] = []
    for line, cells in enumerate(csv.reader(io.StringIO(text)), start=1):
        if line == 1 or not cells:
            continue
        if len(cells) != width:
            raise InputError(file, f"{len(cells)} cells, the header has {width}", line)
        try:
            rows.append([float("nan") if cell.strip() in _EMPTY else float(cell) for cell in cells])
        except ValueError:
            bad = next(cell for cell in cells if not _is_number(cell))
            raise InputError(file, f"{bad[:40]!r} is not a number", line) from None
    if not rows:
        raise InputError(file, "no rows")
    return np.array(rows)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell.strip() in _EMPTY
    return True


def _parquet(file: Path) -> tuple[list[str], FloatArray]:
    """Return names and values of a Parquet file's columns, read in a process of its own; those of columns
    that are not known are NaN."""
    with closing(NativeTable(file)) as table:
        names = list(table.names)
        known = {name: table.column(name) for name in names if name == TIME or is_known(name)}
    rows = max((len(values) for values in known.values()), default=0)
    if not rows:
        raise InputError(file, f"no rows, or no column {TIME}")
    nothing = np.full(rows, np.nan)
    for name, values in known.items():
        if len(beyond := np.flatnonzero(np.abs(values) > LARGEST_VALUE)):
            raise InputError(file, escaped_lines(f"row {beyond[0] + 1}: {name} is beyond {LARGEST_VALUE:g}"))
    return names, np.stack([known.get(name, nothing) for name in names], axis=1)
