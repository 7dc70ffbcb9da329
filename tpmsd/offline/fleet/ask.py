"""Questions to a store in SQL, answered by DuckDB.

In: a store with tables, a query. Out: column names and rows. The tables are read into memory first; the query
itself may open no file and no network.
"""

from __future__ import annotations

from typing import Any

from tpmsd.foundation.errors import ConfigError
from tpmsd.offline.fleet.store import Store
from tpmsd.offline.fleet.tables import COLUMNS
from tpmsd.offline.tables.extras import need


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
    cells = [[_cell(value) for value in row] for row in rows]
    widths = [max(len(name), *(len(row[k]) for row in cells), 1) for k, name in enumerate(names)]
    lines = ["  ".join(name.ljust(width) for name, width in zip(names, widths, strict=True)).rstrip()]
    lines += ["  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in cells]
    return "\n".join(lines)


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else " ".join(str(value).split())
