"""Draws, writes, diagnoses and scores drives; prints what comes of it.

    make bench-diagnose                            a few minutes: a drive of each common kind
    make bench-diagnose BENCH_ARGS="--each"        a drive of each kind, the multi-body cars too: an hour
    make bench-diagnose BENCH_ARGS="--full"        200 null drives, 20 per effect and strength: a day
    python -m bench run diagnosis --write FOLDER --kind KIND --strength S --seed N

Results are appended to OUT/results.jsonl, one line per drive; what stands there for the present state of the
program is not done again.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import traceback
from functools import partial
from pathlib import Path
from typing import Any

from bench.campaigns.offline.diagnosis.draw import (
    CONCEALED,
    EFFECTS,
    MULTIBODY,
    STRANGE,
    TOGETHER,
    Case,
    draw_case,
)
from bench.campaigns.offline.diagnosis.make import make
from bench.campaigns.offline.diagnosis.report import failing, markdown, summary
from bench.campaigns.offline.diagnosis.score import score
from bench.campaigns.offline.diagnosis.seal import diagnosed
from bench.campaigns.offline.diagnosis.truth import truth_of
from bench.places import OUT, REPO
from bench.registry import UsageError
from bench.runner import code_state, last_state, resume

Entry = tuple[str, float, int]
"""Kind, strength and seed."""
Plan = list[Entry]


def _kinds(args: argparse.Namespace) -> list[str]:
    """Kinds that are named, else all of a full run, else the few of a short one."""
    if args.only:
        return list(args.only.split(","))
    if not (args.full or args.each):
        return ["nothing", *EFFECTS, *STRANGE[:3], *TOGETHER[:2], *CONCEALED[-2:]]
    kinds = ["nothing", "mb/nothing", "nothing_wander", *EFFECTS, *STRANGE, *TOGETHER, *CONCEALED]
    return kinds + [kind for kind in MULTIBODY if kind != "mb/nothing"]


def _strengths(kind: str, args: argparse.Namespace) -> list[float]:
    """Strengths of a kind: none of nothing; of several effects at once the larger ones, or the last."""
    if "nothing" in kind:
        return [0.0]
    strengths = [float(part) for part in args.strengths.split(",")]
    if args.only or not (kind in TOGETHER or kind in CONCEALED or "/" in kind):
        return strengths
    return [size for size in strengths if size >= 0.5] if args.full else strengths[-1:]


def plan(args: argparse.Namespace) -> Plan:
    """Kinds, strengths and seeds, interleaved so that a run cut short has seen something of all."""
    batches: list[list[tuple[str, float, int]]] = []
    for kind in _kinds(args):
        seeds = range(args.seed * 100_000, args.seed * 100_000 + _number(kind, args))
        batches += [[(kind, size, seed) for seed in seeds] for size in _strengths(kind, args)]
    # every batch is spread over the whole run, each from a beginning of its own (golden section)
    turns = [
        ((k + (number * 0.618034) % 1.0) / len(batch), entry)
        for number, batch in enumerate(batches)
        for k, entry in enumerate(batch)
    ]
    return [entry for _, entry in sorted(turns)]


def _number(kind: str, args: argparse.Namespace) -> int:
    if kind == "nothing":
        return int(args.clean)
    if "nothing" in kind:
        return max(1, int(args.clean) // 5)
    return int(args.per)


def one(entry: Entry, courses: Path, program: Path, replay: bool) -> dict[str, Any]:
    """Draw, make, diagnose and score a drive."""
    kind, strength, seed = entry
    begun = time.monotonic()
    case = draw_case(kind, strength, seed)
    made = make(case, courses)
    truth = truth_of(case, made.windows)
    answer, opened = diagnosed(made.drive, truth, program, replay)
    row = {
        "kind": kind,
        "strength": strength,
        "seed": seed,
        "world": case.world,
        "driving_s": opened.driving_s,
        "duration_s": case.spec.duration_s,
        "receiver": [case.spec.receiver_hz, case.spec.with_course, round(case.spec.doppler_age_s, 3)],
        "bus": [
            case.spec.wheel_signal,
            case.spec.wheel_hz,
            case.spec.teeth,
            case.spec.with_gyro,
            case.spec.with_accel,
        ],
        "error": answer.error,
        "beyond": round(opened.beyond, 1),
    }
    if not answer.error:
        row |= score(case, opened, answer.document, answer.model, made.windows)
        row |= {"cpu_s": round(answer.cpu_s, 2), "wall_s": round(answer.wall_s, 2)}
        row["found"] = [_short(finding) for finding in answer.document.get("findings", [])]
        row["reason"] = answer.document.get("reason") or ""
        row["alarms"] = answer.alarms
    row["truth"] = {each.key: each.parameters for each in opened.effects if not each.inherent}
    row["all_s"] = round(time.monotonic() - begun, 1)
    return row


def _short(finding: dict[str, Any]) -> dict[str, Any]:
    values = {name: [q["value"], q["std"]] for name, q in finding["parameters"].items()}
    return {
        "effect": finding["effect"],
        "confidence": finding["confidence"],
        "parameters": values,
        "where": finding["where"],
        "gain": finding["heldout"].get("loglik_gain"),
        "or": finding["indistinguishable_from"],
    }


def guarded(entry: Entry, courses: Path, program: Path, replayed: tuple[Entry, ...] = ()) -> dict[str, Any]:
    """`one`, whose own failure is a row as well."""
    try:
        return one(entry, courses, program, entry in replayed)
    except Exception:
        last = traceback.format_exc().strip().splitlines()
        return {
            **dict(zip(("kind", "strength", "seed"), entry, strict=True)),
            "error": f"benchmark: {last[-1]} ({last[-3].strip() if len(last) > 2 else ''})",
            "benchmark_fault": True,
        }


def run(args: argparse.Namespace, wanted: Plan) -> list[dict[str, Any]]:
    """Do what is not done yet; the rows of the whole plan."""
    state, courses = code_state(args.program / "tpmsd"), args.out / "courses"
    if any(kind.startswith(("mb/", "multibody/")) for kind, _, _ in wanted):
        from bench.worlds.multibody import prepare

        prepare(courses, lambda text: print(text, file=sys.stderr, flush=True))
    replayed = tuple(wanted[: args.alarms])

    def after(done: dict[str, dict[str, Any]]) -> None:
        if args.failures is not None:
            args.failures.write_text(failing(list(done.values()), state), encoding="utf-8")

    found = resume(
        args.out / "results.jsonl",
        state,
        wanted,
        partial(guarded, courses=courses, program=args.program, replayed=replayed),
        lambda entry, row: (
            f"{row['kind']} x{row['strength']:g} seed {row['seed']}: {row.get('names', row.get('error'))}"
            f" (identifiable {row.get('detectable', '?')}, found {row.get('detectable_found', '?')})"
        ),
        jobs=args.jobs,
        minutes=args.minutes,
        any_state=args.any_code,
        after=after,
        again=is_fault,
    )
    return [row for _, row in found]


def is_fault(row: dict[str, Any]) -> bool:
    """Whether it was the benchmark that failed."""
    return bool(row.get("benchmark_fault"))


def write_drive(args: argparse.Namespace) -> None:
    """Write one drive folder, and print what it conceals."""
    from bench.worlds.folder import write_folder

    case: Case = draw_case(args.kind, args.strength, args.seed)
    courses = args.out / "courses"
    if case.world == "multibody":
        from bench.worlds.multibody import prepare

        prepare(courses, lambda text: print(text, file=sys.stderr, flush=True))
    made = make(case, courses)
    write_folder(made.drive, args.write)
    print(json.dumps(truth_of(case, made.windows).plain(), indent=1))


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--quick", action="store_true", help="a drive of each common kind (the default)")
    parser.add_argument("--each", action="store_true", help="a drive of each kind")
    parser.add_argument("--full", action="store_true", help="all drives that the proof asks for")
    parser.add_argument("--clean", type=int, help="null drives (default: 6, each: 30, full: 200)")
    parser.add_argument("--per", type=int, help="drives per kind and strength (default: 1, full: 20)")
    parser.add_argument("--strengths", help="(default: 1, full: 0.25,0.5,1,2)")
    parser.add_argument("--only", default="", help="these kinds alone, comma-separated; a+b is a pair")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2, help="worker processes (default: 2)")
    parser.add_argument("--minutes", type=float, help="stop after this time; run again to go on")
    parser.add_argument("--alarms", type=int, default=0, help="replay this many drives with and without")
    parser.add_argument("--any-code", action="store_true", help="keep results of other states of the program")
    parser.add_argument("--report-only", action="store_true", help="no new drives: print what is there")
    parser.add_argument("--failures", type=Path, metavar="FILE", help="keep a list of what went wrong here")
    parser.add_argument("--out", type=Path, default=OUT / "diagnosis")
    parser.add_argument(
        "--program", type=Path, default=REPO, metavar="FOLDER", help="where the tpmsd that is tested lies"
    )
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write one drive, print its truth")
    parser.add_argument("--kind", default="nothing")
    parser.add_argument("--strength", type=float, default=1.0)


def report(out: Path) -> str:
    """The tables of what stands in a folder."""
    rows = [row for row in last_state(out / "results.jsonl") if not is_fault(row)]
    if not rows:
        raise UsageError(f"no results in {out}")
    return markdown(summary(rows))


def main(args: argparse.Namespace) -> int:
    """Run and print."""
    if args.write is not None:
        write_drive(args)
        return 0
    args.clean = args.clean if args.clean is not None else (200 if args.full else 30 if args.each else 6)
    args.per = args.per if args.per is not None else (20 if args.full else 1)
    args.strengths = args.strengths or ("0.25,0.5,1,2" if args.full else "1")
    args.out, args.program = args.out.resolve(), args.program.resolve()
    if args.report_only:
        found = last_state(args.out / "results.jsonl", args.any_code)
        rows = [row for row in found if not is_fault(row)]
    else:
        rows = run(args, plan(args))
    figures = summary(rows)
    text = markdown(figures)
    (args.out / "summary.json").write_text(json.dumps(figures, indent=1), encoding="utf-8")
    (args.out / "summary.md").write_text(text, encoding="utf-8")
    print(text)
    return 0
