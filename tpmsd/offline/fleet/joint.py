"""All drives of a fleet judged together: the rows of cars and models.

In: the drives and their results. Out: rows of the tables `findings` (levels car and model) and `statistics`
(levels car and model: values with standard deviations and spreads). Pure.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.fleet.discoveries import (
    FleetHypothesis,
    cars_that_differ,
    controlled,
    model_effects,
    robust_fit,
    trends,
)
from tpmsd.offline.fleet.hierarchy import FleetStatistics, ModelFit
from tpmsd.offline.fleet.losses import DAY_S, losses
from tpmsd.offline.fleet.parameters import PARAMETERS_OF_FLEET, aligned
from tpmsd.offline.fleet.store import DriveEntry

Row = dict[str, Any]


def joint_rows(
    entries: Sequence[DriveEntry], results: Mapping[str, dict[str, Any] | None]
) -> tuple[list[Row], list[Row]]:
    """Rows for findings and for statistics."""
    groups: dict[str, list[tuple[str, str, dict[str, Any], float]]] = defaultdict(list)
    for entry in entries:
        result = results[entry.key]
        sums = ((result or {}).get("calibrate") or {}).get("statistics")
        if result is not None and sums is not None:
            start = (result.get("replay") or {}).get("start_time")
            day = float("nan") if start is None else float(start) / DAY_S
            groups[entry.model].append((entry.car, entry.key, sums, day))
    tested: list[FleetHypothesis] = []
    statistics: list[Row] = []
    for model in sorted(groups):
        drives = sorted(groups[model], key=lambda one: one[:2])
        cars = sorted({car for car, _, _, _ in drives})
        stack, days = _stack(drives, cars)
        fit, similar = robust_fit(stack)
        tested += model_effects(model, fit)
        tested += cars_that_differ(model, cars, fit, similar)
        tested += trends(model, cars, stack, days, np.square(fit.drive_spread))
        tested += losses(model, cars, stack, days, np.square(fit.drive_spread))
        statistics += _statistics(model, cars, fit)
    return [_finding(one) for one in controlled(tested) if one.kept], statistics


def _stack(
    drives: Sequence[tuple[str, str, dict[str, Any], float]], cars: Sequence[str]
) -> tuple[FleetStatistics, FloatArray]:
    number = {car: k for k, car in enumerate(cars)}
    pairs = [aligned(sums["names"], *_unpacked(sums)) for _, _, sums, _ in drives]
    stack = FleetStatistics(
        np.array([information for information, _ in pairs]),
        np.array([vector for _, vector in pairs]),
        np.array([number[car] for car, _, _, _ in drives], dtype=np.int64),
    )
    return stack, np.array([days for _, _, _, days in drives], dtype=np.float64)


def _unpacked(sums: dict[str, Any]) -> tuple[FloatArray, FloatArray]:
    """Matrix and vector of a packed lower triangle."""
    p = len(sums["names"])
    matrix = np.zeros((p, p))
    matrix[np.tril_indices(p)] = sums["information"]
    return matrix + matrix.T - np.diag(np.diag(matrix)), np.array(sums["vector"], dtype=np.float64)


def _finding(one: FleetHypothesis) -> Row:
    return {
        "level": one.level,
        "model": one.model,
        "car": one.car or None,
        "kind": one.kind,
        "effect": one.effect,
        "parameter": one.parameter,
        "value": one.value,
        "std": one.std,
        "unit": one.unit,
        "p_value": one.p_value,
        "since": one.since_s,
        "status": "finding",
    }


def _statistics(model: str, cars: Sequence[str], fit: ModelFit) -> list[Row]:
    rows = []
    for k, parameter in enumerate(PARAMETERS_OF_FLEET):
        scale = parameter.scale
        shared = {"model": model, "parameter": parameter.name, "unit": parameter.unit}
        spread = {"spread_cars": fit.car_spread[k] * scale, "spread_drives": fit.drive_spread[k] * scale}
        rows.append(
            {
                "level": "model",
                **shared,
                "value": fit.mean[k] * scale,
                "std": fit.std[k] * scale,
                **spread,
                "drives": int(fit.drives.sum()),
            }
        )
        stds = np.sqrt(np.maximum(fit.shrunk_covariance[:, k, k], 0.0))
        rows += [
            {
                "level": "car",
                **shared,
                "car": car,
                "value": fit.shrunk[c, k] * scale,
                "std": stds[c] * scale,
                "drives": int(fit.drives[c]),
            }
            for c, car in enumerate(cars)
        ]
    for row in rows:
        for name, value in row.items():
            if isinstance(value, float):  # the last digits depend on the processor's linear algebra
                row[name] = float(f"{value:.9g}")
    return rows
