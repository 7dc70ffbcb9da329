"""The figures as one picture.

In: rows. Out: a PNG with the share detected over time, times by wheel-set, and false alarms by confounder.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.campaigns.onboard.alarms.figures import STANDARDS, legs_with, rate
from bench.worlds.surfaces import TAGS

Row = dict[str, Any]
COLOURS = ("#1f5fa8", "#c2452d", "#2f7f4f", "#7a55a3", "#b8860b", "#4d4d4d")


def plot(rows: Sequence[Row], file: Path) -> None:
    """Write the picture."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    cases = [row for row in rows if row["what"] == "case"]
    legs = [row for row in rows if row["what"] == "leg"]
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(16, 5.2), layout="constrained")
    _shares(left, cases)
    _sizes(middle, cases)
    _rates(right, legs)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)
    plt.close(figure)


def _shares(axes: Any, cases: Sequence[Row]) -> None:
    """Share of the cases with an alarm, over driving time above 40 km/h."""
    for colour, standard in zip(COLOURS, STANDARDS, strict=True):
        group = [row for row in cases if row["standard"] == standard]
        if not group:
            continue
        times = sorted(max(float(row["fast_s"]), 1.0) for row in group if row["fast_s"] is not None)
        steps = np.arange(1, len(times) + 1) / len(group)
        end = 3600.0
        axes.step(
            [1.0, *times, end],
            [0.0, *steps, steps[-1] if len(steps) else 0.0],
            where="post",
            color=colour,
            label=f"{standard} ({len(group)})",
        )
    for bar in (45.0, 600.0, 1200.0):
        axes.axvline(bar, color="0.8", lw=0.8, zorder=0)
    axes.set(
        xscale="log",
        xlim=(1.0, 3600.0),
        ylim=(0.0, 1.03),
        xlabel="driving above 40 km/h after the loss, s (1: before its end)",
    )
    axes.set_ylabel("share of the cases with an alarm")
    axes.legend(loc="lower right", frameon=False, fontsize=8)
    axes.set_title("Time to detect; grey: bars at 45, 600, 1200 s", fontsize=10, loc="left")


def _sizes(axes: Any, cases: Sequence[Row]) -> None:
    """What was stated against what was lost, for the soft wheels."""
    for found, colour, label in ((True, COLOURS[2], "detected"), (False, COLOURS[1], "missed")):
        group = [row for row in cases if row["detected"] == found]
        points = [
            (row["lost_mm"][wheel], -row["stated_mm"][wheel][0])
            for row in group
            for wheel in row["wheels"]
            if row["stated_mm"].get(wheel, [None])[0] is not None
        ]
        if points:
            lost, reported = np.array(points).T
            axes.plot(lost, reported, ".", color=colour, label=label, ms=5, alpha=0.7)
    limits = (0.0, 4.0)
    axes.plot(limits, limits, color="0.7", lw=0.8)
    axes.set(
        xlim=limits, xlabel="radius that the pressure takes, mm", ylabel="loss of radius that was stated, mm"
    )
    axes.legend(loc="upper left", frameon=False, fontsize=8)
    axes.set_title("Soft wheels when the case ended", fontsize=10, loc="left")


def _rates(axes: Any, legs: Sequence[Row]) -> None:
    """False alarms by confounder, with intervals."""
    names = [tag for tag in TAGS if legs_with(tag, legs)]
    for k, tag in enumerate(reversed(names)):
        group = legs_with(tag, legs)
        part = rate(sum(len(row["deflation"]) for row in group), sum(row["km"] for row in group))
        axes.plot([max(part["low"], 0.1), part["high"]], [k, k], color="0.6", lw=1.5)
        axes.plot(max(part["rate"], 0.1), k, "o", color=COLOURS[1] if part["events"] else COLOURS[2], ms=5)
        axes.text(
            1.02,
            k,
            f"{part['events']} in {part['km']:.0f} km",
            transform=axes.get_yaxis_transform(),
            va="center",
            fontsize=7,
        )
    axes.axvline(1.0, color="0.8", lw=0.8, zorder=0)
    axes.set_yticks(range(len(names)), list(reversed(names)), fontsize=8)
    axes.set(
        xscale="log",
        xlim=(0.08, 30_000.0),
        xlabel="deflation alarms per 10,000 km (0.1: none), 95 % interval",
    )
    axes.set_title("No fault, by what confounds", fontsize=10, loc="left")
