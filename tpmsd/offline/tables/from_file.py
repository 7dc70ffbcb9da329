"""A table with its map as a car's signals.

In: a table's path, a `TableMap`. Out: role -> `SignalReadings` in SI units, the moduli of counts, the car's
tables. A column that the map names and the table lacks is reported with the map's line.
"""

from __future__ import annotations

import dataclasses
import tomllib
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from tpmsd.car.config.dynamics import RADIUS
from tpmsd.car.config.problems import BadValueError, ConfigProblems, Problem
from tpmsd.car.config.suggest import nearest
from tpmsd.foundation.errors import ConfigError, InputError, TpmsdError
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.tables.map_file import ColumnMap, TableMap
from tpmsd.offline.tables.read_table import InputTable, read_table
from tpmsd.offline.tables.roles import TIME_UNITS, is_road_speed, scale_of, split_name
from tpmsd.offline.tables.signals import SignalReadings

TIME = "time_s"
_TYPICAL_RADIUS_M = 0.3


@dataclasses.dataclass(frozen=True)
class FileSignals:
    """Content of a table file."""

    series: dict[str, SignalReadings]
    moduli: dict[str, int]
    car: dict[str, dict[str, Any]]
    """Tables of a vehicle.toml that the map or the table itself brings; empty where the map names a file."""


def read_signals(path: Path, mapped: TableMap) -> FileSignals:
    """Return the readings of all mapped columns by role, and the car's tables.

    InputError where the table cannot be used; ConfigProblems where the map does not fit to it.
    """
    columns = mapped.columns
    wanted = None
    if columns is not None:
        times = {one.time for one in columns.values()} | {mapped.time}
        wanted = {one.column for one in columns.values()} | {name for name in times if name}
    with closing(read_table(path, wanted)) as table:
        return _signals_of(table, path, mapped)


def _signals_of(table: InputTable, path: Path, mapped: TableMap) -> FileSignals:
    columns = mapped.columns
    car = mapped.car
    if not car.get("vehicle") and mapped.config is None and table.vehicle_toml is not None:
        car = {**tomllib.loads(table.vehicle_toml), **car}
    if columns is None:
        columns = _columns_by_names(table, path)
    else:
        _check_columns_exist(table, mapped)
    radii = _nominal_radii(mapped, car)
    series: dict[str, SignalReadings] = {}
    for role, one in columns.items():
        values = table.column(one.column)
        values = np.where(np.isin(values, one.invalid), np.nan, values) if one.invalid else values
        factor, offset = scale_of(role, one.unit)
        values = factor * (one.scale * values + one.offset) + offset
        if is_road_speed(role, one.unit):
            values = values / radii[role[-2:]]
        time_s = _column_times(table, path, mapped, one)
        if len(time_s) != len(values):
            raise InputError(path, f"{one.column}: {len(values)} values, {len(time_s)} times")
        series[role] = SignalReadings(time_s, values)
        _check_descends(table, path, role, series[role])
    moduli = {role: one.modulus for role, one in columns.items() if one.modulus is not None}
    return FileSignals(series, moduli, car)


def _check_descends(table: InputTable, path: Path, role: str, series: SignalReadings) -> None:
    """Check that the times of a column's readings never descend; InputError with the line where one does."""
    there = np.flatnonzero(np.isfinite(series.value) & np.isfinite(series.time_s))
    falls = np.flatnonzero(np.diff(series.time_s[there]) < 0.0)
    if len(falls):
        row = int(there[falls[0] + 1])
        raise InputError(path, f"{role}: time does not rise at {series.time_s[row]:.6f} s", table.line(row))


def _columns_by_names(table: InputTable, path: Path) -> dict[str, ColumnMap]:
    """Return columns whose names are a role with its unit, as in the tick table."""
    found = {}
    for name in table.names:
        split = split_name(name)
        if split is not None and split[0] not in found:
            found[split[0]] = ColumnMap(name, split[1])
    if not found:
        raise ConfigError(
            f"{path}: no column's name is a role with a unit; give --map (docs/how-to/python.md)"
        )
    return found


def _check_columns_exist(table: InputTable, mapped: TableMap) -> None:
    problems = _missing_columns(table, mapped)
    if problems:
        raise ConfigProblems(problems)


def missing_columns(path: Path, mapped: TableMap) -> list[Problem]:
    """Return the columns that a map names and the table lacks, as problems; empty where the table cannot be
    read.
    """
    try:
        with closing(read_table(path, ())) as table:
            return _missing_columns(table, mapped)
    except TpmsdError:
        return []


def _missing_columns(table: InputTable, mapped: TableMap) -> list[Problem]:
    wanted = list(mapped.named)
    here = next((name for name, _, _ in wanted if name in table.names), None)
    shared = here is None or table.own_time(here) is None
    if mapped.time is not None and shared:
        wanted.append((mapped.time, "[table] time", mapped.time_line))
    problems: list[Problem] = []
    all_timed = mapped.columns is not None and all(one.time for one in mapped.columns.values())
    if mapped.time is None and shared and TIME not in table.names and not all_timed:
        bad = BadValueError(f"missing; the table has no column {TIME}")
        problems.append(bad.at(mapped.file or "map", mapped.time_line, "[table] time"))
    for name, key, line in wanted:
        if name not in table.names:
            bad = BadValueError(f"the table has no column {name!r}", suggestion=nearest(name, table.names))
            problems.append(bad.at(mapped.file or "map", line, key))
    return sorted(problems, key=lambda problem: problem.line or 0)


def _column_times(table: InputTable, path: Path, mapped: TableMap, one: ColumnMap) -> FloatArray:
    """Return the times of a column's readings, s: by its own column of times, the signal's own, or the
    table's.
    """
    if one.time is not None:
        return table.column(one.time) * TIME_UNITS[one.time_unit]
    own = table.own_time(one.column)
    if own is not None:
        return own
    if mapped.time is not None:
        return table.column(mapped.time) * TIME_UNITS[mapped.time_unit]
    if TIME not in table.names:
        raise ConfigError(f"{mapped.file or path}: [table] time: missing; the table has no column {TIME}")
    return table.column(TIME)


def _nominal_radii(mapped: TableMap, car: dict[str, dict[str, Any]]) -> dict[str, float]:
    """Return the nominal radii, m, by which road speeds are divided; typical ones for invalid ones, which are
    reported with the car.
    """
    if mapped.config is not None:
        return dict(zip(WHEELS, mapped.config.vehicle.wheel_radius_m, strict=True))
    radius = car.get("vehicle", {}).get("wheel_radius_m", _TYPICAL_RADIUS_M)
    each = radius if isinstance(radius, dict) else dict.fromkeys(WHEELS, radius)
    return {wheel: _radius_or_typical(each.get(wheel)) for wheel in WHEELS}


def _radius_or_typical(value: object) -> float:
    try:
        return RADIUS.read(value)
    except BadValueError:
        return _TYPICAL_RADIUS_M
