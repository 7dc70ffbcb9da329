"""NEES and coverage of the intervals that both filters of the product state, cell by cell.

    python -m bench run intervals                       eight drives a cell, half an hour
    python -m bench run intervals --drives 20 --minutes 30
    python -m bench report intervals --write

A cell is a kind of drive, a receiver and the wheels that are estimated; each filter plays its drives with the
product's settings and all that it can hear. A Bayesian filter's intervals cover what they say on average over
its own prior: so the drift of the radii is drawn for each drive from the prior that the filter states
(`drift_prior`), or with sudden changes beside it, or there is none. The normalised estimation error squared
(NEES) is the mean of e' P^-1 e over the number of radii: 1 if the filter knows its error, less where it
states too much [Bar-Shalom, Li and Kirubarajan 2001, section 5.4]. Ticks of one drive are
not independent, so the interval of a figure comes from the spread between drives. Two statements are held
against the truth: all hypotheses together, which the alarms judge, and `RadiusEstimate.stated`.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy.stats

from bench.campaigns.onboard.estimators.drift_prior import CHANGES, DRIFT, KINDS, NONE, drawn
from bench.campaigns.onboard.estimators.methods import ALL
from bench.campaigns.onboard.estimators.tasks import FOUR, RECEIVERS, Task, perform
from bench.places import OUT, REPO
from bench.registry import UsageError
from bench.runner import code_state, last_state, resume
from bench.worlds.paper_drive import SCENARIOS, TICK_S, drive
from bench.worlds.paper_route import STEP_S, Route, paper_route

Row = dict[str, Any]
NEES_BAR = (0.7, 1.4)
COVERAGE_BAR = (0.90, 0.98)
"""Of intervals of 95 %."""


@dataclass(frozen=True)
class Unit:
    """One drive through one filter."""

    task: Task
    drift: str
    """One of `drift_prior.KINDS`."""


TITLES = {
    DRIFT: "Drift drawn from the filter's prior",
    NONE: "No drift",
    CHANGES: "Drift and sudden changes drawn from the filter's prior",
}


def plan(
    drives: int, first: int, scenarios: Sequence[str], receivers: Sequence[str], drifts: Sequence[str]
) -> list[Unit]:
    """Every cell with both filters, drive by drive."""
    return [
        Unit(Task(scenario, receiver, seed, method, 0, front, ALL), drift)
        for seed in range(first, first + drives)
        for drift in drifts
        for scenario in scenarios
        for receiver in receivers
        for front in (False, True)
        for method in FOUR
    ]


@lru_cache(maxsize=1)
def _route() -> Route:
    return paper_route()


def work(unit: Unit) -> Row:
    """One drive through one filter: the figures that the cells are made of."""
    task, route = unit.task, _route()
    speed = route.speed_mps[:: round(TICK_S / STEP_S)]
    rng = np.random.default_rng([task.seed, 11])
    drift = drawn(task.method, 4 if task.front else 2, speed[1:] + speed[:-1] > 0.0, unit.drift, rng)
    row = perform(task, drive(SCENARIOS[task.scenario], task.receiver, task.seed, route, added_m=drift))
    row.pop("series", None)
    return {**row, "drift": unit.drift}


FIGURES = ("nees_difference", "cover_radius", "cover_difference")
"""Beside NEES per radius, of a `Score`."""


def spread(values: Sequence[float]) -> tuple[float, float]:
    """Mean over drives, and half the width of its 95 % interval by Student's t; NaN of fewer than two."""
    known = np.asarray(values, dtype=float)
    if len(known) < 2:
        return (float(known.mean()) if len(known) else math.nan), math.nan
    half = scipy.stats.t.ppf(0.975, len(known) - 1) * known.std(ddof=1) / math.sqrt(len(known))
    return float(known.mean()), float(half)


def cells(rows: Sequence[Row]) -> list[Row]:
    """NEES and coverage by cell and filter."""
    keys = list(dict.fromkeys((r["scenario"], r["receiver"], r["front"], r["method"]) for r in rows))
    out = []
    for scenario, receiver, front, method in sorted(keys):
        own = [
            r
            for r in rows
            if (r["scenario"], r["receiver"], r["front"], r["method"]) == (scenario, receiver, front, method)
        ]
        out.append(
            {
                "scenario": scenario,
                "receiver": receiver,
                "wheels": 4 if front else 2,
                "method": method,
                "drives": len(own),
                "all": statement(own, front),
                "stated": statement([r["stated"] for r in own], front),
                "diverged": sum(bool(r["diverged"]) for r in own),
            }
        )
    return out


def statement(rows: Sequence[Row], front: bool) -> Row:
    """Means over drives of what one of the two statements scores."""
    return {
        "nees": spread([r["nees_four"] / 4 if front else r["nees_pair"] / 2 for r in rows]),
        **{key: spread([r[key] for r in rows]) for key in FIGURES},
    }


def _reported(said: Row) -> list[str]:
    """Return the table's cells of one statement: NEES and coverage, of a radius and of left against right."""
    cells = []
    for nees, cover in (("nees", "cover_radius"), ("nees_difference", "cover_difference")):
        mean, half = said[nees]
        shown = f"{mean:.2f}" + (f"±{half:.2f}" if math.isfinite(half) else "")
        cells.append(f"{shown}, {100 * said[cover][0]:.0f}")
    return cells


def markdown(found: Sequence[Row]) -> str:
    """Return a table of the cells with what each filter states."""
    head = [
        f"`{method}`: {what}" for method in FOUR for what in ("NEES per radius, coverage %", "left-right")
    ]
    lines = [f"| drives | receiver | wheels | {' | '.join(head)} |", f"|{(3 + len(head)) * ' --- |'}"]
    for key in dict.fromkeys((one["scenario"], one["receiver"], one["wheels"]) for one in found):
        own = {
            one["method"]: _reported(one["stated"])
            for one in found
            if (one["scenario"], one["receiver"], one["wheels"]) == key
        }
        reported = [cell for method in FOUR for cell in own.get(method, ["", ""])]
        lines.append(f"| {' | '.join([*map(str, key), *reported])} |")
    return "\n".join([*lines, ""])


def _within_bars(found: Sequence[Row]) -> list[str]:
    """Return a table with the cells within the bars, and the extremes, of each filter and statement."""
    lines = [
        "| filter | statement | NEES per radius: least, mean, greatest | cells within "
        f"{NEES_BAR[0]:g} to {NEES_BAR[1]:g} | coverage %: least, mean, greatest | cells within "
        f"{100 * COVERAGE_BAR[0]:.0f} to {100 * COVERAGE_BAR[1]:.0f} % |",
        "|" + 6 * " --- |",
    ]
    for method in FOUR:
        for key, title in (("all", "all hypotheses"), ("stated", "as stated")):
            own = [one[key] for one in found if one["method"] == method]
            if not own:
                continue
            nees, cover = [said["nees"][0] for said in own], [100 * said["cover_radius"][0] for said in own]
            honest = sum(NEES_BAR[0] <= value <= NEES_BAR[1] for value in nees)
            covered = sum(100 * COVERAGE_BAR[0] <= value <= 100 * COVERAGE_BAR[1] for value in cover)
            cells = [
                f"`{method}` | {title}",
                f"{min(nees):.2f}, {np.mean(nees):.2f}, {max(nees):.2f}",
                f"{honest} of {len(own)}",
                f"{min(cover):.0f}, {np.mean(cover):.1f}, {max(cover):.0f}",
                f"{covered} of {len(own)}",
            ]
            lines.append(f"| {' | '.join(cells)} |")
    return [*lines, ""]


def tables(rows: Sequence[Row]) -> str:
    """Return a table for each kind of drift that was played, and how many cells stand within the bars.

    Without a drift every interval is too wide, so there are the totals alone.
    """
    parts = []
    for drift, title in TITLES.items():
        found = cells([row for row in rows if row["drift"] == drift])
        if found:
            parts += [f"## {title}", ""]
            parts += [markdown(found)] if drift != NONE else []
            parts += _within_bars(found)
    return "\n".join(parts)


def report(out: Path) -> str:
    """The tables of what stands in a folder; UsageError where there is nothing."""
    rows = last_state(out / "results.jsonl")
    if not rows:
        raise UsageError(f"no results in {out}")
    return tables(rows)


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--drives", type=int, default=8, metavar="N", help="of each cell")
    parser.add_argument("--first", type=int, default=400, metavar="SEED", help="seed of the first drive")
    parser.add_argument("--scenarios", default=",".join(SCENARIOS), metavar="LIST")
    parser.add_argument("--receivers", default=",".join(RECEIVERS), metavar="LIST")
    parser.add_argument("--drifts", default=",".join((DRIFT, NONE)), metavar="LIST", help=", ".join(KINDS))
    parser.add_argument("--jobs", type=int, default=1, metavar="N")
    parser.add_argument("--minutes", type=float, help="stop after this time; run again to go on")
    parser.add_argument("--out", type=Path, default=OUT / "intervals")


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Play what is not done yet and print the table."""
    scenarios, receivers, drifts = (
        given.split(",") for given in (args.scenarios, args.receivers, args.drifts)
    )
    if strange := {*scenarios, *receivers, *drifts} - {*SCENARIOS, *RECEIVERS, *KINDS}:
        raise UsageError(f"unknown: {', '.join(sorted(strange))}")
    state = code_state(REPO / "tpmsd", REPO / "bench" / "worlds", Path(__file__).parent / "estimators")
    found = resume(
        args.out / "results.jsonl",
        state,
        plan(args.drives, args.first, scenarios, receivers, drifts),
        work,
        lambda unit, row: f"{unit.task.label}, {unit.drift}: NEES {row['nees_pair'] / 2:.2f}",
        jobs=args.jobs,
        minutes=args.minutes,
    )
    rows = [row for _, row in found]
    print(tables(rows))
    return {drift: cells([row for row in rows if row["drift"] == drift]) for drift in drifts}
