"""Dask over a network: scheduler and client on one machine, the worker on another, as network namespaces.

Both see the store under the same path, as with a shared file system. Takes root, for the namespaces.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from tpmsd.offline.fleet.find_drives import find_drives
from tpmsd.offline.fleet.run import missing_drives
from tpmsd.offline.fleet.store import Store
from tpmsd.offline.fleet.tables import COLUMNS, write_tables
from tpmsd.offline.fleet.work import work_on_drive
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive

STAGES = ("replay",)
DRIVES = 3
PATIENCE_S = 120.0
NEAR, FAR = "tpmsd-near", "tpmsd-far"
NEAR_ADDRESS, FAR_ADDRESS, PORT = "10.77.0.1", "10.77.0.2", 8786
ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def ip(*words: str) -> None:
    """Run `ip`; what it says is the reason of a failure."""
    subprocess.run(["ip", *words], check=True, capture_output=True)


@pytest.fixture
def machines() -> Iterator[None]:
    """Two network namespaces that see each other over one link, and nothing else."""
    if os.geteuid() != 0 or shutil.which("ip") is None:
        pytest.skip("network namespaces take root and iproute2")
    try:
        for name in (NEAR, FAR):
            ip("netns", "add", name)
        ip("link", "add", "tpmsd-a", "netns", NEAR, "type", "veth", "peer", "name", "tpmsd-b", "netns", FAR)
        for name, link, address in (
            (NEAR, "tpmsd-a", NEAR_ADDRESS),
            (FAR, "tpmsd-b", FAR_ADDRESS),
        ):
            ip("-n", name, "address", "add", f"{address}/24", "dev", link)
            ip("-n", name, "link", "set", link, "up")
            ip("-n", name, "link", "set", "lo", "up")
        yield
    finally:
        for name in (NEAR, FAR):
            subprocess.run(["ip", "netns", "del", name], check=False, capture_output=True)


@contextmanager
def started(machine: str, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    """A Python process on one of the machines, killed at the end."""
    command = ["ip", "netns", "exec", machine, sys.executable, *words]
    process = subprocess.Popen(command, env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def listens(machine: str) -> bool:
    """Return whether the scheduler's port answers on its machine."""
    probe = f"import socket; socket.create_connection(({NEAR_ADDRESS!r}, {PORT}), 1.0)"
    command = ["ip", "netns", "exec", machine, sys.executable, "-S", "-c", probe]
    return subprocess.run(command, check=False, capture_output=True).returncode == 0


def tables(store: Store) -> dict[str, bytes]:
    """All tables of a store, as bytes."""
    write_tables(store)
    return {name: (store.tables / f"{name}.parquet").read_bytes() for name in COLUMNS}


def test_a_worker_on_another_machine_makes_the_same_tables(machines: None, tmp_path: Path) -> None:
    """All drives are worked on beyond the link, and the tables are those of a plain loop."""
    for number in range(DRIVES):
        write_drive(
            tmp_path / "vans" / f"van-{number}" / "drive",
            simulate_drive(DriveSpec(duration_s=20.0, seed=number)),
        )
    loop, store = Store.create(tmp_path / "loop"), Store.create(tmp_path / "store")
    for one in (loop, store):
        for entry in find_drives([str(tmp_path / "vans")]):
            one.add(entry)
    for key in missing_drives(loop, STAGES):
        work_on_drive(str(loop.path), key, STAGES, "loop")

    address = f"tcp://{NEAR_ADDRESS}:{PORT}"
    scheduler = ("-m", "distributed.cli.dask_scheduler", "--host", NEAR_ADDRESS, "--port", str(PORT))
    worker = ("-m", "distributed.cli.dask_worker", address, "--no-nanny", "--nthreads", "1", "--no-dashboard")
    client = ("-m", "tpmsd", "fleet", "run", str(store.path), "--scheduler", address)
    client += ("--without", "calibrate", "--without", "diagnose")
    with ExitStack() as stack:
        stack.enter_context(started(NEAR, *scheduler, "--no-dashboard"))
        begun = time.monotonic()
        while not listens(FAR):
            assert time.monotonic() - begun < PATIENCE_S, "the scheduler does not listen"
            time.sleep(0.1)
        stack.enter_context(started(FAR, *worker))
        run = stack.enter_context(started(NEAR, *client))
        assert 0 == run.wait(PATIENCE_S)
    assert [] == missing_drives(store, STAGES)
    assert tables(loop) == tables(store)
