"""Time and memory of a large store: the joint reduction, the report and a question in SQL.

    python -m bench run fleet-scale                        100,000 drives, 1.0 GB of disk, some 3 min
    python -m bench run fleet-scale --drives 20000 --cars 1000

The results are drawn, not replayed: each drive has four wheels, statistics of all parameters of the fleet
with an information matrix of its own, and one in twenty an alarm. Each step runs in a process of its own, so
that its peak memory is its own.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.calibration.equations import PARAMETERS
from tpmsd.offline.fleet.parameters import RADII
from tpmsd.offline.fleet.report import report_document
from tpmsd.offline.fleet.report_page import report_page
from tpmsd.offline.fleet.sql_query import ask
from tpmsd.offline.fleet.store import DriveEntry, Store
from tpmsd.offline.fleet.tables import rows_of, rows_of_files, write_tables
from tpmsd.offline.fleet.work import SCHEMA, STAGES, program

BARS_S = {"joint": 60.0, "report": 30.0, "sql": 2.0}
"""Of 100,000 drives."""
MEMORY_MB = 2000.0
QUERY = (
    "select d.model, count(*) drives, avg(w.deviation_mm) mean from drives d join wheels w using (key)"
    " where w.wheel = 'rl' group by 1 order by 1"
)
_RADIUS_STD = 5e-4
"""Of a drive's radii, in parts of the radius; the other parameters are known to a tenth of themselves."""
_FIRST_S, _DAY_S = 1.7e9, 86_400.0


def options(parser: argparse.ArgumentParser) -> None:
    """Size of the store."""
    parser.add_argument("--drives", type=int, default=100_000)
    parser.add_argument("--cars", type=int, default=5_000)
    parser.add_argument("--models", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--step", choices=tuple(STEPS), help=argparse.SUPPRESS)
    parser.add_argument("--store", type=Path, help=argparse.SUPPRESS)


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Draw the store and measure each step."""
    if args.step is not None:
        print(json.dumps(measured(args.step, Store.open(args.store))))
        return {}
    result: dict[str, Any] = {"drives": args.drives, "cars": args.cars}
    with tempfile.TemporaryDirectory(prefix="tpmsd-scale-") as folder:
        store = Path(folder) / "store"
        draw_store(store, args.drives, args.cars, args.models, args.seed)
        for step in STEPS:
            command = [
                sys.executable,
                "-m",
                "bench",
                "run",
                "fleet-scale",
                "--step",
                step,
                "--store",
                str(store),
            ]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            found = json.loads(next(line for line in done.stdout.splitlines() if line.startswith("{")))
            result |= {f"{step}_{name}": value for name, value in found.items()}
            print(f"{step:8} {found['wall_s']:7.1f} s  {found['peak_mb']:7.0f} MB", flush=True)
    if args.drives == 100_000:
        result["within"] = all(
            result[f"{step}_wall_s"] <= bar and result[f"{step}_peak_mb"] <= MEMORY_MB
            for step, bar in BARS_S.items()
        )
    return result


def draw_store(path: Path, drives: int, cars: int, models: int, seed: int) -> Store:
    """Write a store of drawn results, cars in turn, one drive a day and car."""
    store = Store.create(path)
    rng = np.random.default_rng(seed)
    rows, cols = np.tril_indices(len(PARAMETERS))
    known = np.array([_RADIUS_STD if name in RADII else 0.1 for name in PARAMETERS])
    offsets = 1e-3 * rng.standard_normal((cars, len(PARAMETERS)))
    for number in range(drives):
        car, drive = number % cars, number // cars
        key = f"{number:016x}"
        entry = DriveEntry(key, f"/data/{car:05d}/{drive:04d}", f"car-{car:05d}", f"model-{car % models}")
        root = np.eye(len(known)) + 0.05 * rng.standard_normal((len(known), len(known)))
        matrix = root @ root.T / np.outer(known, known)
        truth = offsets[car] + known * rng.standard_normal(len(known))
        statistics = {
            "names": list(PARAMETERS),
            "information": matrix[rows, cols].tolist(),
            "vector": (matrix @ truth).tolist(),
        }
        start = _FIRST_S + _DAY_S * (drive + car / cars)
        result = _result(start, 1e3 * 0.3 * truth[: len(WHEELS)], statistics, number % 20 == 7)
        (store.drives / f"{key}.json").write_text(json.dumps(asdict(entry)) + "\n", encoding="utf-8")
        text = json.dumps(result, separators=(",", ":"), allow_nan=False)
        (store.results / f"{key}.json").write_text(text + "\n", encoding="utf-8")
    return store


def _result(start_s: float, offset_mm: Any, statistics: dict[str, Any], alarmed: bool) -> dict[str, Any]:
    """One drive's document, as a worker writes it."""
    wheel = {"state": "monitoring", "std_mm": 0.2, "change_mm": 0.0, "change_std_mm": 0.2}
    wheel |= {"deflation_probability": 0.001, "monitored_s": 800.0}
    alarm = {"time": start_s + 60.0, "drive_time_s": 60.0, "kind": "radius_deviation", "wheel": "rl"}
    alarm |= {"state": "raised", "deviation_mm": -1.0, "probability": 0.999, "reason": ""}
    return {
        "schema": SCHEMA,
        "program": program(),
        "status": "done",
        "reason": "",
        "stages": list(STAGES),
        "replay": {
            "start_time": start_s,
            "duration_s": 900.0,
            "distance_m": 9e3,
            "wheels": {
                name: {**wheel, "deviation_mm": float(value)}
                for name, value in zip(WHEELS, offset_mm, strict=True)
            },
            "alarms": [alarm] if alarmed else [],
        },
        "calibrate": {"reason": "", "statistics": statistics},
        "diagnose": {"verdict": "consistent", "reason": "", "findings": []},
    }


def joint(store: Store) -> None:
    """All result files to the tables, the joint inference among them."""
    write_tables(store)


def report(store: Store) -> None:
    """The report's document and page."""
    tables = rows_of_files(store) or rows_of(store)
    document = report_document(tables)
    report_page({**document, "schema": "tpmsd.fleet.report/1"}, tables)


def sql(store: Store) -> None:
    """One question that joins drives and wheels."""
    ask(store, QUERY)


STEPS = {"joint": joint, "sql": sql, "report": report}
"""In this order: a question needs the tables."""


def measured(step: str, store: Store) -> dict[str, float]:
    """Wall-clock and CPU seconds of a step, and the peak memory of this process (MB)."""
    begun, cpu = time.perf_counter(), time.process_time()
    STEPS[step](store)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return {
        "wall_s": time.perf_counter() - begun,
        "cpu_s": time.process_time() - cpu,
        "peak_mb": peak,
    }


@contextlib.contextmanager
def drawn(drives: int, cars: int, models: int = 3, seed: int = 1) -> Iterator[Store]:
    """A drawn store that is gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="tpmsd-scale-") as folder:
        yield draw_store(Path(folder) / "store", drives, cars, models, seed)
