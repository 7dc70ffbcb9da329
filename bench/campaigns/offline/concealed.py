"""Effects concealed in real recordings: is what was drawn named first, and does its interval hold the value?

    python -m bench run concealed [DRIVE ...] [--count 1] [--seeds 3] [--first-seed 1]

In: drive folders. Out: a line per case and the shares. Each case is what a stranger does: `tpmsd simulate`
with `--onto --conceal`, `diagnose`, `unseal --untouched`. The program draws what the drive can show by its
own noise (twice the size that `not_detectable` of the untouched drive states, or more), and not what the
diagnosis finds. A drive that can show nothing is no case. A name above 0.9 that nobody concealed, and that
the report of the untouched recording does not hold, is fitted to that recording at its own place: `of the
recording` is what stands there beyond chance and with the same value.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import tempfile
from pathlib import Path
from typing import Any

from bench.campaigns.offline.of_the_recording import examined, paired
from bench.places import RECORDINGS
from bench.statistics import percent, share
from tpmsd.interfaces.cli.diagnose import read_recording
from tpmsd.interfaces.cli.main import main as tpmsd

NAMES = (
    *(f"van-motorway-{name}" for name in ("a", "b", "c", "d", "lost-counts")),
    *("van-mountain-a", "van-mountain-b", "van-oval"),
)


def quietly(*words: str | Path) -> int:
    """The exit code of a command whose output nobody reads."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        return tpmsd([str(word) for word in words])


def diagnosed(drive: Path, report: Path) -> Path:
    """The report of a drive."""
    if quietly("diagnose", drive, "--certify", "0", "--json", report) != 0:
        raise RuntimeError(f"{drive} cannot be diagnosed")
    return report


def case(drive: Path, count: int, seed: int, untouched: Path, folder: Path) -> dict[str, Any] | None:
    """The score of one case; None where the drive cannot show so many effects."""
    out, score = folder / f"{drive.name}-{seed}", folder / f"{drive.name}-{seed}.score.json"
    if quietly("simulate", out, "--onto", drive, "--conceal", str(count), "--seed", str(seed)) != 0:
        return None
    report = diagnosed(out, folder / f"{drive.name}-{seed}.json")
    if quietly("unseal", out, "--with", report, "--untouched", untouched, "--json", score) != 0:
        raise RuntimeError(f"{out} cannot be unsealed")
    document: dict[str, Any] = json.loads(score.read_text(encoding="utf-8"))
    own = of_the_recording(drive, out, document) if document["wrong"] else []
    return {"drive": drive.name, "case_seed": seed, **document, "of_the_recording": own}


def of_the_recording(drive: Path, out: Path, document: dict[str, Any]) -> list[str]:
    """Those of the wrong names that the untouched recording holds with the same value."""
    found = [examined(read_recording(folder)) for folder in (drive, out)]
    concealed = document["concealed"][0]
    wheel = str(concealed["parameters"].get("wheel", {}).get("concealed", ""))
    held = {one.effect for one in paired(found[0], found[1], concealed["effect"], wheel) if one.own}
    return [one["effect"] for one in document["others"] if one["wrong"] and one["effect"] in held]


def line_of(row: dict[str, Any]) -> str:
    """A case in a line."""
    parts = []
    for one in row["concealed"]:
        values = ", ".join(
            f"{name} {value['concealed']:g}"
            for name, value in one["parameters"].items()
            if isinstance(value["concealed"], float) and value["concealed"] != 0.0
        )
        place = f"rank {one['rank']}" if one["named"] else "missed"
        parts.append(f"{one['effect']} ({values}): {place}")
    wrong = [one["effect"] for one in row["others"] if one["wrong"]]
    own = f" (of the recording: {' '.join(row['of_the_recording'])})" if row["of_the_recording"] else ""
    return f"{row['drive']} seed {row['case_seed']}: {'; '.join(parts)}" + (
        f"; wrong: {' '.join(wrong)}{own}" if wrong else ""
    )


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("drives", nargs="*", type=Path, metavar="DRIVE", help="default: those of the van")
    parser.add_argument("--count", type=int, default=1, help="effects per case")
    parser.add_argument("--seeds", type=int, default=3, help="cases per drive")
    parser.add_argument("--first-seed", type=int, default=1, help="seed of each drive's first case")


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Run and print."""
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for drive in args.drives or [RECORDINGS / name for name in NAMES]:
            untouched = diagnosed(drive, folder / f"{drive.name}.json")
            for seed in range(args.first_seed, args.first_seed + args.seeds):
                row = case(drive, args.count, seed, untouched, folder)
                if row is None:
                    print(f"{drive.name} seed {seed}: cannot show {args.count} at usual sizes", flush=True)
                    continue
                rows.append(row)
                print(line_of(row), flush=True)
    effects = sum(len(row["concealed"]) for row in rows)
    named, wrong = sum(row["named"] for row in rows), sum(row["wrong"] for row in rows)
    first = sum(row["named_first"] for row in rows)
    held = sum(len(row["of_the_recording"]) for row in rows)
    values, within = (sum(row[key] for row in rows) for key in ("values", "values_within"))
    print(
        f"{len(rows)} cases: named first {percent(share(first, len(rows)))}, named"
        f" {percent(share(named, effects))}, wrong above 0.9: {wrong}, of these of the recording {held},"
        f" values in their 95 % interval {percent(share(within, values))}"
    )
    return {"cases": rows}
