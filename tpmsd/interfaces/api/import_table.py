"""A user's table as a drive.

In: the path of a table and of its map. Out: `Drive`, in memory.
"""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

from tpmsd.car.config.problems import ConfigProblems
from tpmsd.foundation.errors import InputError
from tpmsd.offline.drives.drive import Drive, car_settings, drive_from_encoded
from tpmsd.offline.drives.reading import Note, ignore_note
from tpmsd.offline.tables.encode import encode
from tpmsd.offline.tables.from_file import missing_columns, read_signals
from tpmsd.offline.tables.gather import TableError, signals_from, split_empty
from tpmsd.offline.tables.guess import guess
from tpmsd.offline.tables.map_file import TableMap, read_map
from tpmsd.offline.tables.read_table import read_table


def load_table(table: str | Path, map_file: str | Path | None = None, note: Note = ignore_note) -> Drive:
    """Return the drive that a CSV, Parquet, MF4 or MATLAB v7.3 table holds (docs/how-to/python.md).

    Without a map the columns' names tell role and unit, as those of the tick table do; Parquet files of
    `tpmsd replay --parquet` bring the car, too. Wheels and signals of which no row has a value are left out,
    which `note` gets. ConfigProblems with every line of the map that is
    wrong or does not fit; InputError where the table cannot be used.
    """
    path = Path(table)
    mapped = TableMap()
    if map_file is not None:
        mapped, problems = read_map(Path(map_file))
        if problems:
            problems += missing_columns(path, mapped)
            raise ConfigProblems(sorted(problems, key=lambda problem: problem.line or 0))
    found = read_signals(path, mapped)
    series, empty = split_empty(found.series)
    if empty:
        note(f"{path}: left out, for no row has a value: {', '.join(empty)}")
    try:
        signals = signals_from(series, found.moduli)
    except TableError as error:
        raise InputError(path, str(error)) from None
    tables = {**(car_settings(mapped.config) if mapped.config is not None else {}), **found.car}
    return drive_from_encoded(encode(signals), tables, path.stem)


def guess_map(table: str | Path) -> tuple[str, bool]:
    """Guess the map of a CSV, Parquet, MF4 or MATLAB v7.3 table from its names, units and values.

    Returns:
        The text of a map.toml to be looked over, and True if a column was found for each rear wheel.

    Raises:
        InputError: The table cannot be read.
    """
    path = Path(table)
    with closing(read_table(path)) as opened:
        found = guess(opened)
    return found.text(path.name), found.has_wheels
