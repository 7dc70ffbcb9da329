"""The coverage-guided run: `make fuzz`. Each target gets a process of its own and so many seconds.

In: seconds per target, names of targets. Out: a line per target; findings and the corpus below build/fuzz.
Exit code 1 if there is a finding. Needs the extra `fuzz` (atheris).

    python -m tests.fuzz.run --seconds 120 nmea toml
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from pathlib import Path

BUILD = Path("build/fuzz")
MEMORY_MB = 700
TIMEOUT_S = 10


def fuzz(name: str, seconds: int) -> None:
    """Fuzz one target in this process, which ends with it."""
    import atheris

    with atheris.instrument_imports(include=["tpmsd", "tomllib", "can.io", "json"]):
        from tests.fuzz.targets import SEEDS, TARGETS

        seeds = SEEDS[name]()
    corpus = BUILD / name
    corpus.mkdir(parents=True, exist_ok=True)
    for number, seed in enumerate(seeds):
        (corpus / f"seed-{number}").write_bytes(seed)
    options = [
        sys.argv[0],
        f"-max_total_time={seconds}",
        f"-timeout={TIMEOUT_S}",
        f"-rss_limit_mb={MEMORY_MB}",
        "-max_len=8192",
        f"-artifact_prefix={BUILD}/{name}-",
        "-print_final_stats=1",
        str(corpus),
    ]
    atheris.Setup(options, TARGETS[name])
    atheris.Fuzz()


def main() -> int:
    """Run the targets one after the other."""
    parser = argparse.ArgumentParser(description="coverage-guided fuzzing of all that takes bytes")
    parser.add_argument("--seconds", type=int, default=60, help="for each target")
    parser.add_argument("--one", metavar="TARGET", help=argparse.SUPPRESS)
    parser.add_argument("targets", nargs="*", help="default: all")
    args = parser.parse_args()
    if args.one is not None:
        fuzz(args.one, args.seconds)
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
    failed = 0
    for name in args.targets or sorted(TARGETS):
        command = [sys.executable, "-m", "tests.fuzz.run", "--one", name, "--seconds", str(args.seconds)]
        log = BUILD / f"{name}.log"
        with log.open("wb") as out:
            code = subprocess.run(command, stdout=out, stderr=subprocess.STDOUT).returncode
        text = log.read_text("utf-8", "replace")
        runs = re.findall(r"number_of_executed_units: *(\d+)", text) or ["?"]
        peak = re.findall(r"peak_rss_mb: *(\d+)", text) or ["?"]
        edges = re.findall(r"cov: (\d+)", text) or ["?"]
        said = "no finding" if code == 0 else f"FINDING, see {log}"
        print(f"{name:10s} {runs[-1]:>9s} runs  {edges[-1]:>6s} edges  {peak[-1]:>5s} MB  {said}", flush=True)
        failed += code != 0
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
