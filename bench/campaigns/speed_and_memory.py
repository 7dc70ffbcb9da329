"""The figures of the README, measured on this machine: `make bench`.

In: nothing; a drive is simulated, and real recordings are used where there are any (TPMSD_RECORDINGS, or
../shared/recordings beside the repository). Out: a table, and JSON with `--json FILE`.

All are measured in CPU time, since other work on the machine lengthens what elapses; each figure is the
median of several runs with its least and greatest. The last column relates it to the time in which the same
happens on the road.

    python -m bench run speed --runs 5 --json bench.json
    python -m bench run speed --only "replay, 10 min"               some of the figures
    python -m bench run speed --against 438989a --only-against      side by side with another commit, all bars
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import io
import os
import platform
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from bench.campaigns.against import ratios
from bench.campaigns.onboard.decode import frames_per_second
from bench.places import RECORDINGS, REPO
from bench.registry import UsageError
from bench.worlds.folder import write_folder
from bench.worlds.kinematic import Spec, drive
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import FILTER_METHODS, Config
from tpmsd.foundation.errors import TpmsdError
from tpmsd.interfaces.cli.replay import replay
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.offline.simulator.faults import Fault
from tpmsd.onboard.estimators.build import build_estimator
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sources.can.decoder import load_database
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.drive import FolderStream
from tpmsd.onboard.timeline.tick import Tick

DRIVE_S = 600.0
DIAGNOSED_S = 1200.0
TICKS = 1500
"""How many of the drive's ticks an estimator is timed on."""
TICKS_FROM = 1500


@dataclasses.dataclass(frozen=True)
class Figure:
    """One measured figure; `realtime_ratio`: how many times faster than the road."""

    name: str
    unit: str
    median: float
    least: float
    greatest: float
    runs: int
    realtime_ratio: float

    def line(self) -> str:
        """For people."""
        digits = 0 if self.median >= 100 else 1 if self.median >= 10 else 3
        spread = f"{self.least:,.{digits}f} .. {self.greatest:,.{digits}f}"
        return (
            f"{self.name:<40} {self.median:>9,.{digits}f} {self.unit:<9} {spread:>20}"
            f" {self.realtime_ratio:>7,.0f} x real time"
        )


def measure(
    name: str, unit: str, runs: int, once: Callable[[], float], ratio: Callable[[float], float]
) -> Figure:
    """Run `once` several times; `ratio` makes real time's share of a value."""
    values = [once() for _ in range(runs)]
    median = statistics.median(values)
    return Figure(name, unit, median, min(values), max(values), runs, ratio(median))


def ticks_of(folder: Path, config: Config) -> list[Tick]:
    """The ticks of a drive, made without an estimate."""
    pipeline = Pipeline(config, load_database(config.can.dbc))
    ticks: list[Tick] = []
    for item in FolderStream(folder):
        if isinstance(item, CanFrame):
            events = pipeline.decoder.decode(item.time_s, item.arbitration_id, item.is_extended, item.data)
        else:
            events = pipeline.assembler.feed(item.time_s, item.line)
        for event in events:
            ticks += pipeline.timeline.add(event)
    return ticks


def estimator_ms(config: Config, ticks: Sequence[Tick]) -> float:
    """CPU milliseconds per tick of the configured estimator alone."""
    estimator = build_estimator(config, np.random.default_rng(config.filter.seed))
    for tick in ticks[:TICKS_FROM]:
        estimator.step(tick)
    timed = ticks[TICKS_FROM : TICKS_FROM + TICKS]
    began = time.process_time()
    for tick in timed:
        estimator.step(tick)
    return 1e3 * (time.process_time() - began) / len(timed)


def replay_factor(folder: Path, config: Config) -> tuple[float, float]:
    """(times real time, CPU milliseconds per tick) of a whole replay, reading the logs included."""
    began = time.process_time()
    with contextlib.redirect_stderr(io.StringIO()):  # what it says of bad lines is no news here
        result = replay(folder, config)
    cpu_s = time.process_time() - began
    return result.duration_s / cpu_s, 1e3 * cpu_s / (result.duration_s * config.filter.rate_hz)


def compile_modules() -> None:
    """As installed: no module is compiled while it is measured."""
    subprocess.run([sys.executable, "-m", "compileall", "-q", str(REPO / "tpmsd")], check=True)


def diagnosis_s(folder: Path, *options: str) -> float:
    """CPU seconds of `tpmsd diagnose` in a process of its own, reading included."""
    with tempfile.TemporaryDirectory() as name:
        words = ["diagnose", str(folder), "--model-out", str(Path(name) / "model.toml"), *options]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "tpmsd", *words]
        subprocess.run(command, env=environment, cwd=REPO, capture_output=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def with_method(config: Config, method: str) -> Config:
    """The same car with another estimator."""
    return dataclasses.replace(config, filter=dataclasses.replace(config.filter, method=method))


def recordings() -> list[Path]:
    """Real drives, where there are any."""
    folder = RECORDINGS
    return sorted(path.parent for path in folder.glob("*/vehicle.toml")) if folder.is_dir() else []


def figures(runs: int, drive_s: float, say: Callable[[Figure], None], only: str = "") -> list[Figure]:
    """Those whose names begin with `only`, handed to `say` as they come."""
    found: list[Figure] = []

    def take(name: str, unit: str, once: Callable[[], float], ratio: Callable[[float], float]) -> None:
        if name.startswith(only):
            found.append(measure(name, unit, runs, once, ratio))
            say(found[-1])

    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name) / "simulated"
        fault = Fault("puncture", 2.0, "percent", "rl", drive_s / 2, 30.0)
        write_drive(folder, simulate_drive(DriveSpec(duration_s=drive_s, seed=1, faults=(fault,))))
        config = load_config(folder)
        frames_per_real_s = sum(1 for item in FolderStream(folder) if isinstance(item, CanFrame)) / drive_s
        take("CAN decoding", "frames/s", frames_per_second, lambda rate: rate / frames_per_real_s)
        period_ms = 1e3 / config.filter.rate_hz
        ticks = cache(lambda: ticks_of(folder, config))
        for method in FILTER_METHODS:
            chosen = with_method(config, method)
            take(
                f"estimator alone, {method}",
                "ms/tick",
                lambda chosen=chosen: estimator_ms(chosen, ticks()),  # type: ignore[misc]
                lambda ms: period_ms / ms,
            )
        minutes = f"{drive_s / 60:.0f} min"
        for method in FILTER_METHODS:
            chosen = with_method(config, method)
            factors: list[float] = []

            def replayed(chosen: Config = chosen, factors: list[float] = factors) -> float:
                factor, cost = replay_factor(folder, chosen)
                factors.append(factor)
                return cost

            take(f"whole pipeline, {method}", "ms/tick", replayed, lambda ms: period_ms / ms)
            reported = iter(factors)
            take(
                f"replay, {minutes} simulated, {method}",
                "x",
                lambda reported=reported, chosen=chosen: (
                    next(reported, None) or replay_factor(folder, chosen)[0]
                ),  # type: ignore[misc]
                lambda factor: factor,
            )
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        grows = {"centrifugal_growth": {"coefficient": 1.5e-6}}
        write_folder(drive(Spec(duration_s=DIAGNOSED_S, physics=grows), 1), folder)
        compile_modules()
        for name, options in (("", ("--certify", "0")), (" with certificate", ())):
            take(
                f"diagnosis, {DIAGNOSED_S / 60:.0f} min{name}",
                "s",
                lambda options=options: diagnosis_s(folder, *options),  # type: ignore[misc]
                lambda seconds: DIAGNOSED_S / seconds,
            )
    for folder in recordings():
        try:
            config = load_config(folder)
            take(
                f"replay, {folder.name}",
                "x",
                lambda folder=folder, config=config: replay_factor(folder, config)[0],  # type: ignore[misc]
                lambda factor: factor,
            )
        except TpmsdError as error:
            print(f"{folder.name}: {error}", file=sys.stderr)
    return found


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--runs", metavar="N", type=int, default=3, help="runs per figure (default: 3)")
    parser.add_argument(
        "--drive-s", metavar="S", type=float, default=DRIVE_S, help="length of the simulated drive"
    )
    parser.add_argument(
        "--against", metavar="COMMIT", help="measure another commit in turn as well, and tell the ratios"
    )
    parser.add_argument("--only-against", action="store_true", help="the ratios alone")
    parser.add_argument("--only", metavar="NAME", default="", help="figures and ratios whose names begin so")


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Measure and print."""
    if args.runs < 1 or args.drive_s < 400.0:
        raise UsageError("at least one run, and a drive of at least 400 s")
    out = sys.stderr if args.json == "-" else sys.stdout
    print(f"{platform.machine()}, {os.cpu_count()} CPUs, Python {platform.python_version()}", file=out)
    print(f"{'':<40} {'median':>9} {'':<9} {'least .. greatest':>20}", file=out)
    if args.against is not None:
        compared = ratios(
            args.against, args.runs, lambda one: print(one.line(), file=out, flush=True), args.only
        )
        if args.only_against:
            return {"against": args.against, "ratios": compared}
    else:
        compared = []
    found = figures(
        args.runs, args.drive_s, lambda figure: print(figure.line(), file=out, flush=True), args.only
    )
    machine = {
        "machine": platform.machine(),
        "cpus": os.cpu_count(),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
    return {"machine": machine, "figures": found, "against": args.against, "ratios": compared}
