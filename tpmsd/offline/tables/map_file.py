"""Map of a table: meaning and unit of each column, and its car. Checked like a configuration.

In: the path of a map.toml. Out: `TableMap`, or `ConfigProblems` with every problem and its line.

    vehicle = "vehicle.toml"            # or the tables [vehicle], [gnss], ... of a vehicle.toml in this file

    [table]
    time = "t"                          # column of the time; of MF4 files each signal brings its own
    time_unit = "ms"                    # s (default), ms, us, ns

    [columns]                           # role = column; without [columns] the names tell role and unit
    wheel_speed_fl = { column = "whl_spd[0]", unit = "km/h" }
    wheel_count_rl = { column = "cnt_rl", modulus = 1001 }
    yaw_rate = { column = "gyro_z", unit = "deg/s", scale = -1.0, invalid = [-999], time = "t2" }
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tpmsd.car.config.document import Document, read_document
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config
from tpmsd.car.config.problems import BadValueError, ConfigProblems, Problem, show
from tpmsd.car.config.schema import tables as config_tables
from tpmsd.car.config.suggest import nearest
from tpmsd.foundation.errors import ConfigError
from tpmsd.offline.tables.roles import COUNT_ROLES, ROLES, TIME_UNITS, scale_of

MAX_MODULUS = 2**32
_COLUMN_KEYS = ("column", "unit", "scale", "offset", "modulus", "invalid", "time", "time_unit")
_TABLE_KEYS = ("time", "time_unit")


@dataclass(frozen=True)
class ColumnMap:
    """Column that a role is read from, and how its numbers become SI values."""

    column: str
    unit: str | None = None
    scale: float = 1.0
    """Before the unit: value in the unit = scale * number + offset."""
    offset: float = 0.0
    modulus: int | None = None
    invalid: tuple[float, ...] = ()
    """Numbers that mean 'no value'."""
    time: str | None = None
    time_unit: str = "s"
    line: int | None = None


@dataclass(frozen=True)
class TableMap:
    """Meaning of a table's columns."""

    file: Path | None = None
    time: str | None = None
    time_unit: str = "s"
    time_line: int | None = None
    columns: dict[str, ColumnMap] | None = None
    """Columns by role; None: by the columns' names."""
    car: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Tables of a vehicle.toml."""
    config: Config | None = None
    """The configuration of a vehicle.toml that the map names."""
    named: tuple[tuple[str, str, int | None], ...] = ()
    """Every column that [columns] names, also in an entry that is wrong: its name, the key and the line."""


def load_map(path: Path) -> TableMap:
    """Return the map in a file; ConfigProblems with everything that is wrong."""
    found, problems = read_map(path)
    if problems:
        raise ConfigProblems(problems)
    return found


def read_map(path: Path) -> tuple[TableMap, list[Problem]]:
    """Return the map in a file, and everything that is wrong with it by its lines; ConfigProblems where it is
    no TOML.
    """
    return _Reader(read_document(path)).read()


class _Reader:
    def __init__(self, document: Document) -> None:
        self._document = document
        self._problems: list[Problem] = []
        self._named: list[tuple[str, str, int | None]] = []

    def read(self) -> tuple[TableMap, list[Problem]]:
        """Return the map, and the problems that were found."""
        data = self._document.data
        cars = {name for name in config_tables(Path()) if "." not in name} - {
            "can",
            "alarms",
            "status",
            "state",
        }
        for name in data:
            if name not in {"vehicle", "table", "columns", *cars}:
                known = ("vehicle", "table", "columns", *sorted(cars - {"vehicle"}))
                self._report(
                    BadValueError("unknown", allowed=" ".join(known), suggestion=nearest(name, known)), name
                )
        config = self._read_vehicle(data.get("vehicle"))
        car = {name: dict(data[name]) for name in cars if isinstance(data.get(name), dict)}
        table = self._checked_table(data.get("table", {}), "table", _TABLE_KEYS)
        time = self._checked_text(table.get("time"), "table", "time")
        unit = self._checked_time_unit(table.get("time_unit", "s"), "table", "time_unit")
        columns = self._checked_columns(data["columns"]) if "columns" in data else None
        line = self._document.line("table", "time")
        named = tuple(self._named)
        found = TableMap(self._document.file, time, unit, line, columns, car, config, named)
        return found, sorted(self._problems, key=lambda problem: problem.line or 0)

    def _read_vehicle(self, vehicle: object) -> Config | None:
        if isinstance(vehicle, str):
            try:
                return load_config(self._document.file.parent / vehicle)
            except ConfigProblems as error:
                self._problems += error.problems
        elif vehicle is not None and not isinstance(vehicle, dict):
            self._report(BadValueError("not a path nor a table", show(vehicle)), "vehicle")
        return None

    def _checked_columns(self, given: object) -> dict[str, ColumnMap]:
        """Return the table [columns] by role; its errors are reported."""
        found: dict[str, ColumnMap] = {}
        for role, value in self._checked_table(given, "columns", ()).items():
            self._note_column_names(role, value)
            if role not in ROLES:
                near = nearest(role, ROLES)
                allowed = None if near else " ".join(ROLES)
                self._report(BadValueError("unknown role", allowed=allowed, suggestion=near), "columns", role)
                continue
            entry = {"column": value} if isinstance(value, str) else value
            if not isinstance(entry, dict):
                bad = BadValueError("not a column", show(value), "a name in quotes, or { column = ... }")
                self._report(bad, "columns", role)
                continue
            made = self._read_column(role, entry)
            if made is not None:
                found[role] = made
        return found

    def _note_column_names(self, role: str, value: object) -> None:
        """Record the columns that an entry names, for the table may lack them."""
        line = self._document.line("columns", role)
        entry = value if isinstance(value, dict) else {"column": value}
        for key, shown in (("column", role), ("time", f"{role}.time")):
            name = entry.get(key)
            if isinstance(name, str):
                self._named.append((name, f"[columns] {shown}", line))

    def _read_column(self, role: str, entry: dict[str, Any]) -> ColumnMap | None:
        before = len(self._problems)
        self._checked_table(entry, f"columns.{role}", _COLUMN_KEYS, ("columns", role))
        where = ("columns", role)
        column = self._checked_text(entry.get("column"), *where, "column")
        if column is None:
            self._report(BadValueError("no column"), *where)
        unit = self._checked_text(entry.get("unit"), *where, "unit")
        try:
            scale_of(role, unit)
        except ConfigError as error:
            self._report(BadValueError(str(error)), *where, "unit")
        numbers = {}
        for key, usual in (("scale", 1.0), ("offset", 0.0)):
            numbers[key] = self._checked_number(entry.get(key, usual), *where, key)
        if numbers["scale"] == 0.0:
            self._report(BadValueError("is zero"), *where, "scale")
        modulus = entry.get("modulus")
        if modulus is not None:
            whole = isinstance(modulus, int) and not isinstance(modulus, bool) and 2 <= modulus <= MAX_MODULUS
            if role not in COUNT_ROLES:
                self._report(BadValueError("only counts have one"), *where, "modulus")
            elif not whole:
                bad = BadValueError("not a modulus", show(modulus), f"a whole number, 2 to {MAX_MODULUS}")
                self._report(bad, *where, "modulus")
        invalid = entry.get("invalid", [])
        if not isinstance(invalid, list):
            self._report(
                BadValueError("not a list", show(invalid), "numbers such as [-999]"), *where, "invalid"
            )
            invalid = []
        bits = tuple(self._checked_number(one, *where, "invalid") for one in invalid)
        time = self._checked_text(entry.get("time"), *where, "time")
        time_unit = self._checked_time_unit(entry.get("time_unit", "s"), *where, "time_unit")
        if len(self._problems) > before or column is None:
            return None
        line = self._document.line(*where)
        return ColumnMap(
            column, unit, numbers["scale"], numbers["offset"], modulus, bits, time, time_unit, line
        )

    def _checked_table(
        self, given: object, name: str, keys: tuple[str, ...], where: tuple[str, ...] | None = None
    ) -> dict[str, Any]:
        """Return a table of the map, its unknown keys reported; empty where it is no table."""
        location = where or (name,)
        if not isinstance(given, dict):
            self._report(BadValueError("must be a table", show(given)), *location)
            return {}
        for key in given:
            if keys and key not in keys:
                near = nearest(key, keys)
                self._report(
                    BadValueError("unknown key", allowed=" ".join(keys), suggestion=near), *location, key
                )
        return given

    def _checked_text(self, value: object, *where: str) -> str | None:
        if value is None or (isinstance(value, str) and value.strip()):
            return value
        self._report(BadValueError("not a text", show(value), "a text in quotes"), *where)
        return None

    def _checked_number(self, value: object, *where: str) -> float:
        if isinstance(value, int | float) and not isinstance(value, bool):
            return float(value)
        self._report(BadValueError("not a number", show(value)), *where)
        return 1.0

    def _checked_time_unit(self, value: object, *where: str) -> str:
        if isinstance(value, str) and value in TIME_UNITS:
            return value
        self._report(BadValueError("no unit of time", show(value), " ".join(TIME_UNITS)), *where)
        return "s"

    def _report(self, bad: BadValueError, *where: str) -> None:
        key = f"[{where[0]}] {'.'.join(where[1:])}" if len(where) > 1 else f"[{where[0]}]"
        self._problems.append(bad.at(self._document.file, self._document.line(*where), key))
