"""`tpmsd check CONFIG`: all that is wrong with a configuration at once, or what it would monitor.

In: a TOML file or drive folder. Out: a summary on standard output (exit 0), or one line per problem on
standard error (exit 2), as compilers write them: file, line, key, what was found, what is allowed.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tpmsd.car.config.gnss_source import source_of
from tpmsd.foundation.english import counted
from tpmsd.foundation.errors import ConfigError
from tpmsd.interfaces.cli.output import Subparsers, add_json_option, json_text
from tpmsd.interfaces.cli.output_files import Outputs
from tpmsd.interfaces.cli.status import colour_wanted
from tpmsd.interfaces.cli.terminal_lines import fitted_to

if TYPE_CHECKING:
    from tpmsd.car.config.check import CheckResult
    from tpmsd.car.config.model import GnssConfig
    from tpmsd.car.config.plan import ConfigurationPlan, SignalPosition, WheelPlan

SCHEMA = "tpmsd.check/2"
_EPILOG = """\
examples:
  tpmsd check vehicle.toml
  tpmsd check drives/monday --dbc new/bus.dbc --json -
  tpmsd check vehicle.toml --drive drives/monday     is the file that of this car?
  tpmsd check vehicle.toml --drive drives/monday --strict && echo fits
  tpmsd check --schema > vehicle.schema.json         for an editor with TOML support

exit codes: 0 nothing wrong was found (warnings and suspicions apart), 2 something is wrong, with --strict
also where there is a warning or a suspicion, 3 the drive cannot be used
"""
_LABEL_WIDTH = 24
_GOOD, _BAD = "32", "31;1"
"""Colours of the verdict, as those of `tpmsd status`."""


def add_parser(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "check",
        help="check a configuration and say what would be monitored with what",
        description="Say everything that is wrong with a configuration and its DBC at once; or, where\n"
        "nothing is, what would be monitored with what. Without --drive no recording is looked at.",
        epilog=_EPILOG,
    )
    parser.add_argument(
        "config",
        metavar="CONFIG",
        type=Path,
        nargs="?",
        help="a TOML file, or a drive folder (default: DRIVE)",
    )
    parser.add_argument(
        "--drive", metavar="DRIVE", type=Path, help="hold the configuration against a recorded drive, too"
    )
    parser.add_argument(
        "--dbc", metavar="FILE", type=Path, help="take this DBC and not the configuration's own"
    )
    parser.add_argument(
        "--schema", action="store_true", help="print the JSON Schema of vehicle.toml, for editors, and end"
    )
    parser.add_argument(
        "--strict", action="store_true", help="for scripts: exit 2 on warnings and suspicions, too"
    )
    add_json_option(parser)


def run(args: argparse.Namespace) -> int:
    """Run `tpmsd check`; return the exit code."""
    if args.schema:
        from tpmsd.car.config.json_schema import vehicle_schema

        print(json_text(vehicle_schema()), end="")
        return 0
    # Here, since cantools takes its time and --help does not need it.
    from tpmsd.car.config.check import check
    from tpmsd.car.config.problems import shown_lines

    outputs = Outputs(("--json", args.json))
    if args.config is None and args.drive is None:
        raise ConfigError("give a configuration, or a drive with --drive (usage: tpmsd check --help)")
    result = check(args.drive if args.config is None else args.config, args.dbc)
    for warning in result.warnings:
        print(fitted_to(sys.stderr, f"warning: {warning.text}"), file=sys.stderr)
    for line in shown_lines(result.problems):
        print(line, file=sys.stderr)
    suspected = None
    if args.drive is not None and result.plan is not None:
        suspected = _suspicions_by_line(result.plan, args.drive)
    outputs.write({"--json": lambda: json_text(_check_document(result, args.drive, suspected))})
    if result.plan is None:
        count = len(result.problems)
        print(f"{result.file}: {counted(count, 'problem')}", file=sys.stderr)
        return 2
    _check_outputs(result.plan)
    if args.json != "-":
        colour = colour_wanted(sys.stdout)
        lines = [*verdict(result.plan, args.drive, suspected, colour), "", *summary(result.plan)]
        print(fitted_to(sys.stdout, "\n".join(lines)))
    return 2 if args.strict and (result.warnings or suspected) else 0


def _check_outputs(plan: ConfigurationPlan) -> None:
    """Raise ConfigError where a frame of `[[can.output]]` cannot be made."""
    if not plan.config.can.output:
        return
    from tpmsd.onboard.sinks.can_output import CanOutputs
    from tpmsd.onboard.sources.can.databases import load_databases

    try:
        CanOutputs(plan.config, load_databases(plan.config))
    except ConfigError as error:
        raise ConfigError(f"{plan.file}: {error}") from None


def _suspicions_by_line(plan: ConfigurationPlan, drive: Path) -> list[dict[str, object]]:
    """Return each contradiction between drive and configuration, with the line of its key."""
    from tpmsd.car.config.document import read_document
    from tpmsd.interfaces.cli.drive_reading import say
    from tpmsd.offline.drive_checks.check_drive import suspicions
    from tpmsd.offline.drives.bus_fixes import BusFixes, is_on_bus
    from tpmsd.offline.drives.raw_drive import read_drive
    from tpmsd.onboard.sources.can.databases import load_databases

    database = load_databases(plan.config)
    raw = read_drive([drive], say, BusFixes(plan.config, database) if is_on_bus(plan.config) else None)
    document = read_document(plan.file)
    return [
        {
            "key": one.key,
            "line": document.line(*one.key.split(".")),
            "suspicion": one.suspicion,
            "probability": one.probability,
            "suggest": one.suggest,
        }
        for one in suspicions(plan.config, database, raw.log, raw.fixes)
    ]


def verdict(
    plan: ConfigurationPlan,
    drive: Path | None,
    suspected: list[dict[str, object]] | None,
    colour: bool = False,
) -> list[str]:
    """Return the answer in its first line; below it the suspicions, or what was not checked."""

    def painted(style: str, text: str) -> str:
        return f"\x1b[{style}m{text}\x1b[0m" if colour else text

    if suspected:
        keys = counted(len(suspected), "key")
        head = f"{plan.file}: the drive {drive} contradicts {keys}"
        return [painted(_BAD, head)] + [
            f"  {plan.file}:{one['line']}: {one['key']}: {one['suspicion']} ({one['probability']:.2f}): "
            f"{one['suggest']}"
            for one in suspected
        ]
    head = painted(_GOOD, f"{plan.file}: nothing wrong in the file itself and {plan.dbc}")
    if drive is not None:
        return [head, f"Nothing in the drive {drive} contradicts it."]
    return [
        head,
        "No drive was read: whether these signals are those of this car's wheels, and whether bus and "
        "receiver are there, was not looked at (--drive DRIVE holds it against a recording).",
    ]


def summary(plan: ConfigurationPlan) -> list[str]:
    """Return the plan in lines for people."""
    config = plan.config
    lines = ["It would monitor:", ""]
    wheels = " ".join(wheel.wheel for wheel in plan.wheels)
    lines += _labelled_line("wheels", f"{wheels}, nominal radius {_radii_text(plan)}")
    for wheel in plan.wheels:
        lines += _labelled_line(wheel.wheel, f"{_signal_text(wheel.source)}, {_wheel_text(wheel)}")
    lines += _labelled_line(
        "bus", f"{plan.interface} {plan.channel}, decoded by {plan.dbc}{_missing_periods_note(plan)}"
    )
    for signal in plan.optional:
        lines += _labelled_line(signal.role, f"{_signal_text(signal)} in {signal.unit}")
    lines += _labelled_line("receiver", _receiver_text(plan))
    settings = config.filter
    particles = "usual number of" if settings.particles is None else settings.particles
    lines += _labelled_line(
        "filter",
        f"{settings.method}, {particles} particles, {settings.rate_hz:g} Hz, "
        f"memory {settings.window_s:g} s, learns above {settings.min_speed_mps:g} m/s",
    )
    monitor = config.monitor
    lines += _labelled_line(
        "monitor",
        f"deflation from -{monitor.deflation_percent:g} % of radius, radius_deviation from "
        f"+-{monitor.deviation_percent:g} %, at a probability of {monitor.raise_probability:g}",
    )
    lines += _labelled_line("alarms", _alarm_outputs_line(plan))
    for output in config.can.output:
        what = output.message or f"j1939 {output.j1939}"
        period = "" if output.when == "change" else f" every {output.period_s:g} s"
        lines += _labelled_line("output", f"{what} on {output.bus or plan.channel}, {output.when}{period}")
    if config.notify.command:
        lines += _labelled_line("notify", f"runs {config.notify.command[0]}")
    lines += _labelled_line("status", f"{config.status.socket} (mode {config.status.mode:04o})")
    state = f"{config.state.file}, every {config.state.interval_s:g} s" if config.state.file else "not kept"
    lines += _labelled_line("state", state)
    if plan.losses:
        lines += ["", "What is missing, and what that costs:"]
        width = max(len(name) for name in plan.losses)
        lines += [f"  {name:{width}}  {cost}" for name, cost in plan.losses.items()]
    return lines


def _receiver_text(plan: ConfigurationPlan) -> str:
    gnss = plan.config.gnss
    source = source_of(gnss)
    baud = f" at {gnss.baud} baud" if source is not None and source.kind == "serial" else ""
    label = "none" if source is None else source.label
    return f"{label}{baud}, antenna {_antenna_text(gnss)}"


def _labelled_line(label: str, text: str) -> list[str]:
    return [f"  {label:{_LABEL_WIDTH - 2}}{text}"]


def _radii_text(plan: ConfigurationPlan) -> str:
    radii = [wheel.radius_m for wheel in plan.wheels]
    values = radii[:1] if len(set(radii)) == 1 else radii
    return " ".join(f"{1000 * radius:.1f}" for radius in values) + " mm"


def _signal_text(signal: SignalPosition) -> str:
    identifier = f"0x{signal.frame_id:0{8 if signal.extended else 3}X}"
    period = "" if signal.period_s is None else f", every {1000 * signal.period_s:g} ms"
    return f"{signal.signal} (id {identifier}{period}{', multiplexed' if signal.multiplexed else ''})"


def _missing_periods_note(plan: ConfigurationPlan) -> str:
    signals = [*(wheel.source for wheel in plan.wheels), *plan.optional]
    return "" if all(signal.period_s for signal in signals) else ", which gives no period for some messages"


def _wheel_text(wheel: WheelPlan) -> str:
    if wheel.resolution_mm is None or wheel.rollover_m is None or wheel.unambiguous_s is None:
        step = f"{wheel.speed_step_mps:.2g} m/s" if wheel.speed_step_mps is not None else "?"
        return f"{wheel.bits}-bit speed in {wheel.source.unit}, steps of {step}"
    return (
        f"{wheel.bits}-bit counter, {wheel.resolution_mm:.3g} mm of road per step, "
        f"rolls over every {_road_length_text(wheel.rollover_m)}"
    )


def _antenna_text(gnss: GnssConfig) -> str:
    along = f"{abs(gnss.antenna_forward_m):g} m {'behind' if gnss.antenna_forward_m < 0 else 'ahead'}"
    across = f"{abs(gnss.antenna_left_m):g} m {'right' if gnss.antenna_left_m < 0 else 'left'}"
    return f"{along} and {across} of the middle of the rear axle"


def _road_length_text(metres: float) -> str:
    return f"{metres:.3g} m" if metres < 1000 else f"{metres / 1000:.4g} km"


def _alarm_outputs_line(plan: ConfigurationPlan) -> str:
    alarms = plan.config.alarms
    if not alarms.can:
        return "not put on the bus"
    width = 8 if alarms.extended_ids else 3
    return (
        f"on {alarms.channel or plan.channel}: status frame 0x{alarms.status_id:0{width}X} every "
        f"{alarms.status_period_s:g} s, alarm frame 0x{alarms.alarm_id:0{width}X} every "
        f"{alarms.alarm_period_s:g} s while one lasts"
    )


def _check_document(
    result: CheckResult, drive: Path | None, suspected: list[dict[str, object]] | None
) -> dict[str, object]:
    from tpmsd.foundation.provenance import provenance

    return {
        **provenance(SCHEMA, () if drive is None else (drive,), result.file),
        "looked_at": {"configuration": result.file, "dbc": result.plan and result.plan.dbc, "drive": drive},
        "file": result.file,
        "ok": result.plan is not None,
        "problems": result.problems,
        "warnings": result.warnings,
        "plan": result.plan,
        **({} if suspected is None else {"suspicions": suspected}),
    }
