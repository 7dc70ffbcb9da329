"""Questions to a store in SQL, answered by DuckDB.

In: a store with tables, a query. Out: column names and rows. The tables are read into memory first; the query
itself may open no file and no network.
"""

from __future__ import annotations

import csv
import datetime
import io
from typing import Any

from tpmsd.foundation.errors import ConfigError
from tpmsd.offline.fleet.store import Store
from tpmsd.offline.fleet.tables import COLUMNS
from tpmsd.offline.tables.extras import need

_TIMES = frozenset({"start", "time", "since"})
"""Columns that hold times of the host's clock."""
_FIRST_DATE_S = 1e9
"""Host times before September 2001 are of a clock that was not set."""
KEY_LETTERS = 10
"""Letters of a drive's key that are shown; `where key like '0123456789%'` finds the drive."""


def ask(store: Store, query: str) -> tuple[list[str], list[tuple[Any, ...]]]:
    """The answer; ConfigError with one line where there are no tables yet or the query is wrong."""
    duckdb = need("duckdb", "fleet", "questions in SQL")
    with duckdb.connect(":memory:") as database:
        for name in COLUMNS:
            file = store.tables / f"{name}.parquet"
            if not file.is_file():
                raise ConfigError(f"{store.path}: no tables yet (tpmsd fleet run makes them)")
            database.execute(f"create table {name} as select * from read_parquet(?)", [str(file)])
        database.execute("set enable_external_access = false")
        try:
            answer = database.execute(query)
            rows = answer.fetchall() if answer.description else []
            names = [column[0] for column in answer.description or ()]
        except duckdb.Error as error:
            raise ConfigError(f"query: {' '.join(str(error).split())[:300]}") from None
    return names, rows


def as_text(names: list[str], rows: list[tuple[Any, ...]]) -> str:
    """The answer in columns, for people."""
    cells = [[_cell(value, name) for name, value in zip(names, row, strict=True)] for row in rows]
    widths = [max(len(name), *(len(row[k]) for row in cells), 1) for k, name in enumerate(names)]
    lines = ["  ".join(name.ljust(width) for name, width in zip(names, widths, strict=True)).rstrip()]
    lines += ["  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in cells]
    return "\n".join(lines)


def as_csv(names: list[str], rows: list[tuple[Any, ...]]) -> str:
    """Return the answer as CSV: whole keys, times as numbers, empty where nobody knows."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(rows)
    return out.getvalue()


def as_parquet(names: list[str], rows: list[tuple[Any, ...]]) -> bytes:
    """Return the answer as a Parquet file."""
    pa = need("pyarrow", "fleet", "tables")
    parquet = need("pyarrow.parquet", "fleet", "tables")
    columns = [pa.array([row[k] for row in rows]) for k in range(len(names))]
    out = io.BytesIO()
    parquet.write_table(pa.Table.from_arrays(columns, names=names), out, compression="zstd")
    return out.getvalue()


def _cell(value: Any, name: str) -> str:
    """One value for people: a host time as UTC, of a key its beginning."""
    if value is None:
        return ""
    if name in _TIMES and isinstance(value, float) and value >= _FIRST_DATE_S:
        moment = datetime.datetime.fromtimestamp(value, tz=datetime.UTC)
        return moment.strftime("%Y-%m-%d %H:%M:%S")
    if name == "key" and isinstance(value, str):
        return value[:KEY_LETTERS]
    return f"{value:.6g}" if isinstance(value, float) else " ".join(str(value).split())
