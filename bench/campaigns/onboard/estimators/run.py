"""Lundquist et al.'s (2013) comparison of estimators, and what goes beyond it.

    make bench-estimators                            a quarter of an hour on two cores
    make bench-estimators BENCH_ARGS="--full"        100 Monte-Carlo runs of everything: hours
    make bench-estimators BENCH_ARGS="--survive 10"  10 h of driving with stops, outages and resets
    make bench-estimators BENCH_ARGS="--only figures --images docs/images"  Figs 3 to 10 of what stands in OUT

Writes results.json, results.md and the figures to OUT (bench-out/estimators). Progress goes to standard
error.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from bench.campaigns.onboard.estimators import batches, recordings, speed, survive
from bench.campaigns.onboard.estimators.methods import available
from bench.campaigns.onboard.estimators.report import markdown
from bench.campaigns.onboard.estimators.tasks import LIMIT, Task, perform, plan
from bench.places import OUT, RECORDINGS, REPO
from bench.registry import UsageError
from bench.runner import code_state, each, resume

DEFAULT_RUNS = 6
FULL_RUNS = 100
MEASURED = (
    "tpmsd/onboard/estimators",
    "tpmsd/car/physics",
    "tpmsd/onboard/timeline",
    *(f"bench/campaigns/onboard/estimators/{name}.py" for name in ("methods", "play", "tasks", "limit")),
)


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    have = [*available()[0], LIMIT]
    parser.add_argument(
        "--full", action="store_true", help=f"{FULL_RUNS} Monte-Carlo runs instead of {DEFAULT_RUNS}"
    )
    parser.add_argument("--runs", type=int, metavar="N", help="that many Monte-Carlo runs")
    parser.add_argument("--methods", metavar="NAMES", default=",".join(have),
                        help="Monte-Carlo runs and survival of these methods alone (all)")  # fmt: skip
    parser.add_argument(
        "--jobs", type=int, metavar="N", default=os.cpu_count() or 1, help="processes (all cores)"
    )
    parser.add_argument("--out", type=Path, metavar="FOLDER", default=OUT / "estimators")
    parser.add_argument(
        "--only",
        metavar="PARTS",
        default="runs,batches,speed,recordings",
        help="of runs,batches,speed,recordings,figures (all); what stands in OUT of the same commit is kept",
    )
    parser.add_argument("--images", type=Path, metavar="FOLDER", help="also draw Figs 3 to 10 there, as SVG")
    parser.add_argument("--survive", type=float, metavar="HOURS", help="long drives, and nothing else")
    parser.add_argument("--seed", type=int, metavar="N", default=1, help="of the drives of --survive (1)")
    parser.add_argument("--recordings", type=Path, metavar="FOLDER", default=RECORDINGS,
                        help="drive folders (TPMSD_RECORDINGS, or ../shared/recordings)")  # fmt: skip
    parser.add_argument("--minutes", type=float, metavar="M", default=math.inf,
                        help="begin no Monte-Carlo run after that time (no limit)")  # fmt: skip


def checked(args: argparse.Namespace) -> argparse.Namespace:
    """The options with lists taken apart; UsageError where they make no sense."""
    args.parts = set(args.only.split(","))
    unknown = args.parts - {"runs", "batches", "speed", "recordings", "figures"}
    if unknown:
        raise UsageError(f"--only: unknown part {', '.join(sorted(unknown))}")
    args.methods = args.methods.split(",")
    strange = set(args.methods) - {*available()[0], LIMIT}
    if strange:
        raise UsageError(f"--methods: unknown method {', '.join(sorted(strange))}")
    args.runs = args.runs if args.runs is not None else FULL_RUNS if args.full else DEFAULT_RUNS
    if (
        args.runs < 1
        or args.jobs < 1
        or not args.minutes > 0.0
        or (args.survive is not None and args.survive <= 0.0)
    ):
        raise UsageError("--runs, --jobs, --minutes and --survive must be positive")
    return args


def spread(
    items: Sequence[Any], work: Callable[[Any], Any], label: Callable[[Any], str], jobs: int
) -> list[Any]:
    """Do all items in some processes; results in the order of the items."""
    results = {}
    for number, (item, result) in enumerate(each(items, work, jobs, apart=True), start=1):
        results[label(item)] = result
        print(f"[{number}/{len(items)}] {label(item)}", file=sys.stderr, flush=True)
    return [results[label(item)] for item in items if label(item) in results]


def play_all(tasks: list[Task], args: argparse.Namespace, state: str) -> list[dict[str, Any]]:
    """All Monte-Carlo runs; those that stand in OUT/rows.jsonl, of this commit, are not done again."""
    found = resume(
        *(args.out / "rows.jsonl", state, tasks, perform, lambda task, row: task.label),
        jobs=args.jobs,
        minutes=args.minutes,
        apart=True,
    )
    return [row for _, row in found]


def state_of_code() -> str:
    """Checksum of what is measured."""
    return code_state(*(REPO / part for part in MEASURED))


def commit() -> str:
    """The commit that last changed what is measured, so that runs outlive commits to other things; `-dirty`
    where it was changed since."""

    def git(*words: str) -> str:
        done = subprocess.run(["git", *words], cwd=REPO, capture_output=True, text=True, check=False)
        return done.stdout.strip()

    changed = git("status", "--porcelain", "--", *MEASURED)
    return (git("log", "-1", "--format=%h", "--", *MEASURED) or "unknown") + ("-dirty" if changed else "")


def report(out: Path) -> str:
    """The tables of what stands in a folder."""
    file = out / "results.json"
    if not file.exists():
        raise UsageError(f"no results in {out}")
    return markdown(json.loads(file.read_text(encoding="utf-8")))


def main(args: argparse.Namespace) -> int:
    """The bench; its exit code."""
    args = checked(args)
    begun = time.monotonic()
    have, missing = available()
    result: dict[str, Any] = {
        "commit": commit(),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
        "runs": args.runs,
        "methods": have,
        "missing": missing,
    }
    if missing:
        print(f"Not among this program's methods, so left out: {', '.join(missing)}", file=sys.stderr)
    args.out.mkdir(parents=True, exist_ok=True)
    if args.survive is not None:
        plans = [(method, args.survive, args.seed) for method in have if method in args.methods]
        result["survival"] = spread(plans, survive.survive, lambda p: f"{p[0]}: {p[1]:g} h", args.jobs)
        return finish(args.out, result, "survival", begun)
    if "speed" in args.parts:  # first, while nothing else of ours runs
        result["speed"] = speed.all_figures(args.full, lambda text: print(text, file=sys.stderr, flush=True))
    if "batches" in args.parts:
        found = spread(batches.plan(args.full), batches.perform, lambda b: b.label, args.jobs)
        result["batches"] = [row for rows in found for row in rows]
    if "recordings" in args.parts:
        drives = recordings.plan(args.recordings)
        if not drives:
            print(
                f"No recordings in {args.recordings}: that part is left out",
                file=sys.stderr,
            )
        result["recordings"] = spread(drives, recordings.perform, lambda r: r.label, args.jobs)
    if "runs" in args.parts:
        result["rows"] = play_all(
            [task for task in plan(args.runs) if task.method in args.methods], args, state_of_code()
        )
    return finish(args.out, result, "results", begun, args.images)


def earlier(path: Path, state: str) -> dict[str, Any]:
    """The parts that an earlier call with --only has left there, if of the same state of the program."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) and found.get("commit") == state else {}


def finish(out: Path, result: dict[str, Any], name: str, begun: float, images: Path | None = None) -> int:
    """Write JSON, Markdown and figures; print the Markdown."""
    before = earlier(out / f"{name}.json", result["commit"])
    result["elapsed_s"] = time.monotonic() - begun + before.get("elapsed_s", 0.0)
    result = before | result
    (out / f"{name}.json").write_text(json.dumps(result, default=float), encoding="utf-8")
    text = markdown(result)
    (out / f"{name}.md").write_text(text, encoding="utf-8")
    print(text)
    try:
        from bench.campaigns.onboard.estimators.figures import draw_all, draw_paper  # matplotlib is an extra
    except ImportError:
        print("No figures: they take the extra `plot`", file=sys.stderr)
    else:
        paper = draw_paper(result, images) if images is not None and result.get("rows") else []
        for path in [*draw_all(result, out), *paper]:
            print(f"Wrote {path}", file=sys.stderr)
    return 0
