"""CPU time of this commit over another's, measured in turn: `python -m bench run speed --against COMMIT`.

In: a commit of this repository, drives that both can read. Out: per figure the CPU seconds of both, how many
times faster this one is, and whether the bar is held. On a machine that is not idle only figures measured in
turn can be compared, so each run of one is followed by a run of the other, and the median of the ratios is
given. Figures whose bar is absolute (memory, workers, a large store) are measured here alone, once.
"""

from __future__ import annotations

import json
import os
import random
import re
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

from bench.campaigns.offline.fleet_scale import BARS_S, MEMORY_MB
from bench.places import RECORDINGS, REPO
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
try:
    Drive = found("FolderStream", "onboard.sources.drive")
except (ImportError, AttributeError):
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


ODD_FRACTION, JITTER_S = 0.001, 0.002
"""Fraction of an odd log's frames that is lost, repeated and swapped with the next, each; and the standard
deviation of the frames' stamps, s."""
REAL_DRIVE = "van-motorway-a"
FLEET = ("--drives", "8", "--cars", "4", "--seconds", "120", "--statistics", "1000")
SOAK_H = 1.0


@dataclass(frozen=True)
class Ratio:
    """One figure of both commits, or of this one alone."""

    name: str
    unit: str
    here: float
    there: float | None
    """Medians; None where only this commit is measured."""
    times_faster: float | None
    """Median over the pairs of runs."""
    least: float | None
    greatest: float | None
    bar: float
    """Least `times_faster`; of this commit alone the greatest value, or the least if `at_least`."""
    at_least: bool = False

    @property
    def held(self) -> bool:
        """True if the figure is within its bar."""
        if self.times_faster is not None:
            return self.times_faster >= self.bar
        return self.here >= self.bar if self.at_least else self.here <= self.bar

    def line(self) -> str:
        """For people."""
        verdict = "held" if self.held else "missed"
        own = f"{self.name:<46} {self.here:>9.3g} {self.unit:<7}"
        if self.there is None:
            return f"{own}  bar: at {'least' if self.at_least else 'most'} {self.bar:g}, {verdict}"
        spread = f"({self.least:.2f} .. {self.greatest:.2f})"
        return (
            f"{own} {self.there:>9.3g} there  {self.times_faster:5.2f} times faster {spread},"
            f" bar {self.bar:g}, {verdict}"
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


def odd_log(source: Path, folder: Path) -> None:
    """The same drive with `ODD_FRACTION` of its frames lost, as many repeated and as many swapped with the
    next, and stamps that scatter by `JITTER_S`."""
    shutil.copytree(source, folder)
    rng = random.Random(1)
    rows: list[tuple[float, str]] = []
    for line in (folder / "can.log").read_text().splitlines():
        drawn = rng.random()
        if drawn < ODD_FRACTION:
            continue
        time_s = float(line[1 : line.index(")")]) + rng.gauss(0.0, JITTER_S)
        frame = line[line.index(")") :]
        rows.append((time_s, frame))
        if drawn > 1.0 - ODD_FRACTION:
            rows.append((time_s + 0.0003, frame))
    rows.sort(key=lambda row: row[0])
    for place in range(1, len(rows)):
        if rng.random() < ODD_FRACTION:
            (one_s, one), (other_s, other) = rows[place - 1 : place + 1]
            rows[place - 1], rows[place] = (one_s, other), (other_s, one)
    (folder / "can.log").write_text("".join(f"({time_s:.6f}{frame}\n" for time_s, frame in rows))


def with_particles(source: Path, folder: Path) -> None:
    """The same drive for the filter `mpf-pn` with 500 particles."""
    shutil.copytree(source, folder)
    with (folder / "vehicle.toml").open("a") as file:
        file.write('\n[filter]\nmethod = "mpf-pn"\nparticles = 500\n')


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


class _Measured:
    """Figures whose names begin with `only`, handed to `say` as they come."""

    def __init__(self, there: Path, runs: int, say: Callable[[Ratio], None], only: str) -> None:
        self.found: list[Ratio] = []
        self._there, self._runs, self._say, self._only = there, runs, say, only

    def asked(self, name: str) -> bool:
        """Return whether a figure is wanted."""
        return name.startswith(self._only)

    def both(self, name: str, unit: str, once: Callable[[Path], float], bar: float) -> None:
        """Measure a figure of both commits in turn; `once` measures it of a tree."""
        if not self.asked(name):
            return
        pairs = [(once(REPO), once(self._there)) for _ in range(self._runs)]
        times = [other / own for own, other in pairs]
        here, there = (statistics.median(column) for column in zip(*pairs, strict=True))
        self._take(Ratio(name, unit, here, there, statistics.median(times), min(times), max(times), bar))

    def alone(self, name: str, unit: str, value: float, bar: float, *, at_least: bool = False) -> None:
        """Take a figure of this commit."""
        if self.asked(name):
            self._take(Ratio(name, unit, value, None, None, None, None, bar, at_least))

    def _take(self, ratio: Ratio) -> None:
        self.found.append(ratio)
        self._say(ratio)


def ratios(commit: str, runs: int, say: Callable[[Ratio], None], only: str = "") -> list[Ratio]:
    """The figures whose names begin with `only`, handed to `say` as they come."""
    with checked_out(commit) as there, tempfile.TemporaryDirectory() as name:
        for root in (REPO, there):  # as installed: neither compiles its modules while it is measured
            child(root, ["-m", "compileall", "-q", str(root / "tpmsd")])
        measured = _Measured(there, runs, say, only)
        _commands(measured, Path(name))
        _starts(measured, runs)
        _memory(measured)
        _fleet(measured)
        _store(measured)
    return measured.found


def _commands(measured: _Measured, folder: Path) -> None:
    """Measure replay, its core, and diagnosis."""
    names = "plain", "full", "odd", "particles", "long"
    plain, full, odd, particles, long = (folder / name for name in names)
    write_drive(plain, simulate_drive(DriveSpec(duration_s=REPLAYED_S, seed=1)))
    full_bus(plain, full)
    odd_log(plain, odd)
    with_particles(plain, particles)
    write_folder(drive(Spec(duration_s=DIAGNOSED_S), 1), long)

    def replayed(drive: Path) -> Callable[[Path], float]:
        words = ["-m", "tpmsd", "replay", str(drive), "--json", "replay.json"]
        return lambda root: child(root, words)[0]

    def core(own: Path) -> Callable[[Path], float]:
        return lambda root: float(child(root, ["-c", CORE, str(own if root == REPO else plain)])[1])

    def diagnosed(*options: str) -> Callable[[Path], float]:
        # The other commit may know no certificates; it does without them.
        words = ["-m", "tpmsd", "diagnose", str(long), "--model-out", "model.toml"]
        return lambda root: child(root, [*words, *options] if root == REPO else words)[0]

    minutes = f"{REPLAYED_S / 60:.0f} min"
    measured.both(f"replay, {minutes}, {FRAMES_PER_S:.0f} frames/s", "s", replayed(full), 6.0)
    measured.both(f"replay, {minutes}, odd log", "s", replayed(odd), 4.0)
    if (real := RECORDINGS / REAL_DRIVE).is_dir():
        measured.both(f"replay, {REAL_DRIVE}", "s", replayed(real), 3.5)
    measured.both("estimator and monitor", "s/tick", core(plain), 2.5)
    measured.both("estimator and monitor, mpf-pn, 500 particles", "s/tick", core(particles), 1.0)
    minutes = f"{DIAGNOSED_S / 60:.0f} min"
    measured.both(f"diagnosis, {minutes}", "s", diagnosed("--certify", "0"), 4.3)
    measured.both(f"diagnosis, {minutes}, with certificate", "s", diagnosed(), 2.0)


def _starts(measured: _Measured, runs: int) -> None:
    """Measure the start of the interpreter with the package, and with the command."""
    for name, words in {
        "import tpmsd": ["-c", "import tpmsd"],
        "tpmsd --help": ["-m", "tpmsd", "--help"],
    }.items():
        if measured.asked(name):
            spent = statistics.median(child(REPO, words)[0] for _ in range(2 * runs + 1))
            measured.alone(name, "s", spent, 0.12)


def _memory(measured: _Measured) -> None:
    """Measure the daemon's resident memory over `SOAK_H` hours of logical time with faults."""
    name = f"daemon, {SOAK_H:g} h, resident"
    if measured.asked(name):
        said = _printed(["-m", "tests.faults.soak", "--hours", str(SOAK_H)])
        found = re.search(r"memory: at most ([0-9.]+) MB", said)
        assert found is not None
        measured.alone(name, "MB", float(found[1]), 60.0)


def _fleet(measured: _Measured) -> None:
    """Measure workers against each other and against a plain loop; wall-clock times want an idle machine."""
    of_two, of_loop = "fleet, two workers over one", "fleet, plain loop over a worker, CPU"
    if measured.asked(of_two) or measured.asked(of_loop):
        result = _result("fleet", *FLEET)
        measured.alone(of_two, "x", result["speed_up_2_workers"], 1.85, at_least=True)
        measured.alone(of_loop, "x", 1.0 / result["cpu_over_plain_loop"], 0.92, at_least=True)


def _store(measured: _Measured) -> None:
    """Measure what is asked of a store of 100,000 drives, in seconds of wall-clock time."""
    names = {step: f"100,000 stored drives, {step}" for step in BARS_S}
    memory = "100,000 stored drives, memory"
    if any(measured.asked(name) for name in (memory, *names.values())):
        result = _result("fleet-scale")
        for step, name in names.items():
            measured.alone(name, "s", result[f"{step}_wall_s"], BARS_S[step])
        measured.alone(memory, "MB", max(result[f"{step}_peak_mb"] for step in BARS_S), MEMORY_MB)


def _printed(words: list[str]) -> str:
    """Return what a Python process in the repository prints."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, *words]
    return subprocess.run(
        command, cwd=REPO, env=environment, capture_output=True, check=True, text=True
    ).stdout


def _result(campaign: str, *options: str) -> dict[str, float]:
    """Return the figures of another campaign, which runs in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "result.json"
        _printed(["-m", "bench", "run", campaign, *options, "--json", str(file)])
        found: dict[str, float] = json.loads(file.read_text())
    return found
