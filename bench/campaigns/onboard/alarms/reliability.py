"""Is P(deflation) a probability? What was stated, by classes, against what was so.

In: a leg as it was driven and what was stated on it. Out: counts for its row; and of many rows the table.

Smaller losses count by their share of the threshold; so the truth of a wheel at an instant
is its loss over the threshold, at most 1, and calibrated probabilities of a class average to its mean truth.
Instants of one drive are alike: how many drives a class has says how much it is worth.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Any

import numpy as np

from bench.campaigns.onboard.alarms.play import LegResult
from bench.worlds.trip_road import STEP_S
from bench.worlds.trips import Driven
from tpmsd.car.config.model import MonitorConfig

Row = dict[str, Any]
EDGES = (0.0, 0.01, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99, 1.0)
THRESHOLD = MonitorConfig().deflation_percent / 100.0


def counts(driven: Driven, outcome: LegResult) -> list[list[float]]:
    """Of each class: instants of wheels, sum of what was stated, sum of what was so."""
    out = np.zeros((len(EDGES) - 1, 3))
    for time_s, stated in outcome.probabilities:
        at = min(max(round(time_s / STEP_S), 0), len(driven.lost_m) - 1)
        truth = np.clip(driven.lost_m[at] / driven.radius_m[at] / THRESHOLD, 0.0, 1.0)
        for chance, so in zip(stated, truth.tolist(), strict=True):
            of_class = min(int(np.searchsorted(EDGES, chance, side="right")) - 1, len(out) - 1)
            out[of_class] += (1.0, chance, so)
    return [[round(value, 6) for value in row] for row in out.tolist()]


def reliability(rows: Iterable[Row]) -> list[Row]:
    """Of each class over all rows: drives, instants, mean stated, mean truth; None of nothing."""
    found = [np.array(row["reliability"]) for row in rows if "reliability" in row]
    out = []
    for k, (low, high) in enumerate(itertools.pairwise(EDGES)):
        of_class = [one[k] for one in found if one[k, 0] > 0.0]
        number, stated, so = np.sum(of_class, axis=0) if of_class else (0.0, 0.0, 0.0)
        out.append(
            {
                "from": low,
                "to": high,
                "drives": len(of_class),
                "instants": int(number),
                "stated": float(stated / number) if number else None,
                "true": float(so / number) if number else None,
            }
        )
    return out
