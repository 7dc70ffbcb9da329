"""The diagnosis on drives of every origin: null drives, faults and events whose name is known, and effects of
known size.

    python -m bench run origins                              20 null drives per origin
    python -m bench run origins --only traffic,awkward --number 5 --kinds null,faults
    python -m bench run origins --held-out                   the other half of the seeds: once per change
    python -m bench run origins --write FOLDER --only awkward --seed 7

Results are appended to OUT/rows.jsonl; drives of the same state of the program are not diagnosed again.
`python -m bench report origins` prints the tables.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.campaigns.offline import origins_coverage
from bench.campaigns.offline.diagnosed import HELD_OUT_FROM, Row, diagnosed
from bench.campaigns.offline.diagnosis.run import is_fault
from bench.campaigns.offline.origins_report import REAL, markdown
from bench.places import OUT, RECORDINGS, REPO
from bench.registry import UsageError
from bench.runner import code_state, last_state, read, resume
from bench.worlds import awkward, real_drives
from bench.worlds.folder import write_folder
from bench.worlds.origins import ORIGINS, Places


@dataclass(frozen=True)
class Job:
    """One drive to be diagnosed."""

    origin: str
    kind: str
    """`null`, one of `awkward.FAULTS` or of `real_drives.INJECTED`, or `origins_coverage.KIND`."""
    seed: int


def plan(origins: list[str], kinds: list[str], first: int, number: int) -> list[Job]:
    """The drives, seeds first so that a run cut short has seen something of all origins."""
    jobs = []
    for seed in range(first, first + number):
        for origin in origins:
            faults = real_drives.INJECTED if origin == REAL else awkward.FAULTS if origin == "awkward" else ()
            wanted = [*(["null"] if "null" in kinds else []), *(faults if "faults" in kinds else ())]
            if origins_coverage.KIND in kinds and origin in ORIGINS:
                wanted.append(origins_coverage.KIND)
            jobs += [Job(origin, kind, seed) for kind in wanted]
    return jobs


def make(job: Job, folder: Path, places: Places) -> dict[str, Any]:
    """Write the drive's folder; what is known of it."""
    rng = np.random.default_rng([job.seed, sum(map(ord, job.origin + job.kind))])
    if job.origin == REAL:
        names = real_drives.HELD_OUT if places.held_out else real_drives.DEVELOPMENT
        name = names[job.seed % len(names)]
        begin, end = real_drives.cut(places.recordings / name, folder, rng)
        known = {"tags": [name], "duration_s": end - begin}
        if job.kind != "null":
            known["truth"] = real_drives.inject(folder, job.kind, rng)
        return known
    origin = ORIGINS[job.origin]
    spec = origin.spec(rng)
    if job.kind == origins_coverage.KIND:
        spec = replace(spec, physics=origins_coverage.known(spec, rng))
    elif job.kind != "null":
        spec = awkward.fault(job.kind, spec, rng)
    _, drive = origin.drive(spec, rng, job.seed, places)
    write_folder(drive, folder)
    known = {
        "tags": list(drive.spec.tags),
        "duration_s": float(drive.time_s[-1]),
        "receiver_hz": spec.receiver_hz,
        "velocity_lag_s": spec.doppler_age_s,
        "wheel_age_s": 0.5 * spec.speed_window_s + spec.speed_filter_s,
        "bus": [spec.wheel_signal, spec.wheel_hz, spec.teeth, spec.with_gyro, spec.with_accel],
    }
    if job.kind == origins_coverage.KIND:
        known["truth"] = origins_coverage.as_reported(spec.physics, spec)
    if job.kind == "spin_on_ice":
        event = spec.physics["wheel_spin"]
        wheels = [("fl", "fr", "rl", "rr")[k] for k in event["wheels"]]
        known["truth"] = {**event, "wheels": wheels}
    return known


def one(job: Job, places: Places, program: Path, passed: tuple[str, ...] = ()) -> Row:
    """Make a drive, have it diagnosed; its row."""
    row = {"origin": job.origin, "kind": job.kind, "seed": job.seed}
    return diagnosed(row, partial(make, job, places=places), program, *passed)


def described(row: Row) -> str:
    """A row as one line."""
    found = ", ".join(
        f"{each['effect']} {each['confidence']:.2f} ({each['where']['channel']} over "
        f"{each['where']['covariate']}; {','.join(each['where']['wheels'])})"
        for each in row.get("findings", [])
    )
    reported = row.get("benchmark_fault") or row.get("error") or found or row.get("verdict")
    return f"{row['origin']}/{row['kind']} seed {row['seed']} [{' '.join(row.get('tags', []))}]: {reported}"


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--only", help=f"origins, comma-separated: {','.join([*ORIGINS, REAL])} (all)")
    parser.add_argument("--kinds", default="null", help="null, faults, known, comma-separated (null)")
    parser.add_argument("--number", type=int, default=20, help="drives per origin and kind (20)")
    parser.add_argument("--seed", type=int, default=1, help="the first seed, below 50000 (1)")
    parser.add_argument("--held-out", action="store_true", help="the other half of the seeds")
    parser.add_argument("--jobs", type=int, default=1, help="processes (1)")
    parser.add_argument("--minutes", type=float, help="begin no drive after this time")
    parser.add_argument("--option", action="append", default=[], help="passed on to tpmsd diagnose")
    parser.add_argument("--recordings", type=Path, default=RECORDINGS, help="folder of real drives")
    parser.add_argument("--program", type=Path, default=REPO, help="where the tpmsd that is tested lies")
    parser.add_argument("--out", type=Path, default=OUT / "origins")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write the first drive and stop")


def report(out: Path) -> str:
    """The tables of what stands in a folder: of each drive the latest result, and of how many states of the
    program these are."""
    rows = last_state(out / "rows.jsonl", any_state=True)
    if not rows:
        raise UsageError(f"no results in {out}")
    latest = {entry.unit: entry.state for entry in read(out / "rows.jsonl")}
    reported = ", ".join(str(number) for number in Counter(latest.values()).values())
    return f"{markdown(rows)}\nDrives by state of the program: {reported}.\n"


def main(args: argparse.Namespace) -> int:
    """Run what is not done yet; exit code 1 where the benchmark itself failed."""
    origins = [*ORIGINS, REAL] if args.only is None else args.only.split(",")
    strange = set(origins) - {*ORIGINS, REAL}
    if strange or not 0 <= args.seed < HELD_OUT_FROM:
        raise UsageError(f"no such origin: {', '.join(sorted(strange))}" if strange else "no such seed")
    places = Places(args.recordings, args.out / "memory", args.held_out)
    first = args.seed + (HELD_OUT_FROM if args.held_out else 0)
    jobs = plan(origins, args.kinds.split(","), first, args.number)
    if args.write is not None:
        print(json.dumps(make(jobs[0], args.write, places), indent=1))
        return 0
    found = resume(
        args.out / "rows.jsonl",
        " ".join([code_state(args.program / "tpmsd"), *args.option]),
        jobs,
        partial(one, places=places, program=args.program.resolve(), passed=tuple(args.option)),
        lambda job, row: described(row),
        jobs=args.jobs,
        minutes=args.minutes,
        again=is_fault,
    )
    return 1 if any(is_fault(row) for _, row in found) else 0
