"""The coverage-guided run: `make fuzz`. Each target gets processes of its own and so many seconds.

In: seconds per target, names of targets. Out: a row of a table per target; findings and the corpus below
build/fuzz. Two of three inputs are changed in their form (`structure`), the third by libFuzzer itself. Exit
code 1 if there is a finding: an exception, a signal, a case of more than `TIMEOUT_S`, or a process, this one
or a native reader's, of `MEMORY_MB` more than this one has when it begins. Needs the extra `fuzz` (atheris).

    python -m tests.fuzz.run --seconds 120 --seed 7 nmea toml
"""

from __future__ import annotations

import argparse
import json
import math
import random
import re
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

BUILD = Path("build/fuzz")
MEMORY_MB = 300
TIMEOUT_S = 20
PART_S, PART_RUNS = 120, 15_000
"""A target's process ends after so long or so many cases, and another goes on: atheris keeps up to 15 kB of
its own for each case, which would stand for a leak of the target."""
MAX_BYTES = 65536
"""Size of an input, at most; the packed logs that are seeds take 10 kB."""
OWN = 1.0 / 3.0
"""Share of inputs that libFuzzer changes by itself, byte by byte."""


@dataclass
class Watched:
    """A target, with its longest case and its memory."""

    target: Callable[[bytes], None]
    out: Path
    began_kb: int = 0
    longest_s: float = 0.0
    peak_kb: int = 0
    child_kb: int = 0
    """Largest process of a native reader; the kernel counts the parent's size at its start into it."""

    def __call__(self, data: bytes) -> None:
        began = time.monotonic()
        self.target(data)
        took_s = time.monotonic() - began
        own_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        child_kb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
        self.began_kb = self.began_kb or own_kb
        if took_s > self.longest_s or own_kb > 1.02 * self.peak_kb or child_kb > 1.02 * self.child_kb:
            self.longest_s = max(self.longest_s, took_s)
            self.peak_kb, self.child_kb = own_kb, child_kb
            figures = {"longest_s": self.longest_s, "began_mb": self.began_kb / 1024}
            figures |= {"peak_mb": own_kb / 1024, "child_mb": child_kb / 1024}
            self.out.write_text(json.dumps(figures), "utf-8")
        more_kb = max(own_kb, child_kb) - self.began_kb
        if more_kb > 1024 * MEMORY_MB:
            raise MemoryError(f"{more_kb // 1024} MB more than at the beginning")


def fuzz(name: str, seconds: int, seed: int) -> None:
    """Fuzz one target in this process, which ends with it; a seed of 0 leaves the choice to libFuzzer."""
    import atheris

    with atheris.instrument_imports(include=["tpmsd", "tomllib", "can.io", "json"]):
        from tests.fuzz.structure import mutated
        from tests.fuzz.targets import SEEDS, TARGETS

        seeds = SEEDS[name]()

    def changed(data: bytes, max_bytes: int, draw: int) -> bytes:
        rng = random.Random(draw)
        if rng.random() < OWN:
            return bytes(atheris.Mutate(data, max_bytes))
        return mutated(name, bytes(data), rng, max_bytes)

    corpus = BUILD / name
    corpus.mkdir(parents=True, exist_ok=True)
    for number, sound in enumerate(seeds):
        (corpus / f"seed-{number}").write_bytes(sound)
    options = [
        sys.argv[0],
        f"-max_total_time={seconds}",
        f"-runs={PART_RUNS}",
        f"-seed={seed}",
        f"-timeout={TIMEOUT_S}",
        "-rss_limit_mb=2000",
        f"-max_len={MAX_BYTES}",
        f"-artifact_prefix={BUILD}/{name}-",
        "-print_final_stats=1",
        str(corpus),
    ]
    watched = Watched(TARGETS[name], BUILD / f"{name}.json")
    atheris.Setup(options, watched, custom_mutator=changed)
    atheris.Fuzz()


def main() -> int:
    """Run the targets one after the other."""
    parser = argparse.ArgumentParser(description="coverage-guided fuzzing of all that takes bytes")
    parser.add_argument("--seconds", type=int, default=60, help="for each target")
    parser.add_argument("--seed", type=int, default=0, help="of libFuzzer; 0: its own choice")
    parser.add_argument("--one", metavar="TARGET", help=argparse.SUPPRESS)
    parser.add_argument("targets", nargs="*", help="default: all")
    args = parser.parse_args()
    if args.one is not None:
        fuzz(args.one, args.seconds, args.seed)
        return 0
    try:
        import atheris  # noqa: F401
    except ImportError:
        print("fuzzing needs atheris: pip install 'tpmsd[fuzz]'", file=sys.stderr)
        return 2
    from tests.fuzz.targets import TARGETS

    unknown = sorted(set(args.targets) - set(TARGETS))
    if unknown:
        print(f"no such target: {' '.join(unknown)}; there are {' '.join(TARGETS)}", file=sys.stderr)
        return 2
    BUILD.mkdir(parents=True, exist_ok=True)
    print("Executions (edges) of each format:")
    failed, added_mb, longest_s = 0, {"?": 0.0}, {"?": 0.0}
    for name in args.targets or sorted(TARGETS):
        row, code, seen = played(name, args.seconds, args.seed)
        print(row, flush=True)
        failed += code != 0
        if seen:
            largest_mb = max(seen["peak_mb"], seen["child_mb"])
            added_mb[name], longest_s[name] = largest_mb - seen["began_mb"], seen["longest_s"]
    most, slow = (max(figures, key=figures.__getitem__) for figures in (added_mb, longest_s))
    print(
        f"\nMost memory beyond the imports, of the process or its readers': {added_mb[most]:.0f} MB ({most})."
    )
    print(f"Longest case: {longest_s[slow]:.2f} s ({slow}).")
    return 1 if failed else 0


def played(name: str, seconds: int, seed: int) -> tuple[str, int, dict[str, float]]:
    """Fuzz one target in processes of `PART_S`, one after the other over one corpus, until a finding; its
    row, the exit code, and its memory and longest case."""
    runs, edges, code, worst = 0, "?", 0, {}
    began_s, part = time.monotonic(), 0
    while (left_s := math.ceil(seconds - (time.monotonic() - began_s))) > 0 and not code:
        text, code, seen = _part(name, min(left_s, PART_S), seed and seed + part)
        part += 1
        executed = re.findall(r"number_of_executed_units: *(\d+)", text) or re.findall(r"^#(\d+)", text, re.M)
        runs += int(executed[-1]) if executed else 0
        edges = (re.findall(r"cov: (\d+)", text) or [edges])[-1]
        worst = {key: max(value, worst.get(key, 0.0)) for key, value in seen.items()}
    return f"{name} {runs} ({edges})" + (f": a finding, see {BUILD / name}.log" if code else ""), code, worst


def _part(name: str, seconds: int, seed: int) -> tuple[str, int, dict[str, float]]:
    """One process: its log, its exit code and its figures."""
    options = ["--one", name, "--seconds", str(seconds), "--seed", str(seed)]
    command = [sys.executable, "-m", "tests.fuzz.run", *options]
    log, figures = BUILD / f"{name}.log", BUILD / f"{name}.json"
    figures.unlink(missing_ok=True)
    with log.open("wb") as out:
        code = subprocess.run(command, stdout=out, stderr=subprocess.STDOUT).returncode
    seen = json.loads(figures.read_text("utf-8")) if figures.is_file() else {}
    return log.read_text("utf-8", "replace"), code, seen


if __name__ == "__main__":
    sys.exit(main())
