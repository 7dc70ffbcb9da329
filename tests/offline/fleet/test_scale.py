"""A large store: its tables, a question and the report in bounded time, which grows with the drives alone."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.campaigns.offline.fleet_scale import MEMORY_MB, QUERY, draw_store, measured
from tpmsd.offline.fleet.report import report_document
from tpmsd.offline.fleet.sql_query import ask
from tpmsd.offline.fleet.store import Store
from tpmsd.offline.fleet.tables import COLUMNS, rows_of, rows_of_files, write_tables

DRIVES, CARS, MODELS = 5_000, 250, 4


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    """Five thousand drives of 250 cars."""
    yield draw_store(tmp_path_factory.mktemp("fleet") / "store", DRIVES, CARS, MODELS, seed=1)


@pytest.mark.slow
def test_five_thousand_drives(store: Store) -> None:
    """A twentieth of the bars of 100,000 drives, times three for a busy machine; no drive is missing."""
    for step, bar_s in (("joint", 3.0), ("sql", 1.0), ("report", 1.5)):
        found = measured(step, store)
        print(f"{step:8} {found['cpu_s']:6.1f} s of CPU  {found['peak_mb']:6.0f} MB")
        assert found["cpu_s"] < 3.0 * bar_s
        assert found["peak_mb"] < MEMORY_MB
    names, rows = ask(store, QUERY)
    assert ["model", "drives", "mean"] == names
    assert DRIVES == sum(row[1] for row in rows)


def test_kept_tables_stand_for_the_results_until_those_change(tmp_path: Path) -> None:
    """The files give the rows of the results; with a newer result or a damaged table they do not."""
    store = draw_store(tmp_path / "store", 40, 4, 1, seed=3)
    assert rows_of_files(store) is None
    write_tables(store)
    made = rows_of(store)
    for name, rows in (rows_of_files(store) or {}).items():
        whole = [dict.fromkeys(COLUMNS[name]) | row for row in made[name]]
        assert whole == [dict.fromkeys(COLUMNS[name]) | row for row in rows], name
    assert report_document(made) == report_document(rows_of_files(store) or {})

    newer = next(store.results.glob("*.json"))
    later_ns = (store.tables / "drives.parquet").stat().st_mtime_ns + 10**9
    os.utime(newer, ns=(later_ns, later_ns))
    assert rows_of_files(store) is None
    write_tables(store)
    for file in store.tables.iterdir():
        os.utime(file, ns=(later_ns + 10**9, later_ns + 10**9))
    assert rows_of_files(store) is not None
    (store.tables / "wheels.parquet").write_bytes(b"PAR1 no more")
    os.utime(store.tables / "wheels.parquet", ns=(later_ns + 10**9, later_ns + 10**9))
    assert rows_of_files(store) is None


def test_one_car_with_many_drives_takes_time_in_proportion(tmp_path: Path) -> None:
    """Four times the drives of one car take less than eight times the CPU time."""
    took = []
    for drives in (250, 1000):
        store = draw_store(tmp_path / f"{drives}", drives, 1, 1, seed=2)
        measured("joint", store)  # once before, with what is imported
        begun = time.process_time()
        measured("joint", store)
        took.append(time.process_time() - begun)
    assert took[1] < 8.0 * took[0]
