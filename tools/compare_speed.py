"""Compare the CPU time of `tpmsd` on one drive in two environments, run in turn: equal within a share.

In: two Python interpreters that have the package, a drive folder. Out: a line per command; exit 1 where the
first takes longer than the second by more than `--within`, or where a kernel is missing in one of them. The
least of the runs counts: other work on the machine only lengthens them.

    python tools/compare_speed.py ENV/bin/python .venv/bin/python DRIVE
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

COMMANDS = {
    "replay": ["replay", "DRIVE", "--json", "replay.json"],
    "diagnose": ["diagnose", "DRIVE", "--certify", "0", "--model-out", "model.toml"],
}


def said(python: str, words: list[str], folder: str) -> str:
    """Return what a command of the package prints on standard output."""
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    environment = {**os.environ, **threads}
    environment.pop("PYTHONPATH", None)
    command = [python, "-P", "-m", "tpmsd", *words]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
    return done.stdout


def cpu_s(python: str, words: list[str]) -> float:
    """Return the CPU seconds of a command in an empty folder, the interpreter's start included."""
    with tempfile.TemporaryDirectory() as folder:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        said(python, words, folder)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def compared(pythons: tuple[str, str], words: list[str], runs: int) -> tuple[float, float]:
    """Return the least CPU seconds of a command in either environment."""
    pairs = [tuple(cpu_s(python, words) for python in pythons) for _ in range(runs)]
    return min(one for one, _ in pairs), min(other for _, other in pairs)


def main() -> int:
    """Compare and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("first", type=os.path.abspath, help="Python of the environment in question")
    parser.add_argument("second", type=os.path.abspath, help="Python of the one that it is held against")
    parser.add_argument("drive", type=os.path.abspath, help="drive folder")
    parser.add_argument("--runs", type=int, default=5, help="runs of each command in either (default: 5)")
    parser.add_argument("--within", type=float, default=0.05, help="share of time beyond (default: 0.05)")
    args = parser.parse_args()
    pythons = (args.first, args.second)
    kernels = [said(python, ["--version"], str(Path.cwd())).strip() for python in pythons]
    if not all("(kernel: compiled)" in kernel for kernel in kernels):
        print(f"not both have kernels: {' and '.join(kernels)}", file=sys.stderr)
        return 1
    slower = False
    for name, words in COMMANDS.items():
        cpu_s(pythons[0], [word.replace("DRIVE", args.drive) for word in words])  # its modules are compiled
        first, second = compared(pythons, [word.replace("DRIVE", args.drive) for word in words], args.runs)
        print(f"{name:<9} {first:6.2f} s against {second:6.2f} s: {first / second:.3f}")
        slower |= first > (1.0 + args.within) * second
    return int(slower)


if __name__ == "__main__":
    sys.exit(main())
