"""Parquet, MF4 and MATLAB v7.3 tables, read by native libraries in a process of its own.

In: a path. Out: `NativeTable`, whose columns come from a child with limits of memory and time. How many
values a column has is known from the file's own directory before anything is unpacked, and bounded. HDF5 data
that lies in other files (external storage, virtual data sets, links) is refused: a table must not bring bytes
of files that its sender could not read.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from tpmsd.foundation.child_reader import ChildReader, ChildReadError, Send, installed, limit
from tpmsd.foundation.errors import ConfigError, InputError
from tpmsd.foundation.startup import bring_in_mf4
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.tables.extras import not_installed_message
from tpmsd.offline.tables.write import SCHEMA, SCHEMA_KEY, VEHICLE_KEY
from tpmsd.onboard.sources.can.packed_bounds import check_mf4

MAX_VALUES = 16_000_000
"""Rows times columns that are read; 128 MB of numbers, nine hours of 5 columns at 100 Hz."""
MAX_COLUMNS = 10_000
_PACKAGES = {
    ".parquet": ("pyarrow.parquet", "tables", "Parquet files"),
    ".mf4": ("asammdf", "mf4", "MF4 files"),
    ".mat": ("h5py", "tables", "MATLAB v7.3 files"),
}
_KIND = {".mdf": ".mf4", ".h5": ".mat", ".hdf5": ".mat"}
_NOT = {
    ".parquet": "not a Parquet file",
    ".mf4": "not an MF4 file",
    ".mat": "not an HDF5 file (older MATLAB files: save again with -v7.3)",
}


class NativeTable:
    """A table in a child process."""

    def __init__(self, path: Path) -> None:
        kind = _KIND.get(path.suffix.lower(), path.suffix.lower())
        module, extra, what = _PACKAGES[kind]
        if not installed(module):
            raise ConfigError(not_installed_message(module, extra, what))
        self.path = path
        self._left = MAX_VALUES
        self._has_times = kind == ".mf4"
        self._cached: dict[tuple[str, str], FloatArray] = {}
        self._child = ChildReader(f"{__name__}:serve_table", path)
        try:
            self._child.ask(kind)
            opened = json.loads(self._receive())
        except InputError as error:
            self.close()
            raise InputError(path, f"{_NOT[kind]}: {error.reason}") from None
        self.names: tuple[str, ...] = tuple(opened["names"])
        self.vehicle_toml: str | None = opened["vehicle_toml"]

    def column(self, name: str) -> FloatArray:
        """Return the column; InputError where it holds no numbers, or more than are read."""
        return self._child_array("column", name)

    def own_time(self, name: str) -> FloatArray | None:
        """Return the (n,) seconds at which a signal was read; None where it has no times of its own."""
        return self._child_array("time", name) if self._has_times else None

    def line(self, row: int) -> int | None:
        """Return None: the file has no lines."""
        return None

    def close(self) -> None:
        """End the child process."""
        self._child.close()

    def _child_array(self, what: str, name: str) -> FloatArray:
        """Return a column, or a signal's own times, from the child; cached."""
        if (what, name) not in self._cached:
            try:
                self._child.ask(json.dumps([what, name, self._left]))
            except ChildReadError as error:
                raise InputError(self.path, str(error)) from None
            values = np.frombuffer(self._receive(), dtype=np.float64)
            self._left -= len(values)
            self._cached[what, name] = values
        return self._cached[what, name]

    def _receive(self) -> bytes:
        try:
            return self._child.receive() or b""
        except ChildReadError as error:
            raise InputError(self.path, str(error)) from None


class _NativeTable(Protocol):
    """A table in the child."""

    names: tuple[str, ...]
    vehicle_toml: str | None

    def size(self, name: str) -> int:
        """Return the number of values of a column, before it is read; ValueError where it cannot be one."""
        ...

    def column(self, name: str) -> Any:
        """Return the values of a column."""
        ...

    def own_time(self, name: str) -> Any:
        """Return the signal's own times; None where it has none."""
        ...


def serve_table(path: Path, requests: Iterator[str], send: Send) -> None:
    """Serve a table as the child: names first, then each column that is asked for."""
    table = _OPEN[next(requests)](path)
    if len(table.names) > MAX_COLUMNS:
        raise ValueError(f"{len(table.names)} columns; at most {MAX_COLUMNS} are read")
    send(json.dumps({"names": table.names, "vehicle_toml": table.vehicle_toml}).encode())
    for request in requests:
        what, name, left = json.loads(request)
        size = table.size(name)
        if size > left:
            raise ValueError(f"{name}: {size} values; of a table at most {MAX_VALUES} are read")
        values = table.column(name) if what == "column" else table.own_time(name)
        send(_as_floats(values, name).tobytes())


class _Parquet:
    """A Parquet file; those of `tpmsd replay --parquet` bring the car's configuration."""

    def __init__(self, path: Path) -> None:
        from pyarrow import parquet

        limit(path)
        self._file: Any = parquet.ParquetFile(str(path), thrift_string_size_limit=1 << 22)
        self.names: tuple[str, ...] = tuple(self._file.schema_arrow.names)
        metadata = self._file.schema_arrow.metadata or {}
        ours = metadata.get(SCHEMA_KEY) == SCHEMA.encode()
        self.vehicle_toml = metadata[VEHICLE_KEY].decode() if ours and VEHICLE_KEY in metadata else None

    def size(self, name: str) -> int:
        """Return the number of rows by the file's footer; a page may hold others, which the child's memory
        bounds.
        """
        return int(self._file.metadata.num_rows)

    def column(self, name: str) -> Any:
        """Return the column."""
        return self._file.read(columns=[name], use_threads=False).column(0).to_numpy()

    def own_time(self, name: str) -> Any:
        """Return None: all columns share one."""
        return ()


class _Mf4:
    """A measurement file of the automotive industry (ASAM MDF 4), by asammdf."""

    def __init__(self, path: Path) -> None:
        bring_in_mf4()  # the command line leaves it out of what it imports
        import asammdf

        limit(path)
        self.vehicle_toml: str | None = None
        with path.open("rb") as file:
            check_mf4(file)
        self._file: Any = asammdf.MDF(str(path))
        self._start_s = float(self._file.start_time.timestamp())
        self.names: tuple[str, ...] = tuple(self._file.channels_db)
        self._signals: dict[str, Any] = {}

    def size(self, name: str) -> int:
        """Return the number of readings by the group's header."""
        group, _ = self._file.channels_db[name][0]
        return int(self._file.groups[group].channel_group.cycles_nr)

    def column(self, name: str) -> Any:
        """Return the signal's values."""
        return self._signal(name).samples

    def own_time(self, name: str) -> Any:
        """Return Unix seconds of the signal's readings."""
        return np.asarray(self._signal(name).timestamps, dtype=np.float64) + self._start_s

    def _signal(self, name: str) -> Any:
        if name not in self._signals:
            group, index = self._file.channels_db[name][0]
            self._signals[name] = self._file.get(group=group, index=index)
        return self._signals[name]


class _Hdf5:
    """An HDF5 file such as MATLAB's `save -v7.3` writes; names are paths like `log/t`."""

    def __init__(self, path: Path) -> None:
        import h5py

        limit(path)
        self.vehicle_toml: str | None = None
        names: list[str] = []

        def visit(name: str, item: Any) -> bool | None:
            if isinstance(item, h5py.Dataset):
                names.append(name)
            return True if len(names) > MAX_COLUMNS else None

        self._file: Any = h5py.File(path, "r")
        self._file.visititems(visit)  # follows hard links alone
        self.names = tuple(names)
        self._check_no_external_links(h5py.ExternalLink)

    def _check_no_external_links(self, external: type) -> None:
        groups = [self._file]
        self._file.visititems(lambda _, item: groups.append(item) if hasattr(item, "keys") else None)
        for group in groups:
            for name in group:
                if isinstance(group.get(name, getlink=True), external):
                    raise ValueError(f"{name}: a link to another file is not followed")

    def size(self, name: str) -> int:
        """Return the number of values by the data set's header, or of one chunk where that holds more."""
        data = self._file[name]
        if data.external or data.is_virtual:
            raise ValueError(f"{name}: its values lie in another file, which is not read")
        if data.dtype.kind not in "fiub":
            raise ValueError(f"{name}: not numbers")
        return max(math.prod(data.shape or ()), math.prod(data.chunks or ()))

    def column(self, name: str) -> Any:
        """Return the data set, rows and columns of vectors alike."""
        values = np.asarray(self._file[name])
        if values.ndim > 1 and max(values.shape, default=0) == values.size:
            return values.reshape(-1)
        return values

    def own_time(self, name: str) -> Any:
        """Return None: the map names the data set with the times."""
        return ()


_OPEN: dict[str, Callable[[Path], _NativeTable]] = {".parquet": _Parquet, ".mf4": _Mf4, ".mat": _Hdf5}


def _as_floats(values: Any, name: str) -> FloatArray:
    try:
        numbers: FloatArray = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: not numbers") from None
    if numbers.ndim != 1:
        raise ValueError(f"{name}: shape {numbers.shape}, a column is wanted")
    return numbers
