"""The same smoke tests and the same drive on aarch64, under qemu-user: `make test-qemu`.

In: nothing. Out: how the tests went; radii and alarms of one drive on both processors; instructions per tick
on both. 1 if a test failed or the drives differ. Skipped, with the reason, where QEMU, mmdebstrap, a compiler
or a network are missing. Not part of CI: emulation takes minutes.

Instructions are counted by a plugin of QEMU, on both processors alike; two drives of different length tell a
tick's from those of the start. They are no times: a core's instructions per second are another matter.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.qemu.root import RootError, make

REPO = Path(__file__).resolve().parents[2]
BUILD = REPO / "build" / "qemu"
MACHINE, DEBIAN, PYTHON = "aarch64", "arm64", "3.11"
SMOKE = (
    *("tests/onboard/gnss/test_nmea_checks.py", "tests/onboard/sources_can/test_can_decoder.py"),
    *("tests/onboard/timeline/test_timeline.py", "tests/onboard/estimators/test_batched_kalman.py"),
    "tests/onboard/monitor/test_signal_watch.py",
)
SHORT_S, LONG_S = 40, 120
PUNCTURE = ("--puncture", "rl", "--loss-percent", "2", "--at", "50", "--over", "10")
SAME_MM = 1e-3
"""Radii are compared to a micrometre: fused multiply-add and other sums round differently, and the filter
hands that on."""
SAME_S = 0.11
"""An alarm may come a tick sooner."""
NEEDED = ("qemu-aarch64", "qemu-x86_64", "mmdebstrap", "cc")


@dataclass(frozen=True)
class Processor:
    """How Python is run on one of them."""

    name: str
    python: tuple[str, ...]
    emulator: tuple[str, ...]
    packages: str = ""

    def run(self, *arguments: str, counted: Path | None = None) -> subprocess.CompletedProcess[str]:
        """Run Python; `counted`: where the number of its instructions goes."""
        plugin = [] if counted is None else ["-plugin", f"{BUILD / 'count.so'},out={counted}"]
        native = counted is None and self.name == os.uname().machine
        command = [
            *([] if native else [self.emulator[0], *plugin, *self.emulator[1:]]),
            *self.python,
            *arguments,
        ]
        path = os.pathsep.join(filter(None, (str(REPO), self.packages)))
        environment = {**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        return subprocess.run(command, env=environment, cwd=REPO, capture_output=True, text=True)


def drive(seconds: int) -> Path:
    """A simulated drive of that length, with a puncture if it is the long one."""
    folder = BUILD / f"drive-{seconds}"
    shutil.rmtree(folder, ignore_errors=True)
    fault = PUNCTURE if seconds == LONG_S else ()
    route = ("--route", "rural", "--duration", str(seconds), "--seed", "3")
    subprocess.run(
        [sys.executable, "-m", "tpmsd", "simulate", str(folder), *route, *fault], check=True, cwd=REPO
    )
    file = folder / "vehicle.toml"
    file.write_text(file.read_text("utf-8") + "\n[monitor]\nlearn_s = 20.0\n", "utf-8")
    return folder


def replayed(on: Processor, folder: Path) -> tuple[dict[str, Any], int]:
    """What a replay says there, and its instructions."""
    counted, report = BUILD / "count", BUILD / f"{folder.name}-{on.name}.json"
    done = on.run("-m", "tpmsd", "replay", str(folder), "--json", str(report), counted=counted)
    if done.returncode:
        raise SystemExit(f"{on.name}: replay failed: {done.stderr[-2000:]}")
    document: dict[str, Any] = json.loads(report.read_text("utf-8"))
    return document, int(counted.read_text("ascii"))


def farthest_mm(one: dict[str, Any], other: dict[str, Any]) -> float:
    """The greatest difference of a radius or its standard deviation."""
    return max(
        abs(entry[key] - other["wheels"][wheel][key])
        for wheel, entry in one["wheels"].items()
        for key in ("deviation_mm", "std_mm")
    )


def differences(one: dict[str, Any], other: dict[str, Any]) -> list[str]:
    """In what two replays of a drive differ by more than rounding."""
    apart_mm = farthest_mm(one, other)
    reported = [] if apart_mm <= SAME_MM else [f"radii differ by up to {apart_mm:g} mm"]
    alarms = [[(a["kind"], a["wheel"], a["state"]) for a in d["alarms"]] for d in (one, other)]
    if alarms[0] != alarms[1]:
        reported.append(f"alarms: {alarms[0]} and {alarms[1]}")
    elif any(
        abs(a["time"] - b["time"]) > SAME_S for a, b in zip(one["alarms"], other["alarms"], strict=True)
    ):
        reported.append("alarms at other times")
    return reported


def main() -> int:
    """Tests, comparison, count."""
    if missing := [name for name in NEEDED if shutil.which(name) is None]:
        print(f"test-qemu: skipped: {', '.join(missing)} not installed (qemu-user mmdebstrap gcc)")
        return 0
    try:
        system, packages = make(BUILD / MACHINE, DEBIAN, MACHINE, PYTHON)
    except RootError as error:
        print(f"test-qemu: skipped: {error}")
        return 0
    source = Path(__file__).with_name("count.c")
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", BUILD / "count.so", source], check=True)
    there = Processor(
        MACHINE,
        (str(system / "usr" / "bin" / f"python{PYTHON}"),),
        (f"qemu-{MACHINE}", "-L", str(system)),
        str(packages),
    )
    # A virtual environment's own Python finds its packages; the emulator runs the file behind it.
    here = Processor(
        "x86_64", (sys.executable,), ("qemu-x86_64", "-cpu", "max"), sysconfig.get_path("purelib")
    )
    # Hypothesis' own profile for slow machines: no deadline, and no complaint that examples take long.
    options = ("-q", "-x", "-p", "no:cacheprovider", "--hypothesis-profile=ci")
    done = there.run("-m", "pytest", *options, *SMOKE)
    print(f"{MACHINE}: {done.stdout.strip().splitlines()[-1] if done.stdout else done.stderr[-500:]}")
    bad = done.returncode != 0
    if bad:
        print(done.stdout[-4000:])
    drives, counts = {s: drive(s) for s in (SHORT_S, LONG_S)}, {}
    documents: dict[str, dict[str, Any]] = {}
    for processor in (here, there):
        found = {s: replayed(processor, folder) for s, folder in drives.items()}
        documents[processor.name] = found[LONG_S][0]
        ticks = 10 * (LONG_S - SHORT_S)
        counts[processor.name] = (found[LONG_S][1] - found[SHORT_S][1]) / ticks
        print(f"{processor.name}: {1e-6 * counts[processor.name]:.2f} million instructions per tick")
    print(f"{MACHINE} against x86_64: {counts[MACHINE] / counts['x86_64']:.2f} times the instructions")
    apart = differences(documents["x86_64"], documents[MACHINE])
    alarms = [(a["kind"], a["wheel"], a["state"]) for a in documents[MACHINE]["alarms"]]
    farthest = farthest_mm(documents["x86_64"], documents[MACHINE])
    print("\n".join(apart or [f"radii within {farthest:.1g} mm, alarms {alarms}"]))
    return 1 if bad or apart or not alarms else 0


if __name__ == "__main__":
    sys.exit(main())
