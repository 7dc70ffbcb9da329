"""The tick table as CSV and as Parquet.

In: `TickTable`. Out: text and bytes. CSV has a header and an empty field where nobody knows; numbers are
written so that they read back to the last bit. Parquet has null there, each column's unit and meaning as
metadata of its field, and the car's configuration, so that the table alone can be made a drive again.
"""

from __future__ import annotations

import csv
import io
import math

import numpy as np

from tpmsd.offline.tables.columns import columns_of
from tpmsd.offline.tables.extras import import_extra
from tpmsd.offline.tables.tick_table import TickTable

SCHEMA = "tpmsd.ticks/1"
SCHEMA_KEY, VEHICLE_KEY = b"tpmsd.schema", b"tpmsd.vehicle"
CHUNK_ROWS = 10_000


def check_packages(kind: str) -> None:
    """Raise ConfigError where the package for a kind of table is missing: before a long replay, not
    after it.
    """
    if kind == "parquet":
        import_extra("pyarrow", "tables", "Parquet files")
    if kind == "mcap":
        import_extra("mcap.writer", "tables", "MCAP files")


def csv_text(table: TickTable) -> str:
    """Return the table as CSV."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    known = columns_of(table.numbers)
    writer.writerow([column.name for column in known])
    for begin in range(0, len(table), CHUNK_ROWS):
        part = slice(begin, begin + CHUNK_ROWS)
        columns = [
            table.texts[column.name][part]
            if column.text
            else [_csv_cell(value) for value in table.numbers[column.name][part].tolist()]
            for column in known
        ]
        writer.writerows(zip(*columns, strict=True))
    return out.getvalue()


def _csv_cell(value: float) -> str:
    if math.isnan(value):
        return ""
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)


def parquet_bytes(table: TickTable, vehicle_toml: str) -> bytes:
    """Return the table as Parquet; `vehicle_toml` is the car's configuration. ConfigError without pyarrow."""
    pa = import_extra("pyarrow", "tables", "Parquet files")
    parquet = import_extra("pyarrow.parquet", "tables", "Parquet files")
    fields, arrays = [], []
    for column in columns_of(table.numbers):
        kind = pa.dictionary(pa.int32(), pa.string()) if column.text else pa.float64()
        meaning = {b"unit": column.unit.encode(), b"meaning": column.meaning.encode()}
        fields.append(pa.field(column.name, kind, metadata=meaning))
        if column.text:
            arrays.append(pa.array(table.texts[column.name], pa.string()).dictionary_encode())
        else:
            values = table.numbers[column.name]
            arrays.append(pa.array(values, pa.float64(), mask=np.isnan(values)))
    metadata = {SCHEMA_KEY: SCHEMA.encode(), VEHICLE_KEY: vehicle_toml.encode()}
    made = pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=metadata))
    out = io.BytesIO()
    parquet.write_table(made, out, compression="zstd")
    return out.getvalue()
