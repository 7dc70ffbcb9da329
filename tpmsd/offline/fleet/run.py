"""Works off what is missing in a store, on this machine's cores or on a Dask cluster.

In: a store, a scheduler's address or a number of worker processes. Out: result files; progress to a
callback. Every task is one drive and writes one file; a task that runs twice writes the same file twice.
The client holds a few drives per worker at a time, so neither it nor the scheduler ever holds the fleet.

Dask's processes speak over TCP and run what they are sent. Those of this machine take nothing without a key
that is made for the run and held in memory alone (mutual TLS); a cluster that is named is trusted.
"""

from __future__ import annotations

import contextlib
import sys
import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from tpmsd.foundation.errors import TpmsdError
from tpmsd.offline.fleet.settings import SETTINGS
from tpmsd.offline.fleet.store import Store
from tpmsd.offline.fleet.work import STAGES, is_missing, work_on_drive
from tpmsd.offline.tables.extras import import_extra


@dataclass(frozen=True)
class Tally:
    """Drives done and to do of a run, its seconds so far, and how many drives had which outcome."""

    done: int
    total: int
    elapsed_s: float
    outcomes: dict[str, int]

    @property
    def rate(self) -> float:
        """Drives per second so far."""
        return self.done / self.elapsed_s if self.elapsed_s > 0.0 else 0.0

    @property
    def left_s(self) -> float:
        """Estimated time that the rest takes at this rate, s."""
        return (self.total - self.done) / self.rate if self.rate > 0.0 else float("inf")


def missing_drives(store: Store, stages: tuple[str, ...] = STAGES, recompute: bool = False) -> list[str]:
    """Return the keys of the drives that still have to be worked on."""
    return [entry.key for entry in store.entries() if is_missing(store.result(entry.key), stages, recompute)]


def run(
    store: Store,
    scheduler: str | None = None,
    jobs: int = 1,
    memory: str = SETTINGS.memory_per_worker,
    stages: tuple[str, ...] = STAGES,
    recompute: bool = False,
    progress: Callable[[Tally], None] = lambda tally: None,
) -> Tally:
    """Work on all missing drives; ConfigError without Dask, TpmsdError where no scheduler answers."""
    keys = missing_drives(store, stages, recompute)
    outcomes: Counter[str] = Counter()
    begun = time.monotonic()
    if not keys:
        return Tally(0, 0, 0.0, {})
    distributed = import_extra("distributed", "fleet", "fleets")
    name = uuid.uuid4().hex[:8]
    with _dask_client(distributed, scheduler, jobs, memory) as client:
        waiting = iter(keys)

        def submit(key: str) -> Any:
            # `pure=False` and a name of this run: a scheduler that lives on may remember older tasks.
            return client.submit(
                work_on_drive, str(store.path.resolve()), key, stages, name, pure=False, key=f"{key}-{name}"
            )

        ahead = max(SETTINGS.tasks_ahead * max(len(client.scheduler_info()["workers"]), jobs), 2)
        first = [submit(key) for _, key in zip(range(ahead), waiting, strict=False)]
        finished = distributed.as_completed(first)
        for future in finished:
            if future.status == "finished":
                outcomes[future.result()] += 1
            else:
                # Dask itself gave the drive up; the marks of its tries decide in the next run.
                outcomes["lost"] += 1
            future.release()
            progress(Tally(sum(outcomes.values()), len(keys), time.monotonic() - begun, dict(outcomes)))
            with contextlib.suppress(StopIteration):
                finished.add(submit(next(waiting)))
    return Tally(sum(outcomes.values()), len(keys), time.monotonic() - begun, dict(outcomes))


@contextlib.contextmanager
def _dask_client(distributed: Any, scheduler: str | None, jobs: int, memory: str) -> Iterator[Any]:
    """Yield a client of the scheduler, or of a cluster of `jobs` processes on this machine."""
    dask = import_extra("dask", "fleet", "fleets")
    # A worker's own threads take the interpreter from the drive in work: the profile looks at its stack 100
    # times a second, its ticks at the event loop 50 times, its monitor at the system twice.
    low_overhead = {
        "distributed.logging": {"distributed": "error"},
        "distributed.admin.log-length": 100,
        "distributed.admin.tick.interval": "1s",
        "distributed.admin.system-monitor.interval": "5s",
        "distributed.worker.profile.enabled": False,
        # Dask always opens its HTTP ports, to whoever is on the machine: nothing is shown there.
        "distributed.scheduler.http.routes": [],
        "distributed.worker.http.routes": [],
    }
    with dask.config.set(low_overhead):
        if scheduler is not None:
            try:
                client = distributed.Client(scheduler, timeout=SETTINGS.connect_s)
            except (OSError, TypeError, ValueError) as error:  # TypeError: TLS without keys
                reason = " ".join(str(error).split())[:200]
                raise TpmsdError(f"scheduler {scheduler}: cannot be reached: {reason}") from None
            with client:
                yield client
            return
        import_extra("cryptography", "fleet", "fleets")
        with (
            _without_main_import(),
            distributed.LocalCluster(
                n_workers=jobs,
                threads_per_worker=1,
                memory_limit=memory,
                security=distributed.security.Security.temporary(),
                dashboard_address="127.0.0.1:0",
                scheduler_kwargs={"dashboard": False},
                silence_logs=50,
            ) as cluster,
            distributed.Client(cluster) as client,
        ):
            yield client


@contextlib.contextmanager
def _without_main_import() -> Iterator[None]:
    """Keep new processes from importing the main module: they need none of it, and it may start a command."""
    main = sys.modules["__main__"]
    before = {name: getattr(main, name, None) for name in ("__file__", "__spec__")}
    for name in before:
        setattr(main, name, None)
    try:
        yield
    finally:
        for name, value in before.items():
            setattr(main, name, value)
