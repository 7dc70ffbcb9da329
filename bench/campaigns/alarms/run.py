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
import hashlib
import json
import os
import sys
import time
import traceback
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import tpmsd
from bench.campaigns.alarms.cases import CASES_PER_CAR, group
from bench.campaigns.alarms.figures import figures
from bench.campaigns.alarms.lives import kinds, life
from bench.campaigns.alarms.one import one
from bench.campaigns.alarms.recorded import play_recordings
from bench.campaigns.alarms.score import play_group, play_life
from bench.campaigns.alarms.text import markdown
from bench.places import OUT, RECORDINGS, REPO
from bench.registry import UsageError

Row = dict[str, Any]
Unit = tuple[str, str, int, int]
"""What (cases, life, kinds, recordings), pool, seed, and for cases how many."""
LIFE_KM = 230.0
"""What a life has on average; for the plan alone."""


def plan(args: argparse.Namespace) -> list[Unit]:
    """Units of work, cases and lives in turns, so that a run cut short has seen something of all."""
    pool = "held-out" if args.held_out else "development"
    first = args.seed * 1000
    cases: list[Unit] = [("cases", pool, first + k, args.cases) for k in range(args.cars)]
    lives: list[Unit] = [("life", pool, first + k, 0) for k in range(round(args.km / LIFE_KM))]
    every: list[Unit] = [("kinds", pool, first + k, 0) for k in range(args.kinds)]
    plans = (cases, lives, every)
    turns = [((k + 0.5) / len(units), unit) for units in plans for k, unit in enumerate(units)]
    recorded: list[Unit] = [] if args.held_out else [("recordings", str(args.recordings), 0, 0)]
    return recorded + [unit for _, unit in sorted(turns)]


def work(unit: Unit, memory: Path | None = None) -> list[Row]:
    """The rows of a unit; its own failure is a row as well."""
    what, pool, seed, number = unit
    rows: list[Row] = []
    try:
        if what == "cases":
            rows += play_group(group(pool, seed, number), memory)
        elif what == "life":
            rows += play_life(life(pool, seed), pool, seed, memory)
        elif what == "kinds":
            rows += play_life(kinds(pool, seed), pool, seed, memory, what)
        else:
            rows += play_recordings(Path(pool))
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"
        rows.append({"what": "failed", "name": f"{what} {pool}/{seed}", "error": text})
    return rows


def code_state() -> str:
    """Checksum of the program and of the worlds that try it."""
    digest = hashlib.sha256()
    program = Path(tpmsd.__file__).resolve().parent
    for root in (program, REPO / "bench" / "campaigns" / "alarms", REPO / "bench" / "worlds"):
        for path in sorted(root.rglob("*.py")):
            digest.update(path.name.encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def read_results(file: Path) -> list[Row]:
    """All lines; one that was cut off is left out."""
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    out = []
    for line in lines:
        try:
            out.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return out


def run(args: argparse.Namespace) -> list[Row]:
    """Do what is not done yet; the rows of the whole plan."""
    wanted, state = plan(args), code_state()
    file: Path = args.out / "results.jsonl"
    args.out.mkdir(parents=True, exist_ok=True)
    done: dict[Unit, list[Row]] = {
        tuple(entry["unit"]): entry["rows"] for entry in read_results(file) if entry["code"] == state
    }
    todo = [unit for unit in wanted if unit not in done]
    begun = time.monotonic()
    cut_off = file.exists() and not file.read_bytes().endswith(b"\n")
    with file.open("a", encoding="utf-8") as log:
        log.write("\n" if cut_off else "")
        for number, (unit, rows) in enumerate(_worked(todo, args.jobs, args.remember), start=1):
            log.write(json.dumps({"unit": unit, "code": state, "rows": rows}) + "\n")
            log.flush()
            done[unit] = rows
            spent = time.monotonic() - begun
            left = spent / number * (len(todo) - number) / 60.0
            print(
                f"{number}/{len(todo)}, {left:.0f} min left: {_line(unit, rows)}", file=sys.stderr, flush=True
            )
            if args.failures is not None:
                args.failures.write_text(failing(done, state), encoding="utf-8")
            if args.minutes and spent > 60.0 * args.minutes:
                print("time is up; the rest is left for another run", file=sys.stderr)
                break
    return [row for unit in wanted for row in done.get(unit, [])]


def _worked(todo: list[Unit], jobs: int, memory: Path | None) -> Iterator[tuple[Unit, list[Row]]]:
    if jobs == 1:
        for unit in todo:
            yield unit, work(unit, memory)
        return
    with ProcessPoolExecutor(jobs) as pool:
        try:
            waiting = {pool.submit(work, unit, memory): unit for unit in todo}
            for future in as_completed(waiting):
                yield waiting[future], future.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


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


def failing(done: dict[Unit, list[Row]], state: str) -> str:
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
        "--full", action="store_true", help="60 cars of cases and 20,000 km; run again to go on"
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
    parser.add_argument("--out", type=Path, default=OUT / "alarms")
    parser.add_argument("--recordings", type=Path, default=RECORDINGS, help="folder of real drives")
    parser.add_argument("--one", metavar="NAME", help="play one case or one leg of a life again, and say all")
    parser.add_argument(
        "--write", type=Path, metavar="FOLDER", help="with --one: write it as a drive folder instead"
    )


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
    args.out = args.out.resolve() / ("held-out" if args.held_out else "development")
    if args.report_only:
        entries = read_results(args.out / "results.jsonl")
        if not entries:
            raise UsageError(f"no results in {args.out}")
        rows = [row for entry in entries if entry["code"] == entries[-1]["code"] for row in entry["rows"]]
    else:
        rows = run(args)
    found = figures(rows)
    text = markdown(found)
    (args.out / "summary.json").write_text(json.dumps(found, indent=1), encoding="utf-8")
    (args.out / "summary.md").write_text(text, encoding="utf-8")
    from bench.campaigns.alarms.plots import plot

    plot(rows, args.out / "alarms.png")
    print(text)
    return 1 if found["failed"] else 0
