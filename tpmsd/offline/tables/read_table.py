"""Users' tables: CSV, Parquet, MF4 and MATLAB v7.3, column by column.

In: a path by its suffix. Out: `InputTable`: the names of its columns, and each as an array; InputError (file,
line where there are lines, reason) where it cannot be read. CSV and Parquet have one time column for all; the
signals of MF4 bring their own times; those of HDF5 files name the data set with theirs.
"""

from __future__ import annotations

import csv
import math
from array import array
from collections.abc import Iterable
from pathlib import Path
from typing import Protocol, TextIO

import numpy as np

from tpmsd.foundation.errors import InputError
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.tables.native import MAX_COLUMNS, MAX_VALUES, NativeTable

TEXT_SUFFIXES = (".csv", ".tsv", ".txt")
SUFFIXES = (*TEXT_SUFFIXES, ".parquet", ".mf4", ".mdf", ".mat", ".h5", ".hdf5")
NOTHING = frozenset(("", "nan", "na", "n/a", "null", "none", "-"))
MAX_FIELD_CHARS = 10_000
MAX_LINE_CHARS = 1 << 20
"""Length of a row, and of the header, at most."""


class InputTable(Protocol):
    """A table, whatever its file."""

    names: tuple[str, ...]
    vehicle_toml: str | None
    """The car's configuration, where the table brings it."""

    def column(self, name: str) -> FloatArray:
        """Return the (n,) numbers of a column, NaN for an empty cell."""
        ...

    def own_time(self, name: str) -> FloatArray | None:
        """Return the (n,) seconds at which a signal was read; None where it has no times of its own."""
        ...

    def line(self, row: int) -> int | None:
        """Return the line of a row in the file; None where the file is no text."""
        ...

    def close(self) -> None:
        """Close the file."""
        ...


def read_table(path: Path, wanted: Iterable[str] | None = None) -> InputTable:
    """Open a table; of CSV only the columns in `wanted` are kept (None: all)."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(path, f"not a known kind of table; known are {' '.join(SUFFIXES)}")
    if not path.is_file():
        raise InputError(path, "is a folder" if path.is_dir() else "no such file")
    try:
        if suffix in TEXT_SUFFIXES:
            return CsvTable(path, None if wanted is None else frozenset(wanted))
        return NativeTable(path)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from None


class CsvTable:
    """Comma, semicolon or tab; a header line; a decimal comma where the comma does not separate."""

    def __init__(self, path: Path, wanted: frozenset[str] | None) -> None:
        self.path = path
        self.vehicle_toml: str | None = None
        columns: dict[str, array[float]] = {}
        self._lines = array("q")
        try:
            with path.open(encoding="utf-8-sig", newline="") as file:
                lines = _Lines(file, path)
                first = next(lines, "")
                delimiter = max(",;\t", key=first.count)
                header = [name.strip() for name in next(csv.reader([first], delimiter=delimiter), [])]
                self.names = tuple(header)
                if not first.strip() or len(set(header)) < len(header):
                    raise InputError(path, "no header, or two columns of one name", 1)
                if len(header) > MAX_COLUMNS:
                    raise InputError(path, f"{len(header)} columns; at most {MAX_COLUMNS} are read", 1)
                kept = [k for k, name in enumerate(header) if wanted is None or name in wanted]
                columns = {header[k]: array("d") for k in kept}
                kept_columns = [(k, columns[header[k]]) for k in kept]
                csv.field_size_limit(MAX_FIELD_CHARS)
                most = MAX_VALUES // max(len(kept), 1)
                for number, row in enumerate(csv.reader(lines, delimiter=delimiter), 2):
                    lines.end_row()
                    if number > most + 1:
                        reason = f"more than {most} rows; of a table at most {MAX_VALUES} values are read"
                        raise InputError(path, reason, number)
                    if not row:
                        continue
                    if len(row) != len(header):
                        raise InputError(path, f"{len(row)} fields, the header has {len(header)}", number)
                    self._lines.append(lines.number)
                    for k, column in kept_columns:
                        column.append(
                            _parse_number(row[k], delimiter, path, number, header[k], wanted is None)
                        )
        except UnicodeDecodeError:
            raise InputError(path, "not UTF-8 text") from None
        except csv.Error as error:
            raise InputError(path, f"not CSV: {error}") from None
        self._columns = columns

    def column(self, name: str) -> FloatArray:
        """Return the column."""
        return np.array(self._columns[name], dtype=np.float64)

    def own_time(self, name: str) -> FloatArray | None:
        """Return None: all columns share one."""
        return None

    def line(self, row: int) -> int | None:
        """Return the line at which a row ends, in the file."""
        return self._lines[row]

    def close(self) -> None:
        """Do nothing: no file is open."""


class _Lines:
    """Lines of a file; InputError where a row, which quoted fields may spread over lines, is too long."""

    def __init__(self, file: TextIO, path: Path) -> None:
        self._file, self._path = file, path
        self.number = self._chars = 0

    def __iter__(self) -> _Lines:
        return self

    def __next__(self) -> str:
        line = self._file.readline(MAX_LINE_CHARS + 1 - self._chars)
        self.number += 1
        self._chars += len(line)
        if self._chars > MAX_LINE_CHARS:
            raise InputError(self._path, f"a row of more than {MAX_LINE_CHARS} characters", self.number)
        if not line:
            raise StopIteration
        return line

    def end_row(self) -> None:
        """Note that a row is complete: the next may be as long again."""
        self._chars = 0


def _parse_number(text: str, delimiter: str, path: Path, line: int, name: str, lenient: bool) -> float:
    """Parse a cell, with a decimal comma too; NaN for an empty one, and for any text if `lenient`."""
    try:
        return float(text)
    except ValueError:
        pass
    if text.strip().casefold() in NOTHING:
        return math.nan
    try:
        return float(text.replace(",", ".") if delimiter != "," else "x")
    except ValueError:
        if lenient:
            return math.nan
        raise InputError(path, f"{name}: not a number: {text[:40]!r}", line) from None
