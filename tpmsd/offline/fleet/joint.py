"""All drives of a fleet judged together: the rows of cars and models.

In: the drives and their results. Out: rows of the tables `findings` (levels car and model) and `statistics`
(levels car and model: values with standard deviations and spreads). Pure.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.fleet.discoveries import (
    FleetHypothesis,
    cars_that_differ,
    control_false_discoveries,
    model_effects,
    radius_trends,
    robust_fit,
)
from tpmsd.offline.fleet.hierarchy import FleetStatistics, ModelFit
from tpmsd.offline.fleet.losses import DAY_S, radius_losses
from tpmsd.offline.fleet.parameters import PARAMETERS_OF_FLEET, statistics_in_fleet_parameters
from tpmsd.offline.fleet.settings import SETTINGS
from tpmsd.offline.fleet.store import DriveEntry

Row = dict[str, Any]
_Drive = tuple[str, str, dict[str, Any], float]
"""Car, key, packed statistics, day."""


def joint_rows(
    entries: Sequence[DriveEntry], results: Mapping[str, dict[str, Any] | None]
) -> tuple[list[Row], list[Row]]:
    """Return the rows of the tables of findings (those kept) and of statistics, over all models."""
    groups: dict[str, list[_Drive]] = defaultdict(list)
    for entry in entries:
        result = results[entry.key]
        sums = ((result or {}).get("calibrate") or {}).get("statistics")
        if result is not None and sums is not None:
            start = (result.get("replay") or {}).get("start_time")
            day = float("nan") if start is None else float(start) / DAY_S
            groups[entry.model].append((entry.car, entry.key, sums, day))
    models = sorted(groups)
    # Models do not depend on each other, and linear algebra runs beside the interpreter; few at a time bound
    # the memory.
    with ThreadPoolExecutor(SETTINGS.models_at_once) as pool:
        judged = list(pool.map(lambda model: _judge_model(model, groups[model]), models))
    tested = [one for found, _ in judged for one in found]
    statistics = [row for _, rows in judged for row in rows]
    return [_finding_row(one) for one in control_false_discoveries(tested) if one.kept], statistics


def _judge_model(model: str, group: Sequence[_Drive]) -> tuple[list[FleetHypothesis], list[Row]]:
    """Return the tested hypotheses on a model and its cars, and the rows of their statistics."""
    drives = sorted(group, key=lambda one: one[:2])
    cars = sorted({car for car, _, _, _ in drives})
    stack, days = _stack_drives(drives, cars)
    fit, similar = robust_fit(stack)
    drive_variance = np.square(fit.drive_spread)
    tested = [
        *model_effects(model, fit),
        *cars_that_differ(model, cars, fit, similar),
        *radius_trends(model, cars, stack, days, drive_variance),
        *radius_losses(model, cars, stack, days, drive_variance),
    ]
    return tested, _parameter_rows(model, cars, fit)


def _stack_drives(drives: Sequence[_Drive], cars: Sequence[str]) -> tuple[FleetStatistics, FloatArray]:
    """Return the statistics of the drives and their (n,) dates in days, NaN where the date is not known."""
    number = {car: k for k, car in enumerate(cars)}
    p = len(PARAMETERS_OF_FLEET)
    information, vector = np.empty((len(drives), p, p)), np.empty((len(drives), p))
    same_names: dict[tuple[str, ...], list[int]] = defaultdict(list)
    for k, (_, _, sums, _) in enumerate(drives):
        same_names[tuple(sums["names"])].append(k)
    for names, which in same_names.items():
        for begin in range(0, len(which), SETTINGS.chunk_drives):
            part = which[begin : begin + SETTINGS.chunk_drives]
            information[part], vector[part] = statistics_in_fleet_parameters(
                names, *_unpack_statistics([drives[k][2] for k in part])
            )
    of_car = np.array([number[car] for car, _, _, _ in drives], dtype=np.int64)
    stack = FleetStatistics(information, vector, of_car)
    return stack, np.array([days for _, _, _, days in drives], dtype=np.float64)


def _unpack_statistics(sums: Sequence[dict[str, Any]]) -> tuple[FloatArray, FloatArray]:
    """Return the (n, p, p) matrices of packed lower triangles and the (n, p) vectors, of drives with the same
    names.
    """
    rows, columns = np.tril_indices(len(sums[0]["names"]))
    matrix = np.empty((len(sums), len(sums[0]["names"]), len(sums[0]["names"])))
    matrix[:, rows, columns] = matrix[:, columns, rows] = [one["information"] for one in sums]
    return matrix, np.array([one["vector"] for one in sums], dtype=np.float64)


def _finding_row(one: FleetHypothesis) -> Row:
    """Return the row of a hypothesis in the table of findings."""
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


def _parameter_rows(model: str, cars: Sequence[str], fit: ModelFit) -> list[Row]:
    """Return the rows of the table of statistics: population and cars of a model, parameter by parameter."""
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
