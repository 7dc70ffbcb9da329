"""A real Dask scheduler and two workers on loopback: whoever is killed, the tables are the same."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from tpmsd.offline.fleet.find import find_drives
from tpmsd.offline.fleet.run import missing
from tpmsd.offline.fleet.store import Store
from tpmsd.offline.fleet.tables import COLUMNS, write_tables
from tpmsd.offline.fleet.work import work_on
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive

DRIVES = 10
PATIENCE_S = 180.0
"""For what takes seconds on a machine that has nothing else to do."""
STAGES = ("replay",)
ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


@pytest.fixture(scope="module")
def vans(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten drives of 20 s of three cars, one of them broken."""
    folder = tmp_path_factory.mktemp("vans")
    for number in range(DRIVES):
        drive = folder / f"van-{number % 3}" / f"drive-{number}"
        write_drive(drive, simulate_drive(DriveSpec(duration_s=20.0, seed=number)))
    (folder / "van-1" / "drive-4" / "bus.dbc").write_text("no DBC")
    return folder


@pytest.fixture(scope="module")
def undisturbed(vans: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The tables that a plain loop makes."""
    store = added(vans, tmp_path_factory.mktemp("plain") / "store")
    for key in missing(store, STAGES):
        work_on(str(store.path), key, STAGES, "loop")
    return tables(store)


def added(vans: Path, path: Path) -> Store:
    store = Store.create(path)
    for entry in find_drives([str(vans)]):
        store.add(entry)
    return store


def tables(store: Store) -> dict[str, bytes]:
    write_tables(store)
    return {name: (store.tables / f"{name}.parquet").read_bytes() for name in COLUMNS}


@contextmanager
def started(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """A process of this interpreter, killed at the end."""
    process = subprocess.Popen(
        [sys.executable, *arguments], env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def wait_for(what: str, happened: Callable[[], bool]) -> None:
    begun = time.monotonic()
    while not happened():
        assert time.monotonic() - begun < PATIENCE_S, what
        time.sleep(0.02)


def answers(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def test_kills_leave_the_same_tables(vans: Path, undisturbed: dict[str, bytes], tmp_path: Path) -> None:
    """kill -9 of a worker, then of the client, then the run once more: byte-equal to an undisturbed loop."""
    store = added(vans, tmp_path / "store")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    scheduler = ("-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(port))
    worker = ("-m", "distributed.cli.dask_worker", address, "--no-nanny", "--nthreads", "1", "--no-dashboard")
    client = ("-m", "tpmsd", "fleet", "run", str(store.path), "--scheduler", address)
    client += ("--without", "calibrate", "--without", "diagnose")

    def results() -> int:
        return len(list(store.results.glob("*.json")))

    with ExitStack() as stack:
        stack.enter_context(started(*scheduler, "--no-dashboard"))
        wait_for("the scheduler listens", lambda: answers(port))
        workers = [stack.enter_context(started(*worker, "--name", name)) for name in "ab"]
        first = stack.enter_context(started(*client))
        wait_for("a first result", lambda: results() >= 1)
        workers[0].send_signal(signal.SIGKILL)
        after = results()
        wait_for("a result after the worker's death", lambda: results() > after)
        first.send_signal(signal.SIGKILL)
        first.wait()
        assert results() < DRIVES  # in the middle, not at the end
        stack.enter_context(started(*worker, "--name", "c"))
        second = stack.enter_context(started(*client))
        assert 0 == second.wait(PATIENCE_S)

    assert [] == missing(store, STAGES)
    assert DRIVES == results()
    written = {name: (store.tables / f"{name}.parquet").read_bytes() for name in COLUMNS}
    assert undisturbed == written


def test_local_processes_make_the_same_tables(
    vans: Path, undisturbed: dict[str, bytes], tmp_path: Path
) -> None:
    """`--jobs 2` makes the very tables of the loop; run again, no work is left."""
    from tpmsd.offline.fleet.run import run

    store = added(vans, tmp_path / "store")
    tally = run(store, jobs=2, stages=STAGES)

    assert {"done": DRIVES - 1, "failed": 1} == tally.outcomes
    assert undisturbed == tables(store)
    assert 0 == run(store, jobs=2, stages=STAGES).total
    assert [] == list(store.tries.iterdir())
