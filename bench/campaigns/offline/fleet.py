"""Cost of a fleet: workers against a plain loop, kills, size of the store, and the joint inference.

    python -m bench run fleet                          24 drives of 2 min, some 10 min of CPU
    python -m bench run fleet --drives 1000 --seconds 600 --cars 60 --models 4

Simulated cars of several models, each model with an effect of its own and some cars with a fault, are
worked on by a plain loop, by one worker process and by two. CPU times are of this process and its
children, so they hold on a busy machine, too; the ratios of wall-clock times do not. The joint inference
is timed on statistics that are drawn.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tpmsd.car.physics.catalogue import parse_effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.offline.fleet.find_drives import find_drives
from tpmsd.offline.fleet.hierarchy import FleetStatistics, fit_model
from tpmsd.offline.fleet.parameters import NAMES
from tpmsd.offline.fleet.run import missing_drives, run
from tpmsd.offline.fleet.store import Store
from tpmsd.offline.fleet.tables import COLUMNS, write_tables
from tpmsd.offline.fleet.work import STAGES, work_on_drive
from tpmsd.offline.simulator.drive import DEFAULT_VEHICLE, DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.offline.simulator.faults import Fault

EFFECTS = (None, "centrifugal_growth:coefficient=1e-6", "gnss_latency:latency_s=0.12", None)
ROUTES = ("mixed", "rural", "motorway", "city")
DRIVES_PER_CAR_AND_DAY, CARS = 2, 10_000


def options(parser: argparse.ArgumentParser) -> None:
    """Size of the fleet."""
    parser.add_argument("--drives", type=int, default=24)
    parser.add_argument("--cars", type=int, default=6)
    parser.add_argument("--models", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=120.0, help="of each drive")
    parser.add_argument("--statistics", type=int, default=100_000, help="drawn, for the joint inference")
    parser.add_argument("--seed", type=int, default=1)


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Measure."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    reduced = reduction(args.statistics, args.seed)
    print(f"{args.statistics} statistics reduced in {reduced:.1f} s of CPU", flush=True)
    with tempfile.TemporaryDirectory(prefix="tpmsd-fleet-") as folder:
        root = Path(folder)
        simulate(root / "cars", args)
        queries: dict[str, Callable[[Store], object]] = {
            "plain loop": plain_loop,
            "1 worker": lambda store: run(store, jobs=1),
            "2 workers": lambda store: run(store, jobs=2),
        }
        measured: dict[str, dict[str, float]] = {}
        tables: dict[str, dict[str, bytes]] = {}
        sizes: list[int] = []
        for name, query in queries.items():
            store = Store.create(root / name.replace(" ", "-"))
            for entry in find_drives([str(root / "cars")]):
                store.add(entry)
            measured[name] = timed(lambda query=query, store=store: query(store))  # type: ignore[misc]
            write_tables(store)
            tables[name] = {t: (store.tables / f"{t}.parquet").read_bytes() for t in COLUMNS}
            sizes = list(store.bytes_per_result())
            print(name, {key: round(value, 2) for key, value in measured[name].items()}, flush=True)
    hours = args.drives * args.seconds / 3600.0
    cpu_per_hour = measured["plain loop"]["cpu_s"] / hours
    two, one, loop = (measured[name] for name in ("2 workers", "1 worker", "plain loop"))
    result = {
        "drives": args.drives,
        "seconds": args.seconds,
        "cpu_s_per_drive_hour": cpu_per_hour,
        "bytes_per_drive": sum(sizes) / len(sizes),
        "most_bytes": max(sizes),
        "speed_up_2_workers": one["wall_s"] / two["wall_s"],
        "cpu_over_plain_loop": one["cpu_s"] / loop["cpu_s"],
        "overhead_s_per_drive": (one["cpu_s"] - loop["cpu_s"]) / args.drives,
        "same_tables": tables["plain loop"] == tables["1 worker"] == tables["2 workers"],
        "reduction_cpu_s": reduced,
        "cores_for_10000_cars": CARS * DRIVES_PER_CAR_AND_DAY * 0.5 * cpu_per_hour / 86_400.0,
    }
    for key, value in result.items():
        print(f"{key:<24} {value:.4g}" if isinstance(value, float) else f"{key:<24} {value}")
    return result


def plain_loop(store: Store) -> None:
    """One drive after the other in this process."""
    for key in missing_drives(store):
        work_on_drive(str(store.path), key, STAGES, "loop")


def timed(work: Callable[[], object]) -> dict[str, float]:
    """Wall-clock and CPU seconds, children included."""
    begun, cpu = time.perf_counter(), _cpu_s()
    work()
    return {"wall_s": time.perf_counter() - begun, "cpu_s": _cpu_s() - cpu}


def _cpu_s() -> float:
    use = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in use)


def simulate(folder: Path, args: argparse.Namespace) -> None:
    """The drives: cars in turn, wheelbases by model, a puncture in the last drive of each fifth car."""
    rng = np.random.default_rng(args.seed)
    offsets = 1e-3 * rng.standard_normal((args.cars, 4))
    for number in range(args.drives):
        car, drive = number % args.cars, number // args.cars
        kind = car % args.models
        effect = EFFECTS[kind % len(EFFECTS)]
        vehicle = replace(DEFAULT_VEHICLE, wheelbase_m=2.6 + 0.1 * kind)
        fault = car % 5 == 4 and number + args.cars >= args.drives
        spec = DriveSpec(
            route=ROUTES[number % len(ROUTES)],
            duration_s=args.seconds,
            seed=1000 * args.seed + number,
            vehicle=vehicle,
            radius_offset_m=tuple(offsets[car].tolist()),
            faults=(Fault("puncture", 2.0, wheel="rl", onset_s=args.seconds / 2),) if fault else (),
            model=ExtendedModel() if effect is None else ExtendedModel().plus(parse_effect(effect)),
        )
        write_drive(folder / f"car-{car:03d}" / f"drive-{drive:03d}", simulate_drive(spec))


def reduction(drives: int, seed: int) -> float:
    """CPU seconds in which the statistics of so many drives, forty per car, become a model's fit."""
    rng, p, per_car = np.random.default_rng(seed), len(NAMES), 40
    cars = max(drives // per_car, 2)
    truth = 0.3 * rng.standard_normal((cars, p))
    rows = rng.standard_normal((cars, 2 * p, p)) * np.sqrt(25.0 / (2 * p))
    information = np.repeat(np.einsum("cij,cik->cjk", rows, rows), per_car, axis=0)
    of_drive = np.repeat(truth, per_car, axis=0) + 0.1 * rng.standard_normal((cars * per_car, p))
    vector = np.einsum("dij,dj->di", information, of_drive)
    vector += 5.0 * rng.standard_normal(vector.shape)
    stack = FleetStatistics(information, vector, np.repeat(np.arange(cars), per_car))
    begun = time.process_time()
    fit_model(stack)
    return time.process_time() - begun
