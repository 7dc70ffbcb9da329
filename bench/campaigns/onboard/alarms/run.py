"""Regulation scenarios, confounders and false alarms per kilometre, on drives of a world of its own.

    make bench-alarms                              some minutes on two cores
    make bench-alarms BENCH_ARGS="--full"          60 cars of 10 cases, 20,000 km without a fault: hours
    make bench-alarms BENCH_ARGS="--campaign"      20,000 km without a fault, few cases: 45 min of two cores
    make bench-alarms BENCH_ARGS="--held-out"      other cars, routes and receivers: for the end alone
    python -m bench run alarms --one development/3/r141-puncture-fl-fast-city
    python -m bench run alarms --one development/life/3/5 --write FOLDER

Results are appended to OUT/results.jsonl; what stands there for the present state of the program is not
done again.
"""

from __future__ import annotations

import argparse
import json
import os
import traceback
from functools import partial
from pathlib import Path
from typing import Any

import tpmsd
from bench.campaigns.onboard.alarms.cases import CASES_PER_CAR, group
from bench.campaigns.onboard.alarms.figures import figures
from bench.campaigns.onboard.alarms.lives import SLIPPERY_OF, kinds, life, slippery
from bench.campaigns.onboard.alarms.one import one
from bench.campaigns.onboard.alarms.recorded import play_recordings
from bench.campaigns.onboard.alarms.score import play_group, play_life
from bench.campaigns.onboard.alarms.text import markdown, page
from bench.places import OUT, RECORDINGS, REPO
from bench.registry import UsageError
from bench.runner import code_state, last_state, resume
from tpmsd.car.config.model import FILTER_METHODS

Row = dict[str, Any]
Unit = tuple[str, str, int, int]
"""What (cases, life, kinds, one of `SLIPPERY_OF`, recordings), pool, seed, and for cases how many."""
LIFE_KM = 230.0
"""What a life has on average; for the plan alone."""


def plan(args: argparse.Namespace) -> list[Unit]:
    """Units of work, cases and lives in turns, so that a run cut short has seen something of all."""
    pool = "held-out" if args.held_out else "development"
    first = args.seed * 1000
    cases: list[Unit] = [("cases", pool, first + k, args.cases) for k in range(args.cars)]
    lives: list[Unit] = [("life", pool, first + k, 0) for k in range(round(args.km / LIFE_KM))]
    every: list[Unit] = [("kinds", pool, first + k, 0) for k in range(args.kinds)]
    slipping = "slippery" if args.driven is None else f"slippery-{args.driven}"
    low: list[Unit] = [(slipping, pool, first + k, 0) for k in range(args.slippery)]
    plans = (cases, lives, every, low)
    turns = [((k + 0.5) / len(units), unit) for units in plans for k, unit in enumerate(units)]
    recorded: list[Unit] = [] if args.held_out else [("recordings", str(args.recordings), 0, 0)]
    return recorded + [unit for _, unit in sorted(turns)]


def work(unit: Unit, memory: Path | None = None, method: str | None = None) -> list[Row]:
    """The rows of a unit, with an estimator instead of the default; its own failure is a row as well."""
    what, pool, seed, number = unit
    rows: list[Row] = []
    try:
        if what == "cases":
            rows += play_group(group(pool, seed, number), memory, method)
        elif what == "life":
            rows += play_life(life(pool, seed), pool, seed, memory, method=method)
        elif what == "kinds":
            rows += play_life(kinds(pool, seed), pool, seed, memory, what, method)
        elif what in SLIPPERY_OF:
            rows += play_life(slippery(pool, seed, SLIPPERY_OF[what]), pool, seed, memory, what, method)
        else:
            rows += play_recordings(Path(pool), method)
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"
        rows.append({"what": "failed", "name": f"{what} {pool}/{seed}", "error": text})
    return rows


def state_of_code() -> str:
    """Checksum of the program and of the worlds that try it."""
    program = Path(tpmsd.__file__).resolve().parent
    return code_state(program, Path(__file__).resolve().parent, REPO / "bench" / "worlds")


def run(args: argparse.Namespace) -> list[Row]:
    """Do what is not done yet; the rows of the whole plan."""
    state = state_of_code() + ("" if args.method is None else f" {args.method}")

    def after(done: dict[str, list[Row]]) -> None:
        if args.failures is not None:
            args.failures.write_text(failing(done, state), encoding="utf-8")

    found = resume(
        *(
            args.out / "results.jsonl",
            state,
            plan(args),
            partial(work, memory=args.remember, method=args.method),
            _line,
        ),
        jobs=args.jobs,
        minutes=args.minutes,
        after=after,
    )
    return [row for _, rows in found for row in rows]


def _line(unit: Unit, rows: list[Row]) -> str:
    cases = [row for row in rows if row["what"] == "case"]
    legs = [row for row in rows if row["what"] == "leg"]
    failed = [row["error"] for row in rows if row["what"] == "failed"]
    text = f"{unit[0]} {Path(unit[1]).name}/{unit[2]}"
    if cases:
        text += f": {sum(row['detected'] for row in cases)} of {len(cases)} detected"
    if legs:
        false = sum(len(row["deflation"]) for row in legs)
        text += f": {sum(row['km'] for row in legs):.0f} km, {false} false"
    return text + (f"; FAILED: {failed[0]}" if failed else "")


def failing(done: dict[str, list[Row]], state: str) -> str:
    """What went wrong, each with the command that shows it again."""
    lines = [f"# What went wrong with the program at state {state}", ""]
    show = "python -m bench run alarms --one"
    for rows in done.values():
        for row in rows:
            if row["what"] == "failed":
                lines.append(f"- {row['name']}: {row['error']}")
            if row["what"] == "case" and not row["detected"]:
                lines.append(f"- missed: `{show} {row['name']}`: {row['reason']}")
            if row["what"] == "case" and row["detected"] and not row["right_wheel"]:
                lines.append(
                    f"- wrong wheel: `{show} {row['name']}`: named {row['named']}, soft {row['wheels']}"
                )
            if row["what"] == "leg":
                for kind in ("deflation", "radius_deviation"):
                    for at, wheels, _ in row[kind]:
                        text = f"`{show} {row['name']}` ({row['tags']})"
                        lines.append(f"- false {kind} of {wheels} at {at:.0f} s: {text}")
    return "\n".join(lines) + "\n"


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument(
        "--full", action="store_true", help="60 cars of scenarios and 20,000 km; run again to go on"
    )
    parser.add_argument(
        "--campaign", action="store_true", help="20,000 km without a fault, few cases; run again to go on"
    )
    parser.add_argument("--held-out", action="store_true", help="the other half: run it once, at the end")
    parser.add_argument(
        "--cars", type=int, help="cars whose cases are played (default: 6, full: 60, campaign: 4)"
    )
    parser.add_argument("--cases", type=int, default=CASES_PER_CAR, help="cases of each car, at most 10")
    parser.add_argument(
        "--km", type=float, help="kilometres without a fault (default: 600, full and campaign: 20000)"
    )
    parser.add_argument("--kinds", type=int, default=1, help="cars that meet each confounder alone")
    parser.add_argument("--slippery", type=int, default=0, help="cars on ice, snow and gravel alone")
    parser.add_argument(
        "--driven",
        choices=("front", "rear", "all"),
        help="with --slippery: axles, in place of each car's own",
    )
    parser.add_argument("--seed", type=int, default=1, help="other cars, roads and noise")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="processes (default: one per core)"
    )
    parser.add_argument("--minutes", type=float, help="stop after this time; run again to go on")
    parser.add_argument("--report-only", action="store_true", help="play nothing: report what is there")
    parser.add_argument("--failures", type=Path, metavar="FILE", help="keep a list of what went wrong here")
    parser.add_argument(
        "--remember",
        type=Path,
        metavar="FOLDER",
        help="keep the estimates here, 0.3 GB per 1000 km: another monitor takes a sixth of the time",
    )
    parser.add_argument(
        "--method", choices=FILTER_METHODS, help="an estimator instead of the default, in a folder of its own"
    )
    parser.add_argument("--out", type=Path, default=OUT / "alarms")
    parser.add_argument("--recordings", type=Path, default=RECORDINGS, help="folder of real drives")
    parser.add_argument("--one", metavar="NAME", help="play one case or one leg of a life again, and say all")
    parser.add_argument(
        "--write", type=Path, metavar="FOLDER", help="with --one: write it as a drive folder instead"
    )


def report(out: Path) -> str:
    """The tables of each half that stands in a folder; UsageError where there is none."""
    text = []
    for half, title in (("held-out", "Held-out half"), ("development", "Development half")):
        if (out / half / "results.jsonl").exists():
            rows = [row for unit in last_state(out / half / "results.jsonl") for row in unit]
            text += [f"### {title}", "", page(figures(rows))]
    if not text:
        raise UsageError(f"no results in {out}")
    return "\n".join(text)


def main(args: argparse.Namespace) -> int:
    """Play, write what was found, print it."""
    if args.one is not None:
        try:
            print(one(args.one, args.write))
        except ValueError as error:
            raise UsageError(str(error)) from None
        return 0
    if args.cars is None:
        args.cars = 60 if args.full else 4 if args.campaign else 6
    if args.km is None:
        args.km = 20_000.0 if args.full or args.campaign else 600.0
    folder = args.out if args.method is None else args.out.with_name(f"{args.out.name}-{args.method}")
    args.out = folder.resolve() / ("held-out" if args.held_out else "development")
    if args.report_only:
        rows = [row for unit in last_state(args.out / "results.jsonl") for row in unit]
        if not rows:
            raise UsageError(f"no results in {args.out}")
    else:
        rows = run(args)
    found = figures(rows)
    text = markdown(found)
    (args.out / "summary.json").write_text(json.dumps(found, indent=1), encoding="utf-8")
    (args.out / "summary.md").write_text(text, encoding="utf-8")
    from bench.campaigns.onboard.alarms.plots import plot

    plot(rows, args.out / "alarms.png")
    print(text)
    return 1 if found["failed"] else 0
