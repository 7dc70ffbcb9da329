"""A real Dask scheduler and two workers on loopback: whoever is killed, the tables are the same."""

from __future__ import annotations

import asyncio
import http.client
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest

from tpmsd.interfaces.cli.main import main
from tpmsd.offline.fleet.find_drives import find_drives
from tpmsd.offline.fleet.run import missing_drives
from tpmsd.offline.fleet.settings import SETTINGS
from tpmsd.offline.fleet.store import Store
from tpmsd.offline.fleet.tables import COLUMNS, write_tables
from tpmsd.offline.fleet.work import work_on_drive
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
    for key in missing_drives(store, STAGES):
        work_on_drive(str(store.path), key, STAGES, "loop")
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

    assert [] == missing_drives(store, STAGES)
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


def listening_ports() -> set[int]:
    """TCP ports on which this process and its children listen."""
    import psutil

    here = psutil.Process()
    return {
        one.laddr.port
        for process in (here, *here.children(recursive=True))
        for one in process.net_connections("tcp")
        if one.status == psutil.CONN_LISTEN
    }


async def _asked(address: str, security: Any) -> bool:
    """Whether a process of Dask answers a stranger, who says and asks what a client does."""
    from distributed.comm import connect
    from distributed.core import send_recv

    try:
        async with asyncio.timeout(2.0):
            comm = await connect(address, timeout=1.5, **security.get_connection_args("client"))
            await send_recv(comm, op="identity")
    except (OSError, TimeoutError):
        return False
    return True


async def answering(ports: list[int]) -> list[str]:
    """Addresses that answer a stranger without a key, or with one of another run."""
    from distributed.security import Security

    strangers = [
        (f"{scheme}://127.0.0.1:{port}", security)
        for port in ports
        for scheme, security in (("tcp", Security()), ("tls", Security.temporary()))
    ]
    answers = await asyncio.gather(*(_asked(*stranger) for stranger in strangers))
    return [address for (address, _), answer in zip(strangers, answers, strict=True) if answer]


def test_who_has_not_the_key_of_the_run_is_refused() -> None:
    """No port that `--jobs` opens takes a message without the run's key, or shows a page of the run."""
    import distributed

    from tpmsd.offline.fleet.run import _dask_client

    before = listening_ports()
    with _dask_client(distributed, None, 1, "1GiB") as client:
        assert 4 == client.submit(lambda: 4).result(PATIENCE_S)
        ports = sorted(listening_ports() - before)
        answered = asyncio.run(answering(ports))
        shown = [page for port in ports if (page := plain_page(port))]

    assert len(ports) >= 2  # a scheduler and a worker
    assert [] == answered
    assert [] == shown


def plain_page(port: int) -> str:
    """What a page of the scheduler shows to whoever asks over HTTP; empty where it shows none."""
    for path in ("info/main/workers.html", "metrics", "json/counts.json", "status", "health"):
        try:
            with urlopen(f"http://127.0.0.1:{port}/{path}", timeout=0.5) as answer:
                return f"{port}/{path}: {answer.status}"
        except OSError:  # refused, closed, or no such page
            continue
        except http.client.HTTPException:  # no HTTP at all
            continue
    return ""


def test_a_cluster_that_is_named_is_trusted_and_that_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`--scheduler` says before it connects that the cluster can run code as this user."""
    store = Store.create(tmp_path / "store")
    drive = tmp_path / "car" / "drive"
    write_drive(drive, simulate_drive(DriveSpec(duration_s=10.0, seed=1)))
    for entry in find_drives([str(drive)]):
        store.add(entry)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    monkey = pytest.MonkeyPatch()
    with monkey.context() as patched:
        patched.setattr("tpmsd.offline.fleet.run.SETTINGS", replace(SETTINGS, connect_s=0.2))
        assert 0 != main(["fleet", "run", str(store.path), "--scheduler", address])

    said = capsys.readouterr().err
    assert f"--scheduler {address} is trusted" in said
    assert "without TLS" in said
