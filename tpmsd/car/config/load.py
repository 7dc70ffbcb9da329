"""Loading of a TOML file: the result is a `Config`, or every problem of the file at once.

In: the path of a file or of a drive folder. Out: `Config`, or `ConfigProblems` (exit code 2), a line each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tpmsd.car.config import agree
from tpmsd.car.config.can_output import MAX_OUTPUTS, read_output
from tpmsd.car.config.document import Document, read_document
from tpmsd.car.config.dynamics_record import DynamicsConfig
from tpmsd.car.config.model import (
    AlarmsConfig,
    BusConfig,
    CalibrationConfig,
    CanConfig,
    Config,
    FilterConfig,
    GnssConfig,
    MonitorConfig,
    NotifyConfig,
    ObdConfig,
    OutputConfig,
    PhysicsConfig,
    SignalOptions,
    StateConfig,
    StatusConfig,
    TyreConfig,
    VehicleStateConfig,
)
from tpmsd.car.config.problems import BadValueError, ConfigProblems, Problem, show, show_key
from tpmsd.car.config.rules import Rule
from tpmsd.car.config.schema import tables
from tpmsd.car.config.signal_table import buses_of
from tpmsd.car.config.suggest import nearest
from tpmsd.foundation.wheels import WHEELS

DBC_FILE = "bus.dbc"

__all__ = ["ConfigProblems", "Parsed", "Problem", "load_config", "parse"]


@dataclass(frozen=True, slots=True)
class Parsed:
    """Parts of a configuration that could be read, so that the signals can be checked even where the rest has
    problems."""

    document: Document
    config: Config | None
    """None if there are problems."""
    problems: tuple[Problem, ...]
    signals: dict[str, str]
    dbc: Path | None
    alarms: AlarmsConfig | None
    channel: str | None
    options: dict[str, SignalOptions]
    buses: dict[str, BusConfig]


def load_config(path: Path, dbc: Path | None = None) -> Config:
    """Return the configuration in the file `path`, or in the `vehicle.toml` of the drive folder `path`.

    `dbc` takes the place of the file's own `can.dbc`. Raises `ConfigProblems` with all that is wrong.
    """
    parsed = parse(read_document(path), dbc)
    if parsed.config is None:
        raise ConfigProblems(parsed.problems)
    return parsed.config


def parse(document: Document, dbc: Path | None = None, *, dbc_elsewhere: bool = False) -> Parsed:
    """Return the records and problems of `document`; `dbc_elsewhere`: the DBC is no file."""
    return _ConfigParser(document, dbc_elsewhere).parse(dbc)


_READ_APART = {("can", "buses"), ("can", "output")}


def _missing_file_error(path: Path) -> BadValueError:
    """Return the error for a DBC's path that is not a file; raises OSError where it cannot be read."""
    if path.exists() or path.is_symlink():
        return BadValueError("not a file", show(str(path)))
    found = [p.name for p in path.parent.glob("*.dbc")] if path.parent.is_dir() else []
    return BadValueError("no such file", show(str(path)), suggestion=nearest(path.name, found))


class _ConfigParser:
    def __init__(self, document: Document, dbc_elsewhere: bool = False) -> None:
        self._document = document
        self._dbc_elsewhere = dbc_elsewhere
        self._tables = tables(document.file.parent)
        self._problems: list[Problem] = []
        self._given: dict[str, set[str]] = {table: set() for table in self._tables}

    def parse(self, dbc: Path | None) -> Parsed:
        """Return the records and problems of the document; `dbc` takes the place of the file's own."""
        self._report_unknown_tables()
        given = self._given
        good = {table: self._read_table(table, rules) for table, rules in self._tables.items()}
        entries = good["can.signals"]
        signals = {role: entry[0] for role, entry in entries.items()}
        options = {role: entry[1] for role, entry in entries.items() if entry[1] != SignalOptions()}
        wheels = agree.monitored_wheels(given["can.signals"], self._report)
        steered = "steering_wheel_angle" in given["can.signals"]
        raw_vehicle = self._raw_table("vehicle")
        self._spread_teeth(good["vehicle"], wheels)
        vehicle = agree.make_vehicle(
            raw_vehicle, good["vehicle"], given["vehicle"], wheels, steered, self._report
        )
        monitor = MonitorConfig(**good["monitor"])
        agree.check_monitor(monitor, given["monitor"], self._report)
        tyre = TyreConfig(**good["tyre"])
        agree.check_tyre(tyre, given["tyre"], self._report)
        alarms = AlarmsConfig(**good["alarms"])
        agree.check_alarms(alarms, given["alarms"], self._report)
        gnss = agree.with_fixes_on_can(GnssConfig(**good["gnss"]), given["can.signals"])
        agree.check_gnss(gnss, given["can.signals"], self._report)
        obd = ObdConfig(**good["obd"])
        dbc = self._dbc(dbc, good["can"])
        channel = good["can"].get("channel")
        buses = self._read_buses(good["can"], dbc, options)
        state = VehicleStateConfig(**good["vehicle_state"])
        agree.check_vehicle_state_settings(state, given, self._report)
        agree.check_obd(obd, good["can"].get("output_ids", ()), buses, self._report)
        self._check_distinct(signals, options)
        outputs = self._read_outputs()
        config = None
        if not self._problems and vehicle is not None and dbc is not None:
            config = Config(
                vehicle=vehicle,
                can=CanConfig(
                    **{**good["can"], "signals": signals, "dbc": dbc},
                    options=options,
                    buses=buses,
                    output=outputs,
                ),
                gnss=gnss,
                obd=obd,
                filter=FilterConfig(**good["filter"]),
                monitor=monitor,
                tyre=tyre,
                alarms=alarms,
                status=StatusConfig(**good["status"]),
                state=StateConfig(**good["state"]),
                notify=NotifyConfig(**good["notify"]),
                calibration=CalibrationConfig(**good["calibration"]),
                physics=PhysicsConfig(**good["physics"]),
                dynamics=DynamicsConfig(**good["dynamics"]),
                vehicle_state=state,
                file=self._document.file,
            )
        problems = tuple(sorted(self._problems, key=lambda problem: problem.line or 0))
        return Parsed(self._document, config, problems, signals, dbc, alarms, channel, options, buses)

    def _raw_table(self, table: str) -> Mapping[str, Any]:
        """Return the table as it stands in the file; empty if it is missing or no table."""
        value: Any = self._document.data
        for name in table.split("."):
            value = value.get(name) if isinstance(value, dict) else None
        return value if isinstance(value, dict) else {}

    def _report(self, bad: BadValueError, table: str, key: str = "", *inside: str) -> None:
        """Add a problem of a key, or of the place `inside` its value, with its line."""
        path = (*table.split("."), *([key] if key else []), *inside)
        name = f"[{table}] {'.'.join(show_key(step) for step in (key, *inside))}" if key else f"[{table}]"
        self._problems.append(bad.at(self._document.file, self._document.line(*path), name))

    def _report_unknown_tables(self) -> None:
        tops = [table for table in self._tables if "." not in table]
        for name, value in self._document.data.items():
            bad = None
            if name in tops:
                if not isinstance(value, dict):
                    bad = BadValueError("must be a table", show(value), f"[{name}] on a line of its own")
            elif isinstance(value, dict):
                near = "can.signals" if name == "signals" else nearest(name, self._tables)
                known = None if near else " ".join(f"[{top}]" for top in tops)
                bad = BadValueError("unknown table", allowed=known, suggestion=f"[{near}]" if near else None)
            elif home := self._table_of_key(name):
                bad = BadValueError("stands before any table", suggestion=home)
            else:
                bad = BadValueError("unknown key", allowed="keys stand in tables such as [vehicle]")
            if bad is not None:
                label = f"[{show_key(name)}]" if isinstance(value, dict) else show_key(name)
                self._problems.append(bad.at(self._document.file, self._document.line(name), label))
        signals = self._raw_table("can").get("signals", {})
        if not isinstance(signals, dict):
            self._report(
                BadValueError("must be a table", show(signals), "role = 'Message.Signal'"), "can", "signals"
            )

    def _read_table(self, table: str, rules: Mapping[str, Rule]) -> dict[str, Any]:
        good: dict[str, Any] = {}
        for key, value in self._raw_table(table).items():
            if f"{table}.{key}" in self._tables or (table, key) in _READ_APART:
                continue
            if key not in rules:
                self._report(self._unknown_key_error(table, key, rules), table, key)
                continue
            self._given[table].add(key)
            if (table, key) == ("vehicle", "wheel_radius_m"):
                continue  # a number or a table by wheels: `agree` reads it when it knows the wheels
            try:
                good[key] = rules[key].read(value)
            except BadValueError as bad:
                self._report(bad, table, key)
        return good

    def _unknown_key_error(self, table: str, key: str, rules: Mapping[str, Rule]) -> BadValueError:
        what = "unknown role" if table == "can.signals" else "unknown key"
        if (home := self._table_of_key(key)) is not None:
            return BadValueError(what, suggestion=home)
        if (near := nearest(key, rules)) is not None:
            if near not in self._raw_table(table):
                self._given[table].add(near)  # misspelt is not missing: one mistake, one line
            return BadValueError(what, suggestion=near)
        return BadValueError(what, allowed=" ".join(rules))

    def _table_of_key(self, key: str) -> str | None:
        """Return `[table] key` for a key that belongs into another table; None if it belongs into none."""
        for table, rules in self._tables.items():
            if key in rules:
                self._given[table].add(key)  # misplaced is not missing: one mistake, one line
                return f"[{table}] {key}"
        return None

    def _check_distinct(self, signals: Mapping[str, str], options: Mapping[str, SignalOptions]) -> None:
        """Report a signal that is given to two roles."""
        roles: dict[tuple[str, str | None], str] = {}
        for role, name in signals.items():
            bus = options[role].bus if role in options else None
            if (first := roles.setdefault((name, bus), role)) != role:
                self._report(
                    BadValueError(f"is the signal of {first} already", show(name)), "can.signals", role
                )

    def _read_buses(
        self, can: Mapping[str, Any], dbc: Path | None, options: Mapping[str, SignalOptions]
    ) -> dict[str, BusConfig]:
        """Return the buses of [can.buses]; report a signal on a bus that has no entry."""
        raw = self._raw_table("can").get("buses", {})
        buses, bad = buses_of(raw, self._document.file.parent, can, dbc)
        for name, error in bad.items():
            self._report(error, "can.buses", name)
        for role, option in options.items():
            if option.bus is not None and option.bus not in buses and option.bus not in bad:
                known = " ".join(buses) or "an entry of [can.buses]"
                unknown = BadValueError("bus: no such bus", show(option.bus), known)
                self._report(unknown, "can.signals", role)
        return buses

    def _read_outputs(self) -> tuple[OutputConfig, ...]:
        """Return the valid entries of [[can.output]]; report the others."""
        raw = self._raw_table("can").get("output", [])
        good: list[OutputConfig] = []
        if not isinstance(raw, list) or len(raw) > MAX_OUTPUTS:
            bad = BadValueError("must be a list of tables", show(raw), "[[can.output]] on a line of its own")
            self._report(bad, "can", "output")
            return ()
        for number, entry in enumerate(raw):
            try:
                good.append(read_output(entry, self._document.file.parent))
            except BadValueError as error:
                line = self._document.line("can", "output", number)
                self._problems.append(error.at(self._document.file, line, f"[[can.output]] {number + 1}"))
        return tuple(good)

    def _spread_teeth(self, vehicle: dict[str, Any], wheels: tuple[str, ...]) -> None:
        """Replace a table of teeth by one number, and by the numbers of all wheels where they differ."""
        teeth = vehicle.get("teeth_per_rev")
        if not isinstance(teeth, dict):
            return
        if missing := [wheel for wheel in wheels if wheel not in teeth]:
            self._report(BadValueError(f"no number of {' '.join(missing)}"), "vehicle", "teeth_per_rev")
        # A wheel without a signal gets the number of another one: it never matters.
        first = next(iter(teeth.values()))
        vehicle["teeth_per_rev"] = first
        if set(teeth.values()) != {first}:
            vehicle["teeth_by_wheel"] = tuple(teeth.get(wheel, first) for wheel in WHEELS)

    def _dbc(self, override: Path | None, can: Mapping[str, Any]) -> Path | None:
        """Return the DBC's path: the override, the file's own, or `bus.dbc` beside it."""
        if self._dbc_elsewhere:
            return Path(DBC_FILE)
        if override is not None:
            if override.is_file():
                return override
            self._problems.append(Problem(str(override), None, "", "no such DBC file"))
            return None
        next_to_it = self._document.file.parent / DBC_FILE
        if "dbc" not in self._given["can"]:
            if next_to_it.is_file():
                return next_to_it
            hint = f"the path of a DBC file (or {DBC_FILE} next to this file)"
            self._report(BadValueError("missing", allowed=hint), "can", "dbc")
            return None
        path: Path | None = can.get("dbc")
        if path is None:
            return None
        try:
            wrong = None if path.is_file() else _missing_file_error(path)
        except OSError as error:  # a name too long for the file system, a folder that may not be read
            wrong = BadValueError(f"cannot be read ({error.strerror})", show(str(path)))
        if wrong is not None:
            self._report(wrong, "can", "dbc")
            return None
        return path
