"""Users' tables: CSV, Parquet, MF4 and MATLAB v7.3, column by column.

In: a path by its suffix. Out: `Table`: the names of its columns, and each as an array; InputError (file, line
where there are lines, reason) where it cannot be read. CSV and Parquet have one time column for all; the
signals of MF4 bring their own times; those of HDF5 files name the data set with theirs.
"""

from __future__ import annotations

import contextlib
import csv
import math
from array import array
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from tpmsd.foundation.errors import InputError
from tpmsd.foundation.lean import bring_in_mf4
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.tables.extras import need
from tpmsd.offline.tables.write import SCHEMA, SCHEMA_KEY, VEHICLE_KEY
from tpmsd.onboard.sources.can_log_others import opened_quietly
from tpmsd.onboard.sources.packed_bounds import check_mf4

SUFFIXES = (".csv", ".tsv", ".txt", ".parquet", ".mf4", ".mdf", ".mat", ".h5", ".hdf5")
NOTHING = frozenset(("", "nan", "na", "n/a", "null", "none", "-"))
MAX_FIELD_CHARS = 10_000


class Table(Protocol):
    """A table, whatever its file."""

    names: tuple[str, ...]
    vehicle_toml: str | None
    """The car's configuration, where the table brings it."""

    def column(self, name: str) -> FloatArray:
        """(n,) numbers of a column, NaN where there is none."""
        ...

    def own_time(self, name: str) -> FloatArray | None:
        """(n,) seconds at which a signal was read, where it brings its own times."""
        ...


def read_table(path: Path, wanted: Iterable[str] | None = None) -> Table:
    """Open a table; of CSV only the columns in `wanted` are kept (None: all)."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(path, f"not a known kind of table; known are {' '.join(SUFFIXES)}")
    if not path.is_file():
        raise InputError(path, "is a folder" if path.is_dir() else "no such file")
    try:
        if suffix == ".parquet":
            return ParquetTable(path)
        if suffix in (".mf4", ".mdf"):
            return Mf4Table(path)
        if suffix in (".mat", ".h5", ".hdf5"):
            return Hdf5Table(path)
        return CsvTable(path, None if wanted is None else frozenset(wanted))
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from None


class CsvTable:
    """Comma, semicolon or tab; a header line; a decimal comma where the comma does not separate."""

    def __init__(self, path: Path, wanted: frozenset[str] | None) -> None:
        self.path = path
        self.vehicle_toml: str | None = None
        columns: dict[str, array[float]] = {}
        try:
            with path.open(encoding="utf-8-sig", newline="") as file:
                first = file.readline(1 << 20)
                mark = max(",;\t", key=first.count)
                header = [name.strip() for name in next(csv.reader([first], delimiter=mark), [])]
                self.names = tuple(header)
                if not first.strip() or len(set(header)) < len(header):
                    raise InputError(path, "no header, or two columns of one name", 1)
                kept = [k for k, name in enumerate(header) if wanted is None or name in wanted]
                columns = {header[k]: array("d") for k in kept}
                places = [(k, columns[header[k]]) for k in kept]
                csv.field_size_limit(MAX_FIELD_CHARS)
                for number, row in enumerate(csv.reader(file, delimiter=mark), 2):
                    if not row:
                        continue
                    if len(row) != len(header):
                        raise InputError(path, f"{len(row)} fields, the header has {len(header)}", number)
                    for k, column in places:
                        column.append(_number(row[k], mark, path, number, header[k], wanted is None))
        except UnicodeDecodeError:
            raise InputError(path, "not UTF-8 text") from None
        except csv.Error as error:
            raise InputError(path, f"not CSV: {error}") from None
        self._columns = columns

    def column(self, name: str) -> FloatArray:
        """The column."""
        return np.array(self._columns[name], dtype=np.float64)

    def own_time(self, name: str) -> FloatArray | None:
        """None: all columns share one."""
        return None


def _number(text: str, mark: str, path: Path, line: int, name: str, lenient: bool) -> float:
    """A field; `lenient`: texts of columns that nobody asked for are no numbers, and no error."""
    try:
        return float(text)
    except ValueError:
        pass
    if text.strip().casefold() in NOTHING:
        return math.nan
    try:
        return float(text.replace(",", ".") if mark != "," else "x")
    except ValueError:
        if lenient:
            return math.nan
        raise InputError(path, f"{name}: not a number: {text[:40]!r}", line) from None


class ParquetTable:
    """A Parquet file; those of `tpmsd replay --parquet` bring the car's configuration."""

    def __init__(self, path: Path) -> None:
        parquet = need("pyarrow.parquet", "tables", "Parquet files")
        arrow = need("pyarrow", "tables", "Parquet files")
        self.path = path
        try:
            self._file = parquet.ParquetFile(str(path))
        except arrow.ArrowException as error:
            raise InputError(path, f"not a Parquet file: {' '.join(str(error).split())[:200]}") from None
        self.names: tuple[str, ...] = tuple(self._file.schema_arrow.names)
        told = self._file.schema_arrow.metadata or {}
        ours = told.get(SCHEMA_KEY) == SCHEMA.encode()
        self.vehicle_toml = told[VEHICLE_KEY].decode() if ours and VEHICLE_KEY in told else None

    def column(self, name: str) -> FloatArray:
        """The column; InputError where it holds no numbers."""
        return _floats(self._file.read(columns=[name]).column(0).to_numpy(), self.path, name)

    def own_time(self, name: str) -> FloatArray | None:
        """None: all columns share one."""
        return None


class Mf4Table:
    """A measurement file of the automotive industry (ASAM MDF 4), by asammdf."""

    def __init__(self, path: Path) -> None:
        with contextlib.suppress(ImportError):
            bring_in_mf4()  # the command line leaves it out of what it imports
        asammdf = need("asammdf", "mf4", "MF4 files")
        self.path = path
        self.vehicle_toml: str | None = None
        try:
            with path.open("rb") as file:
                check_mf4(file)
            self._file: Any = opened_quietly(lambda: asammdf.MDF(str(path)))
        except ValueError as error:
            raise InputError(path, f"not an MF4 file: {' '.join(str(error).split())[:200]}") from None
        self._start_s = self._file.start_time.timestamp()
        self.names: tuple[str, ...] = tuple(self._file.channels_db)
        self._signals: dict[str, Any] = {}

    def column(self, name: str) -> FloatArray:
        """The signal's values; InputError where they are no numbers."""
        return _floats(self._signal(name).samples, self.path, name)

    def own_time(self, name: str) -> FloatArray | None:
        """Unix seconds of the signal's readings."""
        since_s: FloatArray = np.asarray(self._signal(name).timestamps, dtype=np.float64)
        made: FloatArray = since_s + float(self._start_s)
        return made

    def _signal(self, name: str) -> Any:
        if name not in self._signals:
            places = self._file.channels_db[name]
            group, index = places[0]
            self._signals[name] = self._file.get(group=group, index=index)
        return self._signals[name]


class Hdf5Table:
    """An HDF5 file such as MATLAB's `save -v7.3` writes; names are paths like `log/t`."""

    def __init__(self, path: Path) -> None:
        h5py = need("h5py", "tables", "MATLAB v7.3 files")
        self.path = path
        self.vehicle_toml: str | None = None
        names: list[str] = []

        def visit(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset):
                names.append(name)

        try:
            self._file = h5py.File(path, "r")
            self._file.visititems(visit)
        except OSError:
            reason = "not an HDF5 file (older MATLAB files: save again with -v7.3)"
            raise InputError(path, reason) from None
        self.names = tuple(names)

    def column(self, name: str) -> FloatArray:
        """The data set, rows and columns of vectors alike; InputError where it is no vector of numbers."""
        values = np.asarray(self._file[name])
        if values.ndim > 1 and max(values.shape, default=0) == values.size:
            values = values.reshape(-1)
        return _floats(values, self.path, name)

    def own_time(self, name: str) -> FloatArray | None:
        """None: the map names the data set with the times."""
        return None


def _floats(values: Any, path: Path, name: str) -> FloatArray:
    try:
        numbers = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(path, f"{name}: not numbers") from None
    if numbers.ndim != 1:
        raise InputError(path, f"{name}: shape {numbers.shape}, a column is wanted")
    return numbers
