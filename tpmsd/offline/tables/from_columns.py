"""Arrays and data frames with named columns as series by role.

In: mappings (dicts, data frames) from a column's name, its unit as suffix, to an array. Out: role ->
`SignalReadings` in SI units. Pure.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol

import numpy as np

from tpmsd.car.config.suggest import nearest
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.tables.columns import BY_NAME
from tpmsd.offline.tables.roles import ROLES, SUFFIXES, is_road_speed, scale_of, split_name
from tpmsd.offline.tables.signals import SignalReadings

TIME = "time_s"


class InMemoryTable(Protocol):
    """A dict of arrays, a data frame, a structured array."""

    def __getitem__(self, name: str, /) -> Any:
        """Return a column."""
        ...


def series_of(
    columns: InMemoryTable, what: str, radius_m: Iterable[float], prefix: str = ""
) -> dict[str, SignalReadings]:
    """Return a mapping role -> readings of the columns whose names are roles.

    `what` is the argument's name, for errors; `radius_m` (4,) divides speeds along the road; `prefix` may be
    left out in the names. Other columns of the tick table are passed over; a column that is neither is a
    ConfigError, as are columns of unequal length.
    """
    names = _column_names(columns, what)
    if TIME not in names:
        raise ConfigError(f"{what}: no column {TIME}; found {', '.join(names) or 'none'}")
    time_s = _column_values(columns, TIME, what)
    radii = dict(zip(WHEELS, radius_m, strict=True))
    found: dict[str, SignalReadings] = {}
    # In a table that spells the prefix out, `speed_mps` is something else.
    prefix = "" if any(prefix and name.startswith(prefix) for name in names) else prefix
    for name in names:
        split = split_name(name, prefix)
        if name == TIME or (split is None and name in BY_NAME):
            continue
        if split is None:
            stem, _, suffix = name.rpartition("_")
            near = nearest(stem if suffix in SUFFIXES else name, ROLES)
            hint = f"; did you mean {near}?" if near else f"; roles: {' '.join(ROLES)}"
            raise ConfigError(f"{what}: column {name!r} is no role with a unit{hint}")
        role, unit = split
        if role in found:
            raise ConfigError(f"{what}: {role} is given twice")
        values = _column_values(columns, name, what)
        if len(values) != len(time_s):
            raise ConfigError(f"{what}: {name} has {len(values)} rows, {TIME} {len(time_s)}")
        factor, offset = scale_of(role, unit)
        if is_road_speed(role, unit):
            factor /= radii[role[-2:]]
        found[role] = SignalReadings(time_s, values * factor + offset)
    return found


def _column_names(columns: Any, what: str) -> list[str]:
    if hasattr(columns, "columns"):  # data frames of pandas and polars
        return [str(name) for name in columns.columns]
    if getattr(getattr(columns, "dtype", None), "names", None):
        return list(columns.dtype.names)
    if hasattr(columns, "keys"):
        return [str(name) for name in columns.keys()]  # noqa: SIM118 - a mapping-like, not always iterable so
    raise ConfigError(f"{what}: give a dict of arrays or a data frame, not {type(columns).__name__}")


def _column_values(columns: Any, name: str, what: str) -> FloatArray:
    """Return a column as a one-dimensional array; ConfigError where it is none."""
    try:
        values = np.asarray(columns[name], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{what}: {name}: not numbers: {error}") from None
    if values.ndim != 1:
        raise ConfigError(f"{what}: {name} has shape {values.shape}, one dimension is wanted")
    return values
