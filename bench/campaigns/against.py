"""CPU time of this commit over another's, measured in turn: `python -m bench run speed --against COMMIT`.

In: a commit of this repository, drives that both can read. Out: per figure the CPU seconds of both, and how
many times faster this one is. On a machine that is not idle only figures measured in turn can be compared, so
each run of one is followed by a run of the other, and the median of the ratios is told.
"""

from __future__ import annotations

import os
import random
import resource
import shutil
import statistics
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from bench.places import REPO
from bench.registry import UsageError
from bench.worlds.folder import write_folder
from bench.worlds.kinematic import Spec, drive
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive

FRAMES_PER_S = 2000.0
REPLAYED_S, DIAGNOSED_S = 600.0, 1200.0
CORE = """
import sys, time
from importlib import import_module
from pathlib import Path
def found(name, *modules):  # the places of one name, the newest commits' first
    for module in modules:
        try:
            return getattr(import_module("tpmsd." + module), name)
        except ImportError:
            continue
    raise ImportError(name)
load_config = found("load_config", "car.config.load", "config.load")
Pipeline = found("Pipeline", "onboard.pipeline", "pipeline")
load_database = found(
    "load_database", "onboard.sources.can.decoder", "onboard.sources.can_decoder", "sources.can_decoder"
)
CanFrame = found("CanFrame", "onboard.sources.can.frame", "onboard.sources.can_frame", "sources.can_frame")
Drive = found("Drive", "onboard.sources.drive", "sources.drive")
config = load_config(Path(sys.argv[1]))
pipeline = Pipeline(config, load_database(config.can.dbc))
spent, ticks, inner = 0.0, 0, pipeline._run
def timed(made):
    global spent, ticks
    if not made:
        return []
    began = time.process_time()
    steps = inner(made)
    spent += time.process_time() - began
    ticks += len(steps)
    return steps
pipeline._run = timed
for item in Drive(Path(sys.argv[1])):
    if isinstance(item, CanFrame):
        pipeline.on_frame(item.time_s, item.arbitration_id, item.is_extended, item.data)
    else:
        pipeline.on_sentence(item.time_s, item.line)
print(spent / ticks)
"""
"""Estimator and monitor alone, CPU seconds per tick; only what both commits have is used."""


@dataclass(frozen=True)
class Ratio:
    """One figure of both commits."""

    name: str
    unit: str
    here: float
    there: float
    """Medians."""
    times_faster: float
    """Median over the pairs of runs."""
    least: float
    greatest: float

    def line(self) -> str:
        """For people."""
        return (
            f"{self.name:<40} {self.here:>9.3g} {self.unit:<9} {self.there:>9.3g} there"
            f"  {self.times_faster:5.2f} times faster ({self.least:.2f} .. {self.greatest:.2f})"
        )


@contextmanager
def checked_out(commit: str) -> Iterator[Path]:
    """The tree of a commit, in a folder that goes away."""
    packed = subprocess.run(["git", "archive", commit], cwd=REPO, capture_output=True, check=False)
    if packed.returncode:
        raise UsageError(f"--against {commit}: {packed.stderr.decode().strip()}")
    with tempfile.TemporaryDirectory() as name:
        with tarfile.open(fileobj=BytesIO(packed.stdout)) as archive:
            archive.extractall(name, filter="data")
        yield Path(name)


def full_bus(source: Path, folder: Path) -> None:
    """The same drive on a bus of `FRAMES_PER_S`, filled with frames that nobody needs."""
    shutil.copytree(source, folder)
    lines = [
        (float(line[1 : line.index(")")]), line) for line in (folder / "can.log").read_text().splitlines()
    ]
    begin, end = lines[0][0], lines[-1][0]
    needed = {line.split()[2].split("#")[0] for _, line in lines}
    rng = random.Random(1)
    others = [
        name for name in (f"{rng.randrange(0x100, 0x7FF):03X}" for _ in range(60)) if name not in needed
    ]
    for _ in range(round(FRAMES_PER_S * (end - begin)) - len(lines)):
        time_s = rng.uniform(begin, end)
        lines.append((time_s, f"({time_s:.6f}) can0 {rng.choice(others)}#{rng.getrandbits(64):016X}"))
    lines.sort(key=lambda one: one[0])
    (folder / "can.log").write_text("".join(f"{line}\n" for _, line in lines))


def child(root: Path, words: list[str]) -> tuple[float, str]:
    """CPU seconds of a Python process that imports `tpmsd` from a tree, and what it prints."""
    environment = {**os.environ, "PYTHONPATH": str(root), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as elsewhere:
        done = subprocess.run(
            [sys.executable, "-P", *words], env=environment, cwd=elsewhere, capture_output=True, check=True
        )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return spent, done.stdout.decode()


def ratios(commit: str, runs: int, say: Callable[[Ratio], None], only: str = "") -> list[Ratio]:
    """The figures whose names begin with `only`, told to `say` as they come."""
    found: list[Ratio] = []
    with checked_out(commit) as there, tempfile.TemporaryDirectory() as name:
        plain, full, long = Path(name) / "plain", Path(name) / "full", Path(name) / "long"
        write_drive(plain, simulate_drive(DriveSpec(duration_s=REPLAYED_S, seed=1)))
        full_bus(plain, full)
        write_folder(drive(Spec(duration_s=DIAGNOSED_S), 1), long)

        for root in (REPO, there):  # as installed: neither compiles its modules while it is measured
            child(root, ["-m", "compileall", "-q", str(root / "tpmsd")])

        def measured(what: str, unit: str, once: Callable[[Path], float]) -> None:
            if not what.startswith(only):
                return
            pairs = [(once(REPO), once(there)) for _ in range(runs)]
            times = [other / own for own, other in pairs]
            here_s, there_s = (statistics.median(column) for column in zip(*pairs, strict=True))
            found.append(Ratio(what, unit, here_s, there_s, statistics.median(times), min(times), max(times)))
            say(found[-1])

        module = ["-m", "tpmsd"]
        measured(
            f"replay, {REPLAYED_S / 60:.0f} min, {FRAMES_PER_S:.0f} frames/s",
            "s",
            lambda root: child(root, [*module, "replay", str(full), "--json", "replay.json"])[0],
        )
        measured(
            "estimator and monitor", "s/tick", lambda root: float(child(root, ["-c", CORE, str(plain)])[1])
        )

        def diagnosed(root: Path) -> float:
            # The other commit may know no certificates; without them both do the same.
            options = ["--certify", "0"] if root == REPO else []
            return child(root, [*module, "diagnose", str(long), "--model-out", "model.toml", *options])[0]

        measured(f"diagnosis, {DIAGNOSED_S / 60:.0f} min", "s", diagnosed)
    return found
