"""A user's table as a drive.

In: the path of a table and of its map. Out: `Drive`, in memory.
"""

from __future__ import annotations

from pathlib import Path

from tpmsd.foundation.errors import InputError
from tpmsd.offline.drives.drive import Drive, drive_of, settings_of
from tpmsd.offline.drives.reading import Note, ignore_note
from tpmsd.offline.tables.encode import encode
from tpmsd.offline.tables.from_file import read_signals
from tpmsd.offline.tables.gather import TableError, signals_from, split_empty
from tpmsd.offline.tables.map_file import TableMap, load_map


def load_table(table: str | Path, map_file: str | Path | None = None, note: Note = ignore_note) -> Drive:
    """The drive that a CSV, Parquet, MF4 or MATLAB v7.3 table holds (docs/how-to/python.md).

    Without a map the columns' names tell role and unit, as those of the tick table do; Parquet files of
    `tpmsd replay --parquet` bring the car, too. Wheels and signals of which no row has a value are left out,
    which `note` is told. ConfigProblems with the map's lines where it is wrong or does
    not fit; InputError where the table cannot be used.
    """
    path = Path(table)
    mapped = TableMap() if map_file is None else load_map(Path(map_file))
    found = read_signals(path, mapped)
    series, empty = split_empty(found.series)
    if empty:
        note(f"{path}: left out, for no row has a value: {', '.join(empty)}")
    try:
        signals = signals_from(series, found.moduli)
    except TableError as error:
        raise InputError(path, str(error)) from None
    tables = {**(settings_of(mapped.config) if mapped.config is not None else {}), **found.car}
    return drive_of(encode(signals), tables, path.stem)
