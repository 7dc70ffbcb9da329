"""Alarms of both filters on the very same drives: detections, delay, false alarms, losses in real drives.

    python -m bench run filters                              two cars of five cases, one of confounders
    python -m bench run filters --cars 6 --cases 10 --km 3000 --minutes 60
    python -m bench run filters --cars 0 --kinds 0           losses injected into real drives alone
    python -m bench report filters --write

The simulated cases are those of `bench run alarms`, development half, and the losses in real drives those of
`bench run recorded-losses`; each is played with either filter, so that every figure is of pairs. A pair that
differs speaks for one of them: the exact test of McNemar (1947, Psychometrika 12) is over those alone.
"""

from __future__ import annotations

import argparse
import math
import statistics
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from scipy.stats import binomtest

from bench.campaigns.onboard.alarms.cases import CASES_PER_CAR
from bench.campaigns.onboard.alarms.run import LIFE_KM
from bench.campaigns.onboard.alarms.run import work as alarms_of
from bench.campaigns.onboard.recorded_losses import NAMES, REAR, Drive, injected, read_drive
from bench.places import OUT, RECORDINGS, REPO
from bench.registry import UsageError
from bench.runner import code_state, resume, rows_in
from bench.statistics import count, percent

Row = dict[str, Any]
METHODS = ("gaussian-sum", "mpf-pn")
Unit = tuple[str, str, str, int, int]
"""Filter; what, pool, seed and number as in `bench run alarms`, or "loss", folder, wheel and ramp in s."""
LOSS_M = 1.4e-3
"""20 % of the pressure."""
RAMPS_S = (1, 60)


def plan(args: argparse.Namespace) -> list[Unit]:
    """Each piece of work with either filter, the two next to each other."""
    pieces: list[tuple[str, str, int, int]] = [
        ("cases", "development", 1000 * args.seed + k, args.cases) for k in range(args.cars)
    ]
    pieces += [("life", "development", 1000 * args.seed + k, 0) for k in range(round(args.km / LIFE_KM))]
    pieces += [("kinds", "development", 1000 * args.seed + k, 0) for k in range(args.kinds)]
    folders = [args.recordings / name for name in NAMES] if args.losses is None else args.losses
    pieces += [("loss", str(folder), wheel, ramp) for folder in folders for wheel in REAR for ramp in RAMPS_S]
    return [(method, *piece) for piece in pieces for method in METHODS]


@lru_cache(maxsize=1)
def _drive(folder: str) -> Drive:
    return read_drive(Path(folder))


def work(unit: Unit) -> list[Row]:
    """The rows of a unit; each bears its filter."""
    method, what, pool, seed, number = unit
    if what != "loss":
        return [{**row, "method": method} for row in alarms_of((what, pool, seed, number), method=method)]
    drive = _drive(pool)
    config = replace(drive.config, filter=replace(drive.config.filter, method=method))
    row = injected(replace(drive, config=config), seed, LOSS_M, 0.5, float(number))
    return [{"what": "loss", "name": f"{drive.name} {row['wheel']} {number} s", "method": method, **row}]


def figures(rows: Sequence[Row]) -> dict[str, Row]:
    """Of each filter, over the drives that both have played."""
    rows = [row for row in rows if row["what"] in ("case", "leg", "loss", "learning")]
    names = [{row["name"] for row in rows if row["method"] == method} for method in METHODS]
    both = set.intersection(*names)
    return {
        method: _of([row for row in rows if row["method"] == method and row["name"] in both])
        for method in METHODS
    }


def _of(rows: Sequence[Row]) -> Row:
    """The figures of one filter."""
    cases, legs, losses, learning = (
        [row for row in rows if row["what"] == what] for what in ("case", "leg", "loss", "learning")
    )
    before = [said for row in learning for said in row["false"] if said[1] == "deflation"]
    return {
        "detected": count(row["detected"] for row in cases),
        "wrong_wheel": count(not row["right_wheel"] for row in cases if row["named"]),
        "median_delay_s": _median(
            [row["fast_s"] for row in cases if row["detected"] and row["onset"] != "slow"]
        ),
        "km": sum(row["km"] for row in [*legs, *learning]),
        "false_deflation": len(before) + _sum(legs, "deflation") + _sum(cases, "false_before"),
        "false_deviation": _sum(legs, "radius_deviation"),
        "malfunctions": _sum(legs, "malfunction"),
        "losses": count(row["found"] for row in losses),
        "median_loss_delay_s": _median([row["delay_s"] for row in losses if row["found"]]),
        "cpu_s": sum(row.get("cpu_s", 0.0) for row in rows),
        "found": {row["name"]: bool(row.get("detected", row.get("found"))) for row in [*cases, *losses]},
    }


def _sum(rows: Sequence[Row], key: str) -> int:
    """Incidents of all rows."""
    return sum(len(row[key]) for row in rows)


def pairs(found: dict[str, Row]) -> Row:
    """Drives that one filter alone has found, and the two-sided p-value of that by chance."""
    one, other = (found[method]["found"] for method in METHODS)
    ahead = sum(one[name] and not other[name] for name in one)
    behind = sum(other[name] and not one[name] for name in one)
    p_value = binomtest(ahead, ahead + behind).pvalue if ahead + behind else 1.0
    return {"pairs": len(one), "first_alone": ahead, "second_alone": behind, "p": float(p_value)}


def _median(values: Sequence[float]) -> float:
    return statistics.median(values) if values else math.nan


def _seconds(value: float) -> str:
    return f"{value:.1f} s" if math.isfinite(value) else "-"


def markdown(found: dict[str, Row]) -> str:
    """Both filters side by side, as far as there is something to compare, and what the pairs that differ
    say."""
    first, second = (found[method] for method in METHODS)
    lines = [f"| | {' | '.join(f'`{method}`' for method in METHODS)} |", "| --- | --- | --- |"]

    def line(title: str, reported: Any) -> None:
        lines.append(f"| {title} | {reported(first)} | {reported(second)} |")

    if first["detected"]["of"]:
        line("simulated losses found in time", lambda f: percent(f["detected"]))
        line("of those announced, with a wrong wheel", lambda f: percent(f["wrong_wheel"]))
        line("median of the driven delay, slow leaks left out", lambda f: _seconds(f["median_delay_s"]))
    if first["km"]:
        line("false `deflation`", lambda f: f"{f['false_deflation']} in {f['km']:.0f} km")
        line("false `radius_deviation`", lambda f: f"{f['false_deviation']} in {f['km']:.0f} km")
        line("`malfunction` on drives without a fault", lambda f: f"{f['malfunctions']} in {f['km']:.0f} km")
        line("processor time of these, simulation included", lambda f: f"{f['cpu_s']:.0f} s")
    if first["losses"]["of"]:
        line("losses of 1.4 mm injected into real drives, found", lambda f: percent(f["losses"]))
        line("median delay of these", lambda f: _seconds(f["median_loss_delay_s"]))
    one = pairs(found)
    lines += [
        "",
        f"Of {one['pairs']} pairs, `{METHODS[0]}` alone finds {one['first_alone']} and `{METHODS[1]}` alone "
        f"{one['second_alone']} (exact test of McNemar: p = {one['p']:.2g}).",
        "",
    ]
    return "\n".join(lines)


def report(out: Path) -> str:
    """The table of what stands in a folder; UsageError where there is nothing."""
    return markdown(figures(rows_in(out)))


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--cars", type=int, default=2, metavar="N", help="whose cases are played")
    parser.add_argument("--cases", type=int, default=5, metavar="N", help=f"of each, at most {CASES_PER_CAR}")
    parser.add_argument("--km", type=float, default=0.0, help="kilometres without a fault")
    parser.add_argument("--kinds", type=int, default=1, metavar="N", help="cars that meet each confounder")
    parser.add_argument(
        "--losses", type=Path, nargs="*", metavar="DRIVE", help="real drives (default: five motorways)"
    )
    parser.add_argument("--seed", type=int, default=1, help="other cars, roads and noise")
    parser.add_argument("--recordings", type=Path, default=RECORDINGS, help="folder of real drives")
    parser.add_argument("--jobs", type=int, default=1, metavar="N")
    parser.add_argument("--minutes", type=float, help="stop after this time; run again to go on")
    parser.add_argument("--out", type=Path, default=OUT / "filters")


def _line(unit: Unit, rows: list[Row]) -> str:
    found = [row.get("detected", row.get("found")) for row in rows if row["what"] in ("case", "loss")]
    failed = [row["error"] for row in rows if row["what"] == "failed"]
    reported = f"{sum(map(bool, found))} of {len(found)} found" if found else f"{len(rows)} rows"
    return f"{unit[0]}: {unit[1]} {Path(unit[2]).name}/{unit[3]}: {failed[0] if failed else reported}"


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Play what is not done yet and print the table."""
    if not 0 <= args.cases <= CASES_PER_CAR:
        raise UsageError(f"--cases {args.cases}: 0 to {CASES_PER_CAR}")
    here = Path(__file__)
    parts = (here, here.with_name("recorded_losses.py"), here.parent / "alarms")
    state = code_state(REPO / "tpmsd", REPO / "bench" / "worlds", *parts)
    file = args.out / "results.jsonl"
    done = resume(file, state, plan(args), work, _line, jobs=args.jobs, minutes=args.minutes)
    found = figures([row for _, rows in done for row in rows])
    print(markdown(found))
    return {"filters": found, **pairs(found)}
