"""NEES and coverage of the intervals that both filters of the product state, cell by cell.

    python -m bench run intervals                       four drives a cell, some minutes
    python -m bench run intervals --drives 20 --minutes 30
    python -m bench report intervals --write

A cell is a kind of drive, a receiver and the wheels that are estimated; each filter plays the very same
drives with the product's settings and all that it can hear. The normalised estimation error squared (NEES) is
the mean of e' P^-1 e over the number of radii: 1 if the filter knows its error, less where it states too
much [Bar-Shalom, Li and Kirubarajan 2001, section 5.4]. Ticks of one drive are not independent, so the
interval of a figure comes from the spread between drives.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.stats

from bench.campaigns.onboard.estimators.methods import ALL
from bench.campaigns.onboard.estimators.tasks import FOUR, RECEIVERS, Task, perform
from bench.places import OUT, REPO
from bench.registry import UsageError
from bench.runner import code_state, last_state, resume
from bench.worlds.paper_drive import SCENARIOS

Row = dict[str, Any]
NEES_BAR = (0.7, 1.4)
COVERAGE_BAR = (0.90, 0.98)
"""Of intervals of 95 %."""


def plan(drives: int, first: int, scenarios: Sequence[str], receivers: Sequence[str]) -> list[Task]:
    """Every cell with both filters, drive by drive."""
    return [
        Task(scenario, receiver, seed, method, 0, front, ALL)
        for seed in range(first, first + drives)
        for scenario in scenarios
        for receiver in receivers
        for front in (False, True)
        for method in FOUR
    ]


def work(task: Task) -> Row:
    """One drive through one filter: the figures that the cells are made of."""
    row = perform(task)
    row.pop("series", None)
    return row


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
        nees = [r["nees_four"] / 4 if front else r["nees_pair"] / 2 for r in own]
        out.append(
            {
                "scenario": scenario,
                "receiver": receiver,
                "wheels": 4 if front else 2,
                "method": method,
                "drives": len(own),
                "nees": spread(nees),
                "nees_difference": spread([r["nees_difference"] for r in own]),
                "cover_radius": spread([r["cover_radius"] for r in own]),
                "cover_difference": spread([r["cover_difference"] for r in own]),
                "diverged": sum(bool(r["diverged"]) for r in own),
            }
        )
    return out


def _told(value: tuple[float, float], factor: float = 1.0, digits: int = 2) -> str:
    mean, half = (factor * part for part in value)
    return f"{mean:.{digits}f}" + (f" ± {half:.{digits}f}" if math.isfinite(half) else "")


def markdown(found: Sequence[Row]) -> str:
    """The table of the cells, and how many stand within the bars."""
    lines = [
        "| drives | receiver | wheels | filter | n | NEES per radius | NEES, left-right | "
        "coverage of a radius % | coverage, left-right % |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for one in found:
        lines.append(
            f"| {one['scenario']} | {one['receiver']} | {one['wheels']} | `{one['method']}` | "
            f"{one['drives']} | {_told(one['nees'])} | {_told(one['nees_difference'])} | "
            f"{_told(one['cover_radius'], 100.0, 0)} | {_told(one['cover_difference'], 100.0, 0)} |"
        )
    lines.append("")
    for method in FOUR:
        own = [one for one in found if one["method"] == method]
        if not own:
            continue
        honest = sum(NEES_BAR[0] <= one["nees"][0] <= NEES_BAR[1] for one in own)
        covered = sum(COVERAGE_BAR[0] <= one["cover_radius"][0] <= COVERAGE_BAR[1] for one in own)
        low, high = (pick(one["nees"][0] for one in own) for pick in (min, max))
        lines.append(
            f"`{method}`: NEES per radius from {low:.2f} to {high:.2f}; {honest} of {len(own)} cells are "
            f"within {NEES_BAR[0]:g} to {NEES_BAR[1]:g}, and {covered} cover a radius in "
            f"{100 * COVERAGE_BAR[0]:.0f} to {100 * COVERAGE_BAR[1]:.0f} %."
        )
        lines.append("")
    return "\n".join(lines)


def report(out: Path) -> str:
    """The table of what stands in a folder; UsageError where there is nothing."""
    rows = last_state(out / "results.jsonl")
    if not rows:
        raise UsageError(f"no results in {out}")
    return markdown(cells(rows))


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--drives", type=int, default=4, metavar="N", help="of each cell")
    parser.add_argument("--first", type=int, default=400, metavar="SEED", help="seed of the first drive")
    parser.add_argument("--scenarios", default=",".join(SCENARIOS), metavar="LIST")
    parser.add_argument("--receivers", default=",".join(RECEIVERS), metavar="LIST")
    parser.add_argument("--jobs", type=int, default=1, metavar="N")
    parser.add_argument("--minutes", type=float, help="stop after this time; run again to go on")
    parser.add_argument("--out", type=Path, default=OUT / "intervals")


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Play what is not done yet and print the table."""
    scenarios, receivers = args.scenarios.split(","), args.receivers.split(",")
    if strange := {*scenarios, *receivers} - {*SCENARIOS, *RECEIVERS}:
        raise UsageError(f"unknown: {', '.join(sorted(strange))}")
    state = code_state(REPO / "tpmsd", REPO / "bench" / "worlds", Path(__file__).parent / "estimators")
    found = resume(
        args.out / "results.jsonl",
        state,
        plan(args.drives, args.first, scenarios, receivers),
        work,
        lambda task, row: f"{task.label}: NEES {row['nees_pair'] / 2:.2f}",
        jobs=args.jobs,
        minutes=args.minutes,
    )
    by_cell = cells([row for _, row in found])
    print(markdown(by_cell))
    return {"cells": by_cell}
