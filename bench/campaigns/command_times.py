"""CPU time of the commands that a user waits for, each as a ratio to `replay` of the same run.

In: nothing; a drive of 10 min is simulated. Out: a table of medians in seconds with bars, and JSON with
`--json FILE`. Each command is a process of its own, the interpreter's start included; other work on the
machine lengthens what elapses, hence CPU time. `web` counts until the page has answered.

    python -m bench run command-times --runs 3
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bench.places import REPO
from bench.registry import UsageError
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.offline.simulator.faults import Fault

DRIVE_S = 600.0
BARS_S: dict[str, float | None] = {
    "replay": None,
    "discover --dbc": 2.0,
    "check": 0.4,
    "explain": 8.0,
    "web": 4.0,
}
"""Seconds that each command may take on an idle machine; None where the others are related to it."""


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--runs", metavar="N", type=int, default=3, help="runs per command (default: 3)")
    parser.add_argument("--drive-s", metavar="S", type=float, default=DRIVE_S, help="length of the drive")


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Measure and print."""
    if args.runs < 1 or args.drive_s < 90.0:
        raise UsageError("at least one run, and a drive of at least 90 s")
    out = sys.stderr if args.json == "-" else sys.stdout
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "drive"
        leak = Fault("leak", 1.0, "percent", "rl", 0.4 * args.drive_s, 0.2 * args.drive_s)
        write_drive(folder, simulate_drive(DriveSpec(duration_s=args.drive_s, seed=11, faults=(leak,))))
        rounds = [measured(folder) for _ in range(args.runs)]
    median = {command: statistics.median(one[command] for one in rounds) for command in BARS_S}
    print(f"{'command':<16} {'CPU s':>7} {'/ replay':>9} {'bar (s)':>8}", file=out)
    for command, bar_s in BARS_S.items():
        ratio = median[command] / median["replay"]
        bar = "-" if bar_s is None else f"{bar_s:g}"
        print(f"{command:<16} {median[command]:7.2f} {ratio:9.3f} {bar:>8}", file=out)
    return {"cpu_s": median, "bars_s": BARS_S, "runs": args.runs}


def measured(folder: Path) -> dict[str, float]:
    """CPU seconds of each command on the drive in `folder`."""
    drive = str(folder)
    words = {
        "replay": ["replay", drive],
        "discover --dbc": ["discover", drive, "--dbc", str(folder / "bus.dbc")],
        "check": ["check", str(folder / "vehicle.toml")],
        "explain": ["explain", drive],
    }
    found = {name: cpu_s(lambda command=command: _run(command)) for name, command in words.items()}  # type: ignore[misc]
    return {**found, "web": cpu_s(lambda: _serve(drive))}


def cpu_s(run: Callable[[], None]) -> float:
    """CPU seconds of the processes that `run` starts and awaits."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    run()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _start(words: list[str]) -> subprocess.Popen[str]:
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, "-m", "tpmsd", *words],
        env=environment,
        cwd=REPO,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def _run(words: list[str]) -> None:
    """Run a command to its end; 4 says that `discover` could not decide a wheel."""
    process = _start(words)
    said, _ = process.communicate()
    if process.returncode not in (0, 4):
        raise RuntimeError(f"tpmsd {' '.join(words)}: {said[-400:]}")


def _serve(drive: str) -> None:
    """Start the page of a drive, load it once, end the server."""
    process = _start(["web", drive, "--port", "0"])
    try:
        assert process.stdout is not None
        line = next((line for line in process.stdout if "http://" in line), "")
        url = next((word for word in line.split() if word.startswith("http://")), "")
        if not url:
            raise RuntimeError("tpmsd web has named no address")
        with urllib.request.urlopen(url) as page:
            page.read()
    finally:
        process.terminate()
        process.communicate()
