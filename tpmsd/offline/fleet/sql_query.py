"""Questions to a store in SQL, answered by DuckDB.

In: a store with tables, a query. Out: column names and rows. The tables are read into memory first; the query
itself may open no file and no network, change no setting, and has limits of memory, time and rows.
"""

from __future__ import annotations

import csv
import datetime
import io
import threading
from typing import Any

from tpmsd.foundation.errors import ConfigError
from tpmsd.offline.fleet.settings import SETTINGS
from tpmsd.offline.fleet.store import Store
from tpmsd.offline.fleet.tables import COLUMNS
from tpmsd.offline.tables.extras import import_extra

_TIMES = frozenset({"start", "time", "since"})
"""Columns that hold times of the host's clock."""
_SETTINGS = (
    "set temp_directory = ''",
    "set enable_external_access = false",
    "set threads = 1",
    f"set memory_limit = '{SETTINGS.query_memory}'",
    "set lock_configuration = true",
)
_KINDS = ("SELECT", "EXPLAIN")


def ask(store: Store, query: str, max_s: float = SETTINGS.query_s) -> tuple[list[str], list[tuple[Any, ...]]]:
    """Return the column names and rows of an SQL query; ConfigError where there are no tables yet, or the
    query is wrong or too expensive.

    Columns of one name are numbered.
    """
    duckdb = import_extra("duckdb", "fleet", "questions in SQL")
    with duckdb.connect(":memory:") as database:
        for name in COLUMNS:
            file = store.tables / f"{name}.parquet"
            if not file.is_file():
                raise ConfigError(f"{store.path}: no tables yet (tpmsd fleet run makes them)")
            try:
                database.execute(f"create table {name} as select * from read_parquet(?)", [str(file)])
            except duckdb.Error as error:
                raise ConfigError(f"{file}: damaged: {' '.join(str(error).split())[:200]}") from None
        for setting in _SETTINGS:
            database.execute(setting)
        clock = threading.Timer(max_s, database.interrupt)
        clock.daemon = True
        clock.start()
        try:
            statements = database.extract_statements(query)
            if len(statements) != 1 or statements[0].type.name not in _KINDS:
                raise ConfigError("query: one question (select, with, explain) is wanted")
            answer = database.execute(statements[0])
            rows = answer.fetchmany(SETTINGS.query_rows + 1)
            names = [column[0] for column in answer.description or ()]
        except duckdb.InterruptException:
            raise ConfigError(f"query: takes more than {max_s:.0f} s") from None
        except (duckdb.Error, MemoryError) as error:
            raise ConfigError(f"query: {printable(str(error))[:300]}") from None
        finally:
            clock.cancel()
    if len(rows) > SETTINGS.query_rows:
        raise ConfigError(f"query: more than {SETTINGS.query_rows} rows; add a limit")
    return unique_names(names), rows


def unique_names(names: list[str]) -> list[str]:
    """Return the names, repeated ones numbered: `car`, `car_2`, `car_3`."""
    found: list[str] = []
    for name in names:
        made, number = name, 1
        while made in found:
            number += 1
            made = f"{name}_{number}"
        found.append(made)
    return found


def as_text(names: list[str], rows: list[tuple[Any, ...]]) -> str:
    """Return the answer as aligned columns."""
    cells = [[_cell_text(value, name) for name, value in zip(names, row, strict=True)] for row in rows]
    names = [printable(name) for name in names]
    widths = [max(len(name), *(len(row[k]) for row in cells), 1) for k, name in enumerate(names)]
    lines = ["  ".join(name.ljust(width) for name, width in zip(names, widths, strict=True)).rstrip()]
    lines += ["  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in cells]
    return "\n".join(lines)


def as_csv(names: list[str], rows: list[tuple[Any, ...]]) -> str:
    """Return the answer as CSV: whole keys, times as numbers, missing values empty."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(rows)
    return out.getvalue()


def as_parquet(names: list[str], rows: list[tuple[Any, ...]]) -> bytes:
    """Return the answer as a Parquet file."""
    pa = import_extra("pyarrow", "fleet", "tables")
    parquet = import_extra("pyarrow.parquet", "fleet", "tables")
    columns = [pa.array([row[k] for row in rows]) for k in range(len(names))]
    out = io.BytesIO()
    parquet.write_table(pa.Table.from_arrays(columns, names=names), out, compression="zstd")
    return out.getvalue()


def _cell_text(value: Any, name: str) -> str:
    """Return one value as text: a host time as UTC, of a key its beginning."""
    if value is None:
        return ""
    if name in _TIMES and isinstance(value, float) and value >= SETTINGS.first_date_s:
        moment = datetime.datetime.fromtimestamp(value, tz=datetime.UTC)
        return moment.strftime("%Y-%m-%d %H:%M:%S")
    if name == "key" and isinstance(value, str):
        return value[: SETTINGS.key_letters]
    return f"{value:.6g}" if isinstance(value, float) else printable(str(value))[: SETTINGS.cell_chars]


def printable(text: str) -> str:
    """Return the text on one line, control characters replaced."""
    return "".join(
        mark if mark.isprintable() else "\N{REPLACEMENT CHARACTER}" for mark in " ".join(text.split())
    )
