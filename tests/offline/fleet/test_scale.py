"""A large store: its tables, a question and the report in bounded time, which grows with the drives alone."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.campaigns.offline.fleet_scale import MEMORY_MB, QUERY, draw_store, measured
from tpmsd.offline.fleet.ask import ask
from tpmsd.offline.fleet.store import Store

DRIVES, CARS, MODELS = 20_000, 1_000, 4


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    """Twenty thousand drives of a thousand cars."""
    yield draw_store(tmp_path_factory.mktemp("fleet") / "store", DRIVES, CARS, MODELS, seed=1)


@pytest.mark.slow
def test_twenty_thousand_drives(store: Store) -> None:
    """A fifth of the bars of 100,000 drives, times three for a busy machine; all drives are in the answer."""
    for step, bar_s in (("joint", 12.0), ("sql", 1.0), ("report", 6.0)):
        found = measured(step, store)
        print(f"{step:8} {found['cpu_s']:6.1f} s of CPU  {found['peak_mb']:6.0f} MB")
        assert found["cpu_s"] < 3.0 * bar_s
        assert found["peak_mb"] < MEMORY_MB
    names, rows = ask(store, QUERY)
    assert ["model", "drives", "mean"] == names
    assert DRIVES == sum(row[1] for row in rows)


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
