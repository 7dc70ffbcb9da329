"""Radii of both filters beside those of a factor graph (GTSAM) and of the causal limit, on equal inputs.

    pip install "tpmsd[bench]"                   GTSAM is in this extra
    python -m bench run smoothers                six drives of the puncture, both receivers
    python -m bench report smoothers --write

Each plays the drives of `bench run estimators` and hears positions, Doppler speed and course. The graph and
`limit` are given what no filter has: the variances and memories of this receiver, and the intensity of the
radii's walk. All are held against the truth at whole seconds, after the first two minutes.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.campaigns.onboard.estimators.factor_graph import SECOND, smooth
from bench.campaigns.onboard.estimators.limit import limit
from bench.campaigns.onboard.estimators.methods import ALL, build
from bench.campaigns.onboard.estimators.play import SETTLE_S, play
from bench.campaigns.onboard.estimators.report import table, within
from bench.campaigns.onboard.estimators.summary import interval
from bench.campaigns.onboard.estimators.tasks import FOUR, RECEIVERS, driven
from bench.places import OUT, REPO
from bench.registry import UsageError
from bench.runner import code_state, resume, rows_in
from bench.worlds.paper_drive import RL, SCENARIOS

Row = dict[str, Any]
Unit = tuple[str, str, int]
"""Scenario, receiver, seed."""
LINES = {
    **{method: f"`{method}`" for method in FOUR},
    "causal": "causal limit",
    "now": "GTSAM, fixed lag of 60 s, at its end",
    "lagged": "GTSAM, fixed lag of 60 s, at its begin",
    "batch": "GTSAM, whole drive",
    "smoother": "smoother of the limit",
}


def errors(rear_m: NDArray[np.float64], truth_m: NDArray[np.float64]) -> Row:
    """Root mean squares of left minus right and of each radius, mm, of (seconds, 2)."""
    off = 1e3 * (rear_m - truth_m)[round(SETTLE_S) :]
    return {
        "difference": math.sqrt(float(np.mean((off[:, 0] - off[:, 1]) ** 2))),
        "radius": math.sqrt(float(np.mean(off**2))),
    }


def work(unit: Unit) -> list[Row]:
    """Rows of all methods on one drive."""
    scenario, receiver, seed = unit
    drive = driven(scenario, receiver, seed)
    graph, known = smooth(drive), limit(drive)
    ends = SECOND * np.arange(1, len(graph.batch_m) + 1) - 1
    found = {method: play(build(method, None, seed, False, ALL), drive.ticks).rear_m[ends] for method in FOUR}
    found |= {"causal": known.causal_m[ends], "smoother": known.smoothed_m[ends]}
    found |= {"now": graph.causal_m, "lagged": graph.lagged_m, "batch": graph.batch_m}
    truth = drive.offsets_m[ends, RL:]
    about = {"scenario": scenario, "receiver": receiver, "seed": seed, "ms": graph.ms_per_node}
    return [{**about, "method": name, **errors(rear, truth)} for name, rear in found.items()]


def markdown(rows: Sequence[Row]) -> str:
    """A table of every scenario and receiver that was played."""
    lines = []
    for scenario, receiver in dict.fromkeys((row["scenario"], row["receiver"]) for row in rows):
        cell = [row for row in rows if (row["scenario"], row["receiver"]) == (scenario, receiver)]
        drives = len({row["seed"] for row in cell})
        shown = []
        for method, title in LINES.items():
            own = [row for row in cell if row["method"] == method]
            shown.append([title, *(within(interval(own, key)) for key in ("difference", "radius"))])
        head = [f"{scenario}, {receiver}, {drives} drives", "RMSE left-right mm", "RMSE of a radius mm"]
        lines += [*table(head, shown), ""]
    return "\n".join(
        [*lines, f"The fixed lag takes {np.mean([row['ms'] for row in rows]):.1f} ms a second of driving."]
    )


def report(out: Path) -> str:
    """The tables of what stands in a folder; UsageError where there is nothing."""
    return markdown(rows_in(out))


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--drives", type=int, default=6, metavar="N", help="of each cell")
    parser.add_argument("--scenarios", nargs="*", choices=list(SCENARIOS), default=["puncture"])
    parser.add_argument("--minutes", type=float, help="stop after this time; run again to go on")
    parser.add_argument("--out", type=Path, default=OUT / "smoothers")


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Play what is not done yet and print the tables."""
    try:
        import gtsam  # noqa: F401
    except ImportError as error:
        raise UsageError(f"GTSAM is in the extra `bench`: {error}") from error
    units = [(s, r, seed) for seed in range(args.drives) for s in args.scenarios for r in RECEIVERS]
    state = code_state(
        REPO / "tpmsd", REPO / "bench" / "campaigns" / "onboard" / "estimators", Path(__file__)
    )
    file = args.out / "results.jsonl"
    done = resume(file, state, units, work, lambda unit, rows: " ".join(map(str, unit)), minutes=args.minutes)
    rows = [row for _, found in done for row in found]
    print(markdown(rows))
    return {"smoothers": rows}
