"""How each method is tuned: a grid, on drives of a seed that no table uses.

In: nothing. Out: the runs of the grid, and of their scores the best setting per method and receiver.

The criterion is the geometric mean of two RMSEs, of mu3 - mu4 and of the radii, each pooled over scenarios:
the paper looks at the first, a user at both. A run that diverged counts with ten times its RMSE.
"""

from __future__ import annotations

import math
from collections import defaultdict
from itertools import product
from typing import Any

from bench.campaigns.onboard.estimators.methods import TEXTBOOK, Setting, available
from bench.campaigns.onboard.estimators.tasks import RECEIVERS, Task

SEED = 900
SCENARIOS = ("unbalanced", "lively")
PARTICLES = 500
WINDOWS_S = (10.0, 20.0, 60.0, 180.0)
FACTORS = (1.0, 3.0, 6.0)
DRIFTS_M = (0.02e-3, 0.06e-3, 0.2e-3)
"""Random walk of mu, m per sqrt(s), for the augmented filters."""
YAW_ACCELS = (0.1, 0.25, 0.6)
"""Random walk of the yaw rate, rad/s2, for MPF-MN."""


def grid(method: str) -> list[Setting]:
    """The settings that a method is tried with; none for one that has nothing to tune here."""
    if method in (TEXTBOOK, "mpf-pn-niw"):
        return [Setting(w, f) for w, f in product(WINDOWS_S, FACTORS)]
    if method.startswith("aug-"):
        return [Setting(60.0, f, (("drift_std_m", d),)) for d, f in product(DRIFTS_M, FACTORS)]
    if method == "mpf-mn":
        return [
            Setting(w, f, (("yaw_accel_std_radps2", y),))
            for w, f, y in product(WINDOWS_S, FACTORS, YAW_ACCELS)
        ]
    return []


def tasks() -> list[Task]:
    """All runs of the grid, sorted by drive."""
    have, _ = available()
    return [
        Task(scenario, receiver, SEED, method, 0 if "kf" in method else PARTICLES, False, setting)
        for receiver in RECEIVERS
        for scenario in SCENARIOS
        for method in have
        for setting in grid(method)
    ]


def criterion(rows: list[dict[str, Any]]) -> float:
    """Geometric mean of both RMSEs, each pooled over the runs of one setting, mm."""
    pooled = []
    for key in ("rmse_difference_m", "rmse_radius_m"):
        squares = [(1e3 * row[key] * (10.0 if row["diverged"] else 1.0)) ** 2 for row in rows]
        pooled.append(math.sqrt(sum(squares) / len(squares)))
    value = math.sqrt(pooled[0] * pooled[1])
    return value if math.isfinite(value) else math.inf


def best(rows: list[dict[str, Any]]) -> tuple[dict[tuple[str, str], Setting], list[str]]:
    """Best setting per (method, receiver), and the whole grid as lines of Markdown."""
    groups: dict[tuple[str, str, Setting], list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        setting = row["setting"]
        if isinstance(setting, dict):
            setting = Setting(
                setting["window_s"], setting["receiver_factor"], tuple((n, v) for n, v in setting["options"])
            )
        groups[row["method"], row["receiver"], setting].append(row)
    lines = [
        "| method | receiver | window s | receiver factor | option | criterion mm |",
        "|---|---|---|---|---|---|",
    ]
    scores: dict[tuple[str, str], list[tuple[float, Setting]]] = defaultdict(list)
    for (method, receiver, setting), some in sorted(groups.items(), key=lambda item: repr(item[0])):
        value = criterion(some)
        scores[method, receiver].append((value, setting))
        option = ", ".join(f"{name} {number:g}" for name, number in setting.options)
        tried = f"{setting.window_s:g} | {setting.receiver_factor:g} | {option}"
        lines.append(f"| {method} | {receiver} | {tried} | {value:.3f} |")
    return {key: min(some, key=lambda pair: pair[0])[1] for key, some in scores.items()}, lines
