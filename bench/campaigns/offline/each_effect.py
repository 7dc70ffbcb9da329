"""Every effect of the catalogue on drives whose causes go by other formulas: named, named first, intervals.

    python -m bench run each-effect                          3 drives of each effect
    python -m bench run each-effect --only brake_slip,chains --number 5 --seed 7
    python -m bench run each-effect --held-out               the other half of the seeds: once per change
    python -m bench run each-effect --only chains --write FOLDER

Results are appended to OUT/rows.jsonl; drives of the same state of the program are not diagnosed again.
`python -m bench report each-effect` prints the tables.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from bench.campaigns.offline.diagnosed import HELD_OUT_FROM, Row, diagnosed
from bench.campaigns.offline.diagnosis.signals import windows_of
from bench.campaigns.offline.each_effect_report import markdown
from bench.campaigns.offline.effect_cases import CASES, draw
from bench.campaigns.offline.effect_tells import generator, tells
from bench.places import OUT, REPO
from bench.registry import UsageError
from bench.runner import code_state, last_state, resume
from bench.worlds import kinematic
from bench.worlds.folder import write_folder
from bench.worlds.instruments import observe
from bench.worlds.spec import draw_spec

SHORTEST_S, LONGEST_S = 600.0, 900.0


@dataclass(frozen=True)
class Job:
    """One drive."""

    effect: str
    seed: int


def plan(effects: list[str], first: int, number: int) -> list[Job]:
    """The drives, seeds first so that a run cut short has seen something of all effects."""
    return [Job(effect, seed) for seed in range(first, first + number) for effect in effects]


def make(job: Job, folder: Path) -> Row:
    """Write the drive's folder; what is true of it, and how surely it is identifiable."""
    rng = generator(job.effect, job.seed, 1)
    drawn = draw(job.effect, rng)
    fixed = {"duration_s": float(rng.uniform(SHORTEST_S, LONGEST_S)), **drawn.fixed}
    spec = draw_spec(rng, **fixed, physics=drawn.physics)
    course = kinematic.course(spec, rng)
    drive = observe(course, spec, rng, job.seed)
    write_folder(drive, folder)
    reported = tells(job.effect, drawn, windows_of(course, drive))
    late = ("velocity_lag",) if spec.doppler_age_s > 0.0 else ()
    return {
        "truth": {**drawn.truth, **(drawn.fitted(course, spec) if drawn.fitted else {})},
        "wheels": list(drawn.wheels),
        "also": [*drawn.also, *drawn.limit, *late],
        "gain": reported.gain,
        "margin": reported.margin,
        "rival": reported.alternative,
        "can": reported.can,
        "bus": [spec.wheel_signal, spec.wheel_hz, spec.teeth, spec.with_gyro, spec.with_accel],
        "receiver": [spec.receiver_hz, spec.with_course, round(spec.doppler_age_s, 3)],
        "car": [spec.driven, spec.road, round(spec.duration_s)],
    }


def one(job: Job, program: Path) -> Row:
    """Make a drive, have it diagnosed; its row."""
    return diagnosed({"effect": job.effect, "seed": job.seed}, partial(make, job), program)


def described(row: Row) -> str:
    """A row as one line."""
    found = ", ".join(f"{each['effect']} {each['confidence']:.2f}" for each in row.get("findings", []))
    reported = row.get("benchmark_fault") or row.get("error") or found or row.get("verdict")
    return f"{row['effect']} seed {row['seed']} (identifiable: {row.get('can')}): {reported}"


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--only", help="effects, comma-separated (all)")
    parser.add_argument("--number", type=int, default=3, help="drives per effect (3)")
    parser.add_argument("--seed", type=int, default=1, help="the first seed, below 50000 (1)")
    parser.add_argument("--held-out", action="store_true", help="the other half of the seeds")
    parser.add_argument("--jobs", type=int, default=1, help="processes (1)")
    parser.add_argument("--minutes", type=float, help="begin no drive after this time")
    parser.add_argument("--program", type=Path, default=REPO, help="where the tpmsd that is tested lies")
    parser.add_argument("--out", type=Path, default=OUT / "each-effect")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write the first drive and stop")


def report(out: Path) -> str:
    """The tables of what stands in a folder, of each drive the latest result."""
    rows = last_state(out / "rows.jsonl", any_state=True)
    if not rows:
        raise UsageError(f"no results in {out}")
    return markdown(rows)


def main(args: argparse.Namespace) -> int:
    """Run what is not done yet; exit code 1 where the benchmark itself failed."""
    effects = list(CASES) if args.only is None else args.only.split(",")
    strange = set(effects) - set(CASES)
    if strange or not 0 <= args.seed < HELD_OUT_FROM:
        raise UsageError(f"no case of: {', '.join(sorted(strange))}" if strange else "no such seed")
    jobs = plan(effects, args.seed + (HELD_OUT_FROM if args.held_out else 0), args.number)
    if args.write is not None:
        print(json.dumps(make(jobs[0], args.write), indent=1))
        return 0
    found = resume(
        args.out / "rows.jsonl",
        code_state(args.program / "tpmsd"),
        jobs,
        partial(one, program=args.program.resolve()),
        lambda job, row: described(row),
        jobs=args.jobs,
        minutes=args.minutes,
        again=lambda row: "benchmark_fault" in row,
    )
    return 1 if any("benchmark_fault" in row for _, row in found) else 0
