"""The tables of a store: made again from the result files, in an order of their own, and kept as Parquet.

In: a store. Out: `drives wheels alarms findings statistics` as rows, and as files that DuckDB, pandas and
others read. The same results give the same bytes, whoever worked on them in which order.
"""

from __future__ import annotations

import io
import json
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tpmsd.offline.fleet.joint import joint_rows
from tpmsd.offline.fleet.store import DriveEntry, Store, write_atomic
from tpmsd.offline.tables.extras import import_extra

Row = dict[str, Any]

COLUMNS: dict[str, dict[str, str]] = {
    "drives": {
        "key": "string",
        "car": "string",
        "model": "string",
        "path": "string",
        "start": "double",
        "duration_s": "double",
        "distance_m": "double",
        "status": "string",
        "reason": "string",
        "program": "string",
        "verdict": "string",
        "calibration": "string",
    },
    "wheels": {
        "key": "string",
        "car": "string",
        "wheel": "string",
        "state": "string",
        "deviation_mm": "double",
        "std_mm": "double",
        "change_mm": "double",
        "change_std_mm": "double",
        "deflation_probability": "double",
        "monitored_s": "double",
    },
    "alarms": {
        "key": "string",
        "car": "string",
        "time": "double",
        "drive_time_s": "double",
        "kind": "string",
        "wheel": "string",
        "state": "string",
        "deviation_mm": "double",
        "probability": "double",
        "reason": "string",
    },
    "findings": {
        "level": "string",
        "model": "string",
        "car": "string",
        "key": "string",
        "kind": "string",
        "effect": "string",
        "parameter": "string",
        "value": "double",
        "std": "double",
        "unit": "string",
        "confidence": "double",
        "p_value": "double",
        "since": "double",
        "status": "string",
    },
    "statistics": {
        "level": "string",
        "model": "string",
        "car": "string",
        "key": "string",
        "parameter": "string",
        "unit": "string",
        "value": "double",
        "std": "double",
        "spread_cars": "double",
        "spread_drives": "double",
        "drives": "int64",
    },
}
"""Table -> column -> type. `start` and `time` are on each drive's host clock."""


_OPTIONAL = {
    "findings": ("key", "confidence"),
    "statistics": ("car", "key", "spread_cars", "spread_drives"),
}
"""Columns that rows of one level have and those of another lack."""


def rows_of(store: Store) -> dict[str, list[Row]]:
    """Return all tables as rows, in their final order."""
    entries = sorted(store.entries(), key=lambda entry: (entry.model, entry.car, entry.key))
    brief: dict[str, dict[str, Any] | None] = {}
    tables: dict[str, list[Row]] = {name: [] for name in COLUMNS}
    for entry in entries:
        result = store.result(entry.key)
        brief[entry.key] = _joint_inference_part(result)
        tables["drives"].append(_drive_row(entry, result))
        if result is None or result["status"] != "done":
            continue
        replay = result.get("replay") or {}
        shared = {"key": entry.key, "car": entry.car}
        for wheel, one in replay.get("wheels", {}).items():
            tables["wheels"].append({**shared, "wheel": wheel, **one})
        tables["alarms"] += [{**shared, **alarm} for alarm in replay.get("alarms", ())]
        tables["findings"] += _finding_rows(entry, (result.get("diagnose") or {}).get("findings", ()))
    findings, statistics = joint_rows(entries, brief)
    tables["findings"] += findings
    tables["statistics"] = statistics
    return tables


def _joint_inference_part(result: dict[str, Any] | None) -> dict[str, Any] | None:
    """Return the part of a result that the joint inference needs, None without statistics; arrays take a
    third of the memory of lists.
    """
    statistics = ((result or {}).get("calibrate") or {}).get("statistics")
    if result is None or statistics is None:
        return None
    packed = {name: np.array(statistics[name], dtype=np.float64) for name in ("information", "vector")}
    start = (result.get("replay") or {}).get("start_time")
    names = tuple(map(sys.intern, statistics["names"]))
    return {"replay": {"start_time": start}, "calibrate": {"statistics": {"names": names, **packed}}}


def rows_of_files(store: Store) -> dict[str, list[Row]] | None:
    """Return all tables as the files have them; None where results are newer or files are damaged.

    Results are files of their own, so their times tell; a drive whose result is missing or damaged is looked
    for again.
    """
    parquet = import_extra("pyarrow.parquet", "fleet", "tables")
    files = {name: store.tables / f"{name}.parquet" for name in COLUMNS}
    try:
        made = min(file.stat().st_mtime_ns for file in files.values())
        if max(_newest_change_ns(store.drives), _newest_change_ns(store.results)) >= made:
            return None
        tables = {name: _rows_of_file(name, parquet.read_table(file)) for name, file in files.items()}
    except (OSError, ValueError):
        return None
    all_there = len(tables["drives"]) == sum(1 for _ in store.drives.glob("*.json"))
    known = all(row["status"] != "missing" for row in tables["drives"])
    return tables if all_there and known else None


def _rows_of_file(name: str, table: Any) -> list[Row]:
    """Return the rows of a file, without columns that rows of the results lack; ValueError for other
    columns.
    """
    if table.column_names != list(COLUMNS[name]):
        raise ValueError("other columns")
    rows: list[Row] = table.to_pylist()
    for row in rows:
        for column in _OPTIONAL.get(name, ()):
            if row[column] is None:
                del row[column]
    return rows


def _newest_change_ns(folder: Path) -> int:
    """Return the time of the last change in a folder of files, ns."""
    with os.scandir(folder) as entries:
        return max((entry.stat().st_mtime_ns for entry in entries), default=0)


def write_tables(store: Store) -> dict[str, int]:
    """Write all tables again; return the number of rows of each."""
    tables = rows_of(store)
    for name, rows in tables.items():
        write_atomic(store.tables / f"{name}.parquet", parquet_of(name, rows))
    return {name: len(rows) for name, rows in tables.items()}


def parquet_of(name: str, rows: Sequence[Row]) -> bytes:
    """Return one table as Parquet, missing values as null."""
    pa = import_extra("pyarrow", "fleet", "tables")
    parquet = import_extra("pyarrow.parquet", "fleet", "tables")
    types = {"string": pa.string(), "double": pa.float64(), "int64": pa.int64()}
    columns = COLUMNS[name]
    arrays = [pa.array(_column_values(rows, key, kind), types[kind]) for key, kind in columns.items()]
    out = io.BytesIO()
    parquet.write_table(pa.Table.from_arrays(arrays, names=list(columns)), out, compression="zstd")
    return out.getvalue()


def _column_values(rows: Sequence[Row], column: str, kind: str) -> list[Any]:
    """Return a column's values: finite numbers, texts, and tables and lists as JSON text; None for a missing
    value.
    """
    values = [row.get(column) for row in rows]
    if kind == "string":
        return [json.dumps(value) if isinstance(value, dict | list) else value for value in values]
    return [None if value is None or not math.isfinite(value) else value for value in values]


def _drive_row(entry: DriveEntry, result: dict[str, Any] | None) -> Row:
    made = result or {"status": "missing", "reason": "", "program": ""}
    replay = made.get("replay") or {}
    return {
        "key": entry.key,
        "car": entry.car,
        "model": entry.model,
        "path": entry.path,
        "start": replay.get("start_time"),
        "duration_s": replay.get("duration_s"),
        "distance_m": replay.get("distance_m"),
        "status": made["status"],
        "reason": made["reason"],
        "program": made["program"],
        "verdict": (made.get("diagnose") or {}).get("verdict"),
        "calibration": (made.get("calibrate") or {}).get("reason"),
    }


def _finding_rows(entry: DriveEntry, findings: Sequence[dict[str, Any]]) -> list[Row]:
    rows = []
    for finding in findings:
        shared = {
            "level": "drive",
            "model": entry.model,
            "car": entry.car,
            "key": entry.key,
            "kind": "effect",
            "effect": finding["effect"],
            "confidence": finding["confidence"],
            "p_value": finding.get("p_value"),
            "status": finding.get("status", "finding"),
        }
        parameters = finding["parameters"] or {"": {"value": None, "std": None, "unit": ""}}
        for name, quantity in parameters.items():
            value = quantity["value"]
            number = value if isinstance(value, int | float) else None
            rows.append(
                {
                    **shared,
                    "parameter": name if number is not None or value is None else f"{name}={value}",
                    "value": None if number is None else float(number),
                    "std": quantity["std"],
                    "unit": quantity["unit"],
                }
            )
    return rows
