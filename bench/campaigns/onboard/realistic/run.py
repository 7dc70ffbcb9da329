"""Sixteen realistic cases of soft tyres, for this program or any system on a CAN bus.

    python -m bench run realistic                                 this program's core, all cases
    python -m bench run realistic --case one-town,reset-all-soft
    python -m bench run realistic --interface socketcan --channel vcan0 --dbc other.dbc --lamp TPMS.Lamp
    python -m bench run realistic --describe FOLDER               the car's DBC and drives, for another system

A system on a bus gets the frames of the car as they came, at `--pace` times real time, and answers by its
own frame. It is restarted by hand before each case (`--case` plays one). Found: the lamp is lit within the
case's time of driving, from the drive on which the tyres are soft. `asked` is a question that this program
puts instead of an alarm.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from bench.campaigns.onboard.realistic.cases import Act, RealCase, car_of, cases_of
from bench.registry import UsageError
from bench.worlds.folder import write_folder
from bench.worlds.magic_tyre import Array
from bench.worlds.trip_cars import POOLS, Car
from bench.worlds.trips import drive_leg
from tpmsd.car.config.model import FILTER_METHODS

Row = dict[str, Any]


def play(car: Car, case: RealCase, system: Any) -> Row:
    """Play one case; a row of what came of it."""
    system.begin()
    tyre_k: Array | None = None
    driven_s, false = 0.0, []
    found_s = asked_s = math.nan
    for number, act in enumerate(case.acts):
        driven = drive_leg(car, act.leg, tyre_k)
        tyre_k = driven.temperature_k
        if act.reset:
            system.reset()
        lit = system.drive(driven)
        if number < case.first:
            false += [] if math.isnan(lit.alarm_s) else [number]
            continue
        onset_s = min(loss.onset_s for loss in act.leg.losses)
        found_s = _since(found_s, driven_s, lit.alarm_s, onset_s)
        asked_s = _since(asked_s, driven_s, lit.asked_s, onset_s)
        driven_s += act.leg.duration_s - onset_s
        if found_s <= case.limit_s:
            break
    return {
        "case": case.name,
        "found": found_s <= case.limit_s,
        "found_s": None if math.isnan(found_s) else round(found_s, 1),
        "asked": asked_s <= case.limit_s,
        "asked_s": None if math.isnan(asked_s) else round(asked_s, 1),
        "limit_s": case.limit_s,
        "false_before": false,
    }


def _since(known_s: float, before_s: float, at_s: float, onset_s: float) -> float:
    """Driving since the loss, or what is known already."""
    return known_s if not math.isnan(known_s) else before_s + at_s - onset_s


def table(rows: list[Row]) -> str:
    """As Markdown."""
    lines = ["| case | found | after s | asked after s | limit s |", "| --- | --- | --- | --- | --- |"]
    for row in rows:
        found = "yes" if row["found"] else "asked" if row["asked"] else "**no**"
        at = ["-" if row[name] is None else f"{row[name]:.0f}" for name in ("found_s", "asked_s")]
        lines.append(f"| {row['case']} | {found} | {at[0]} | {at[1]} | {row['limit_s']:.0f} |")
    hits, asked = sum(row["found"] for row in rows), sum(row["asked"] and not row["found"] for row in rows)
    return "\n".join([*lines, "", f"{hits} of {len(rows)} found, {asked} more asked."])


def describe(car: Car, cases: tuple[RealCase, ...], folder: Path) -> None:
    """Write each drive of each case as a folder: frames, DBC, receiver."""
    for case in cases:
        tyre_k: Array | None = None
        for number, act in enumerate(case.acts):
            driven = drive_leg(car, act.leg, tyre_k)
            write_folder(driven.drive, folder / case.name / _name(number, act))
            tyre_k = driven.temperature_k


def _name(number: int, act: Act) -> str:
    return f"{number}-after-reset" if act.reset else f"{number}"


def system_of(args: argparse.Namespace) -> Any:
    """What is measured, by the options; UsageError where they do not fit."""
    if args.interface is None:
        from bench.campaigns.onboard.realistic.systems import Onboard

        return Onboard(args.method)
    if args.channel is None or args.dbc is None or args.lamp is None or "." not in args.lamp:
        raise UsageError("a system on a bus needs --channel, --dbc and --lamp MESSAGE.SIGNAL")
    import can
    import cantools

    from bench.campaigns.onboard.realistic.systems import OnBus

    try:
        database = cantools.database.load_file(args.dbc)
        if not isinstance(database, cantools.database.can.Database):
            raise ValueError(f"{args.dbc} describes no CAN frames")
        message, signal = args.lamp.split(".", 1)
        if signal not in [one.name for one in database.get_message_by_name(message).signals]:
            raise KeyError(signal)
        bus = can.Bus(interface=args.interface, channel=args.channel)
    except (OSError, KeyError, ValueError, can.CanError, cantools.Error) as error:
        raise UsageError(f"no such system: {type(error).__name__}: {error}") from None
    return OnBus(bus, database, (message, signal), args.pace, reset_frame=_frame(args.reset_frame))


def _frame(text: str | None) -> Any:
    """The frame that `ID#DATA` (hexadecimal) is; None of None."""
    if text is None:
        return None
    import can

    try:
        identifier, _, data = text.partition("#")
        return can.Message(
            arbitration_id=int(identifier, 16),
            is_extended_id=len(identifier) > 3,
            data=bytes.fromhex(data),
            check=True,
        )
    except ValueError as error:
        raise UsageError(f"{text}: a frame is ID#DATA, both hexadecimal ({error})") from None


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--case", help="names of cases, with commas between (default: all)")
    parser.add_argument("--seed", type=int, default=1, help="another car, roads and noise")
    parser.add_argument("--pool", choices=POOLS, default="development", help="kinds of cars and roads")
    parser.add_argument("--method", choices=FILTER_METHODS, help="an estimator instead of the default")
    parser.add_argument("--interface", help="of python-can: measure a system on this bus instead")
    parser.add_argument("--channel", help="of that bus")
    parser.add_argument("--dbc", type=Path, help="of the system's alarm frame")
    parser.add_argument("--lamp", metavar="MESSAGE.SIGNAL", help="any value but 0 is an alarm")
    parser.add_argument("--reset-frame", metavar="ID#DATA", help="that means a reset to the system")
    parser.add_argument("--pace", type=float, default=1.0, help="times real time, with --interface")
    parser.add_argument("--describe", type=Path, metavar="FOLDER", help="write all drives and end")


def main(args: argparse.Namespace) -> list[Row] | int:
    """Play, print the table."""
    cases = cases_of(args.pool, args.seed)
    if args.case is not None:
        wanted = args.case.split(",")
        unknown = set(wanted) - {case.name for case in cases}
        if unknown:
            names = ", ".join(case.name for case in cases)
            raise UsageError(f"no such case: {', '.join(sorted(unknown))}; there are {names}")
        cases = tuple(case for case in cases if case.name in wanted)
    if not args.pace > 0.0:
        raise UsageError("--pace: more than 0")
    car = car_of(args.pool, args.seed)
    if args.describe is not None:
        describe(car, cases, args.describe)
        return 0
    system = system_of(args)
    rows = []
    for case in cases:
        rows.append(play(car, case, system))
        print(table(rows[-1:]).splitlines()[2], flush=True)
    print()
    print(table(rows))
    return rows
