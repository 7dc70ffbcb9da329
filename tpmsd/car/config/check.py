"""A configuration against the bus it speaks of: do the names exist, can the signals do their work?

In: the path of a TOML file or drive folder. Out: `CheckResult` with every problem and warning of the
file and of the DBC at once and, if there is no problem, the plan of what will be monitored. Never raises for
bad input.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can
from cantools.database.can import Database, Message, Signal

from tpmsd.car.config.coarse_speed import coarse_step_warning
from tpmsd.car.config.dbc import NotedDatabase, counter_modulus, find_signal, load_dbc
from tpmsd.car.config.document import read_document
from tpmsd.car.config.load import Parsed, parse
from tpmsd.car.config.model import GNSS_ROLES, Config, SignalOptions
from tpmsd.car.config.plan import TOP_SPEED_MPS, ConfigurationPlan, make_plan
from tpmsd.car.config.problems import BadValueError, ConfigProblems, Problem, show
from tpmsd.car.config.suggest import nearest
from tpmsd.car.config.units import assumed_unit, stated_unit, to_si
from tpmsd.foundation.errors import ConfigError

_OWN_MESSAGES = "TPMSD_"  # dbc/tpmsd.dbc: a bus description may well include our own frames
_CLASSIC_CAN_BYTES = 8
_MAX_NOTES = 8


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Problems and warnings of a configuration file, and the plan that follows from it."""

    file: Path
    problems: tuple[Problem, ...]
    warnings: tuple[Problem, ...] = ()
    plan: ConfigurationPlan | None = None
    """None if there are problems."""


def check(path: Path, dbc: Path | None = None) -> CheckResult:
    """Return problems, warnings and plan of the file or drive folder `path`; `dbc` replaces the file's
    own."""
    try:
        document = read_document(path)
    except ConfigProblems as error:
        return CheckResult(path, error.problems)
    return _Checker(parse(document, dbc)).check()


class _Checker:
    def __init__(self, parsed: Parsed) -> None:
        self._parsed = parsed
        self._problems = list(parsed.problems)
        self._warnings: list[Problem] = []

    def check(self) -> CheckResult:
        """Return the result of all checks."""
        parsed = self._parsed
        self._check_python_can_backend()
        found: dict[str, tuple[Message, Signal]] = {}
        if parsed.dbc is not None:
            databases = self._load_databases(parsed.dbc)
            database = databases.get(None)
            if database is not None:
                found = self._find_signals(databases)
                for role, (message, signal) in found.items():
                    self._check_signal(role, message, signal)
                self._check_frames(database, found)
                self._check_alarm_ids(database)
        self._check_usefulness()
        plan = None
        if parsed.config is not None and not self._problems:
            plan = make_plan(parsed.config, found)
            self._check_counters(plan)
            self._check_speeds(plan)
            self._check_obd(parsed.config)
        return CheckResult(
            parsed.document.file,
            tuple(sorted(self._problems, key=_file_and_line)),
            tuple(sorted(self._warnings, key=_file_and_line)),
            plan,
        )

    def _table(self, name: str) -> dict[str, Any]:
        table = self._parsed.document.data.get(name)
        return table if isinstance(table, dict) else {}

    def _problem_at(self, bad: BadValueError, table: str, key: str) -> Problem:
        document = self._parsed.document
        return bad.at(document.file, document.line(*table.split("."), key), f"[{table}] {key}")

    def _add_problem(self, bad: BadValueError, table: str, key: str) -> None:
        self._problems.append(self._problem_at(bad, table, key))

    def _add_warning(self, what: str, table: str, key: str) -> None:
        self._warnings.append(self._problem_at(BadValueError(what), table, key))

    def _check_python_can_backend(self) -> None:
        """Report a `[can] interface` that python-can does not know."""
        name = self._table("can").get("interface")
        if isinstance(name, str) and name.strip() and name.strip() not in can.VALID_INTERFACES:
            near = nearest(name, can.VALID_INTERFACES)
            allowed = None if near else " ".join(sorted(can.VALID_INTERFACES))
            self._add_problem(
                BadValueError("no such python-can interface", show(name), allowed, near), "can", "interface"
            )

    def _load_databases(self, dbc: Path) -> dict[str | None, Database]:
        """Return bus name -> database, None for the bus of [can]; without those that have problems."""
        paths: dict[str | None, Path] = {None: dbc}
        paths.update({name: bus.dbc for name, bus in self._parsed.buses.items()})
        read: dict[Path, Database | None] = {}
        for path in paths.values():
            if path in read:
                continue
            read[path] = None
            try:
                database = read[path] = load_dbc(path)
            except ConfigProblems as error:
                self._problems += error.problems
                continue
            if isinstance(database, NotedDatabase):
                self._warnings += _unused_statements(path, database)
        return {name: found for name, path in paths.items() if (found := read[path]) is not None}

    def _find_signals(self, databases: Mapping[str | None, Database]) -> dict[str, tuple[Message, Signal]]:
        """Return role -> message and signal in the database of its bus; report roles without one."""
        found = {}
        for role, name in self._parsed.signals.items():
            option = self._parsed.options.get(role, SignalOptions())
            database = databases.get(option.bus)
            if database is None:
                continue  # its bus was reported
            try:
                found[role] = find_signal(database, name, self._parsed.signals.values())
                for condition in (option.valid_when, option.backward_when):
                    if condition is not None:
                        find_signal(database, condition.signal)
            except BadValueError as bad:
                self._add_problem(bad, "can.signals", role)
        return found

    def _check_signal(self, role: str, message: Message, signal: Signal) -> None:
        """Report contradictions between a role and its signal; warn of a unit that the DBC does not state."""
        name = f"{message.name}.{signal.name}"
        counter = role.startswith("wheel_count_")
        option = self._parsed.options.get(role, SignalOptions())
        unit = option.unit or signal.unit
        if counter:
            self._check_modulus(role, name, signal, option)
        if counter and signal.is_float:
            bad = BadValueError("a counter must be an integer", f"{name} as IEEE 754 float")
            self._add_problem(bad, "can.signals", role)
        if signal.scale == 0:
            self._add_problem(BadValueError("constant", f"{name} with factor 0"), "can.signals", role)
        try:
            to_si(role, unit)
        except ConfigError as error:
            self._add_problem(BadValueError(f"{name}: {error}"), "can.signals", role)
            return
        if not stated_unit(unit) and assumed_unit(role) is not None:
            self._add_warning(
                f"{name} has no unit in the DBC: {assumed_unit(role)} is assumed", "can.signals", role
            )

    def _check_modulus(self, role: str, name: str, signal: Signal, option: SignalOptions) -> None:
        """Report a modulus that does not fit into the counter; warn of one that the DBC only hints at."""
        full = 1 << signal.length
        hinted = counter_modulus(signal)
        if option.modulus is not None and option.modulus > full:
            bad = BadValueError("modulus: out of range", str(option.modulus), f"2 to {full} ({name})")
            self._add_problem(bad, "can.signals", role)
        elif option.modulus is None and hinted != full:
            what = f"{name} rolls over at {hinted}, by its greatest value in the DBC"
            self._add_warning(what, "can.signals", role)

    def _check_frames(self, database: Database, found: dict[str, tuple[Message, Signal]]) -> None:
        """Warn of messages of the same name and of frames longer than the bus carries, once per message."""
        fd_said = self._table("can").get("fd", False)
        names = [message.name for message in database.messages]
        seen: set[str] = set()
        for role, (message, _) in found.items():
            if message.name in seen:
                continue
            seen.add(message.name)
            if (same_name := names.count(message.name)) > 1:
                what = f"the DBC has {same_name} messages named {message.name}: the last one is taken"
                self._add_warning(what, "can.signals", role)
            if (message.is_fd or message.length > _CLASSIC_CAN_BYTES) and fd_said is not True:
                what = f"{message.name} is a CAN FD frame: a live bus needs fd = true in [can]"
                self._add_warning(what, "can.signals", role)

    def _check_alarm_ids(self, database: Database) -> None:
        alarms = self._parsed.alarms
        if alarms is None or not alarms.can:
            return
        if alarms.channel is not None and alarms.channel != (self._parsed.channel or "can0"):
            return  # another bus
        taken = {
            (message.frame_id, message.is_extended_frame): message.name
            for message in database.messages
            if not message.name.upper().startswith(_OWN_MESSAGES)
        }
        for key, value in (("status_id", alarms.status_id), ("alarm_id", alarms.alarm_id)):
            if (name := taken.get((value, alarms.extended_ids))) is not None:
                bad = BadValueError(
                    f"the identifier is that of {name} in the DBC", f"0x{value:X}", "one that is free"
                )
                self._add_problem(bad, "alarms", key)

    def _check_usefulness(self) -> None:
        """Warn of settings that are valid but have no effect, or whose default is unlikely to be right."""
        signals = self._parsed.signals
        config = self._parsed.config
        if config is not None and config.gnss.source != "can":
            for role in signals:
                if role in GNSS_ROLES:
                    self._add_warning("of no use: [gnss] source is not 'can'", "can.signals", role)
        vehicle = self._table("vehicle")
        if not vehicle:
            return
        if "teeth_per_rev" not in vehicle and any(role.startswith("wheel_count_") for role in signals):
            self._add_warning("not given: 48 counts per revolution are assumed", "vehicle", "teeth_per_rev")
        if "steering_wheel_angle" in signals and "steering_ratio" not in vehicle:
            self._add_warning(
                "not given: the steering wheel's angle is of no use", "vehicle", "steering_ratio"
            )

    def _check_counters(self, plan: ConfigurationPlan) -> None:
        """Warn of a counter that may turn by half its range between two frames, so that its direction is
        ambiguous."""
        for wheel in plan.wheels:
            certain_s, period_s = wheel.unambiguous_s, wheel.source.period_s
            if certain_s is not None and period_s is not None and period_s > certain_s:
                what = (
                    f"{wheel.source.signal}: {wheel.bits} bits are ambiguous after {1000 * certain_s:.3g} ms "
                    f"at {TOP_SPEED_MPS:g} m/s, and the message comes every {1000 * period_s:g} ms"
                )
                self._add_warning(what, "can.signals", wheel.source.role)

    def _check_speeds(self, plan: ConfigurationPlan) -> None:
        """Warn of coarse speed steps, which bias the radii; once, for the wheel with the coarsest."""
        speeds = [wheel for wheel in plan.wheels if wheel.speed_step_mps is not None]
        coarsest = max(speeds, key=lambda wheel: wheel.speed_step_mps or 0.0, default=None)
        if coarsest is None or coarsest.speed_step_mps is None:
            return
        if (what := coarse_step_warning(coarsest.speed_step_mps, coarsest.radius_m)) is not None:
            self._add_warning(f"{coarsest.source.signal}: {what}", "can.signals", coarsest.source.role)

    def _check_obd(self, config: Config) -> None:
        """Warn of the requests that tpmsd sends on the car's bus."""
        if config.obd.speed:
            every = f"every {config.obd.period_s:g} s while the car moves"
            self._add_warning(
                f"tpmsd sends 0x{config.obd.request_id:X} on the car's bus {every}", "obd", "speed"
            )


def _unused_statements(path: Path, database: NotedDatabase) -> list[Problem]:
    """Return a warning for each statement of a DBC that could not be used, the first `_MAX_NOTES` of them."""
    shown = [Problem(str(path), note.line, "", note.what) for note in database.notes[:_MAX_NOTES]]
    if more := database.noted - len(shown):
        shown.append(Problem(str(path), None, "", f"and {more} more statements that were left out or mended"))
    return shown


def _file_and_line(problem: Problem) -> tuple[str, int]:
    """Return the key by which problems are sorted."""
    return problem.file, problem.line or 0
