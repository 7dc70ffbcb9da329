"""A drive's result as it comes back from the store, held against the form that the tables take.

In: a JSON value. Out: the same value, or ValueError that names the damaged part. Pure.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.fleet.settings import SETTINGS

STATES = ("done", "failed", "set_aside")
_LARGEST = SETTINGS.largest_information

Check = Callable[[Any, str], None]


def check_result(found: Any) -> dict[str, Any]:
    """Return the result unchanged; ValueError where it does not have the form of one."""
    result = _checked_table(found, "result")
    if result.get("status") not in STATES:
        raise ValueError("status is none")
    _check_text(result.get("reason"), "reason")
    _check_text(result.get("program"), "program")
    for stage in _checked_rows(result.get("stages"), "stages"):
        _check_text(stage, "stages")
    replay = _checked_optional_table(result.get("replay"), "replay")
    for name in ("start_time", "duration_s", "distance_m"):
        _check_number(replay.get(name), name)
    for wheel, one in _checked_table(replay.get("wheels", {}), "wheels").items():
        if wheel not in WHEELS:
            raise ValueError(f"wheels: {wheel[:20]!r} is no wheel")
        _check_row(one, "wheels", ("state",))
    for alarm in _checked_rows(replay.get("alarms", []), "alarms"):
        _check_row(alarm, "alarms", ("kind", "wheel", "state", "reason"))
    _check_calibration(_checked_optional_table(result.get("calibrate"), "calibrate"))
    diagnosis = _checked_optional_table(result.get("diagnose"), "diagnose")
    for name in ("verdict", "reason"):
        _check_text_or_none(diagnosis.get(name), name)
    for finding in _checked_rows(diagnosis.get("findings", []), "findings"):
        _check_finding(_checked_table(finding, "findings"))
    return result


def _check_calibration(calibration: dict[str, Any]) -> None:
    _check_text_or_none(calibration.get("reason"), "calibrate")
    statistics = calibration.get("statistics")
    if statistics is None:
        return
    statistics = _checked_table(statistics, "statistics")
    names = _checked_rows(statistics.get("names"), "names")
    for name in names:
        _check_text(name, "names")
    count = len(names)
    if count > SETTINGS.result_names or len(set(names)) < count:
        raise ValueError("names: too many, or one twice")
    triangle = _checked_rows(statistics.get("information"), "information")
    vector = _checked_rows(statistics.get("vector"), "vector")
    if len(triangle) != count * (count + 1) // 2 or len(vector) != count:
        raise ValueError("information: another shape than its names")
    if not set(map(type, triangle)) | set(map(type, vector)) <= {int, float}:
        raise ValueError("information: no number")
    for values in (triangle, vector):
        if values:
            _check_number(min(values), "information")
            _check_number(max(values), "information")
    matrix = np.zeros((count, count))
    matrix[lower_triangle(count)] = triangle
    std = np.sqrt(np.maximum(np.diag(matrix), 1e-30))
    scaled = matrix / std / std[:, None]
    if count and is_indefinite(scaled):
        raise ValueError("information: not that of any drive")


@cache
def lower_triangle(count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows and columns of a packed lower triangle, row by row."""
    return np.tril_indices(count)


def is_indefinite(scaled: FloatArray) -> bool:
    """Return whether a matrix of unit diagonal, given by its lower triangle, has negative eigenvalues beyond
    rounding.
    """
    count = len(scaled)
    try:  # a tenth of the time of eigenvalues, and enough for matrices that are definite
        np.linalg.cholesky(scaled + SETTINGS.indefinite * count * np.eye(count))
    except np.linalg.LinAlgError:
        return bool(np.linalg.eigvalsh(scaled)[0] < -SETTINGS.indefinite * count)
    return False


def _check_finding(finding: dict[str, Any]) -> None:
    if not {"effect", "confidence", "parameters"} <= finding.keys():
        raise ValueError("findings: no effect, confidence and parameters")
    _check_text(finding.get("effect"), "effect")
    _check_number(finding.get("confidence"), "confidence")
    _check_number(finding.get("p_value"), "p_value")
    _check_text(finding.get("status", ""), "status")
    for name, quantity in _checked_optional_table(finding.get("parameters"), "parameters").items():
        one = _checked_table(quantity, name)
        if not {"value", "std", "unit"} <= one.keys():
            raise ValueError("parameters: no value, std and unit")
        _check_number(one["std"], "std")
        _check_text_or_none(one["unit"], "unit")
        if isinstance(one["value"], int | float):
            _check_number(one["value"], "value")
        elif isinstance(one["value"], dict | list):
            raise ValueError("value: no number and no text")


def _check_row(found: Any, what: str, texts: tuple[str, ...]) -> None:
    """Check a table's row: the named columns are text (or a list, kept as JSON text), the others numbers."""
    numbers = _number_columns(what)
    for name, value in _checked_table(found, what).items():
        if name in texts:
            if not isinstance(value, list):
                _check_text_or_none(value, f"{what}.{name}")
        elif name in numbers:
            _check_number(value, f"{what}.{name}")


@cache
def _number_columns(what: str) -> frozenset[str]:
    """Return the columns of a table that are numbers."""
    from tpmsd.offline.fleet.tables import COLUMNS

    return frozenset(name for name, kind in COLUMNS[what].items() if kind == "double")


def _checked_table(found: Any, what: str) -> dict[str, Any]:
    if not isinstance(found, dict):
        raise ValueError(f"{what}: no table")
    return found


def _checked_optional_table(found: Any, what: str) -> dict[str, Any]:
    """Return the table, empty where there is none."""
    return {} if found is None else _checked_table(found, what)


def _checked_rows(found: Any, what: str) -> list[Any]:
    if not isinstance(found, list) or len(found) > SETTINGS.result_rows:
        raise ValueError(f"{what}: no list")
    return found


def _check_text(found: Any, what: str) -> None:
    if not isinstance(found, str):
        raise ValueError(f"{what}: no text")


def _check_text_or_none(found: Any, what: str) -> None:
    if found is not None:
        _check_text(found, what)


def _check_number(found: Any, what: str) -> None:
    """Check for a finite number, or null."""
    if found is None or (type(found) is float and -_LARGEST <= found <= _LARGEST):
        return
    if isinstance(found, bool) or not isinstance(found, int | float):
        raise ValueError(f"{what}: no number")
    if not -_LARGEST <= found <= _LARGEST:
        raise ValueError(f"{what}: beyond its bounds")
