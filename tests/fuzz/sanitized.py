"""Runs the tests of the compiled parts under AddressSanitizer and UndefinedBehaviorSanitizer.

In: the C files of `setup.py`, gcc. Out: what pytest says; exit code 1 where a test or a sanitizer failed, 0
with a line where gcc or its sanitizers are not installed. The parts are built into a copy,
build/sanitized.

    python -m tests.fuzz.sanitized
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

from tpmsd.foundation.kernels import FILES, sources_number

REPO = Path(__file__).resolve().parents[2]
TREE = REPO / "build" / "sanitized"
TESTS = (
    "tests/onboard/estimators/test_bank_kernel.py",
    "tests/offline/inference/test_gains.py",
    "tests/onboard/sources_can/test_candump_text.py",
    "tests/onboard/gnss/test_nmea_kernel.py",
    "tests/onboard/monitor/test_evidence_kernel.py",
)
FLAGS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=undefined", "-fno-omit-frame-pointer")


def library(name: str) -> Path | None:
    """Return the sanitizer's run-time library of gcc, None where there is none."""
    if shutil.which("gcc") is None:
        return None
    said = subprocess.run(["gcc", f"-print-file-name={name}"], capture_output=True, text=True, check=True)
    path = Path(said.stdout.strip())
    return path.resolve() if path.is_absolute() else None


def build(folder: Path) -> None:
    """Compile the parts into a copy of the package in `folder`."""
    shutil.rmtree(folder, ignore_errors=True)
    ignore = shutil.ignore_patterns("__pycache__", "*.so")
    for name in ("tpmsd", "tests", "dbc"):
        shutil.copytree(REPO / name, folder / name, ignore=ignore)
    shutil.copy(REPO / "pyproject.toml", folder)
    include = f"-I{sysconfig.get_paths()['include']}"
    for name, file in FILES.items():
        part = f"tpmsd/{file}"
        files = [f"{part}.c", "-o", f"{part}.abi3.so", "-lm"]
        number = f"-DTPMSD_SOURCES={sources_number(folder / 'tpmsd', name)}"
        options = ["-shared", "-fPIC", "-O1", "-g", "-ffp-contract=off", *FLAGS, include, number]
        subprocess.run(["gcc", *options, *files], cwd=folder, check=True)


def environment(folder: Path, preload: Path) -> dict[str, str]:
    """Return the environment in which the copy runs; Python's own allocations are no leaks."""
    return {
        **os.environ,
        "PYTHONPATH": str(folder),
        "LD_PRELOAD": str(preload),
        "ASAN_OPTIONS": "detect_leaks=0:abort_on_error=0",
        "UBSAN_OPTIONS": "print_stacktrace=1",
        "PYTHONMALLOC": "malloc",
    }


def main() -> int:
    """Build, and run the tests."""
    preload = library("libasan.so")
    if preload is None or library("libubsan.so") is None:
        print("sanitizers: skipped: gcc with libasan and libubsan is not installed")
        return 0
    build(TREE)
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", *TESTS]
    return subprocess.run(command, cwd=TREE, env=environment(TREE, preload)).returncode


if __name__ == "__main__":
    sys.exit(main())
