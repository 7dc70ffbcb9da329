"""Peak memory of `tpmsd diagnose` over a number of drives of one car.

    python -m bench run diagnosis-memory [--drives 1 5 15] [--minutes 10]

Drives of the kinematic world with a little growth with speed, each diagnosed in a process of its own, without
certificate. Out: the largest resident set of each process (VmHWM), its CPU time, and megabytes per drive: the
slope of a line through the peaks, which says whether memory is linear in the number of drives.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.places import REPO
from bench.registry import UsageError
from bench.worlds.folder import write_folder
from bench.worlds.kinematic import Spec, drive

GROWTH = {"centrifugal_growth": {"coefficient": 1.5e-6}}


@dataclass(frozen=True)
class Peak:
    """One process."""

    drives: int
    megabytes: float
    cpu_s: float

    def line(self) -> str:
        """For people."""
        return f"{self.drives:>6} {self.megabytes:>8.0f} MB {self.cpu_s:>8.1f} s"


def peak(folders: list[Path]) -> Peak:
    """Diagnose these drives together."""
    words = [sys.executable, "-m", "tpmsd", "diagnose", *map(str, folders), "--certify", "0"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with subprocess.Popen(
        words, env=environment, cwd=REPO, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise UsageError(f"tpmsd diagnose of {len(folders)} drives ended with {process.returncode}")
    return Peak(len(folders), used.ru_maxrss / 1024.0, used.ru_utime + used.ru_stime)


def slope(peaks: list[Peak]) -> float:
    """Megabytes per further drive, by least squares; NaN of a single number of drives."""
    drives = np.array([one.drives for one in peaks], dtype=np.float64)
    if np.ptp(drives) == 0.0:
        return float("nan")
    return float(np.polyfit(drives, [one.megabytes for one in peaks], 1)[0])


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--drives", metavar="N", type=int, nargs="+", default=[1, 5, 15])
    parser.add_argument("--minutes", metavar="MIN", type=float, default=10.0, help="of each drive")


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Measure and print."""
    if min(args.drives) < 1 or args.minutes < 5.0:
        raise UsageError("at least one drive of at least five minutes")
    out = sys.stderr if args.json == "-" else sys.stdout
    print(f"{'drives':>6} {'VmHWM':>11} {'CPU':>10}", file=out)
    with tempfile.TemporaryDirectory() as name:
        folders = [Path(name) / f"drive-{number}" for number in range(max(args.drives))]
        for seed, folder in enumerate(folders, start=1):
            write_folder(drive(Spec(duration_s=60.0 * args.minutes, physics=GROWTH), seed), folder)
        peaks = []
        for number in args.drives:
            peaks.append(peak(folders[:number]))
            print(peaks[-1].line(), file=out, flush=True)
    print(f"{slope(peaks):.1f} MB per further drive", file=out)
    return {"peaks": peaks, "megabytes_per_drive": slope(peaks), "minutes": args.minutes}
