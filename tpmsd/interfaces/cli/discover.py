"""`tpmsd discover DRIVE`: which signals of an unknown car are its wheels, and what else the drive shows.

In: a drive, a DBC where there is one. Out: a summary or JSON, and, on request, a vehicle.toml (and a DBC).
Exit code 4 where a wheel is undecided.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path
from typing import IO, TYPE_CHECKING

from tpmsd.foundation.errors import ConfigError
from tpmsd.interfaces.cli.output import Subparsers, add_json_option, json_text
from tpmsd.interfaces.cli.output_files import Outputs
from tpmsd.interfaces.cli.terminal_lines import fitted_to

if TYPE_CHECKING:
    from tpmsd.offline.discovery.result import BusDiscovery, FoundRole

SCHEMA = "tpmsd.discovery/2"
EXIT_UNDECIDED = 4
_EPILOG = """\
examples:
  tpmsd discover drive/ --write vehicle.toml
  tpmsd discover drive/ --dbc car.dbc --tyre 205/55R16 --json -
  tpmsd discover can.log gnss.nmea

exit codes: 0 all wheels found, 2 wrong usage, 3 unusable input, 4 a wheel is undecided
"""


def add_parser(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "discover",
        help="find the wheels of an unknown car from a drive, and write its configuration",
        description="Finds which signals of a drive are the four wheels, by what they do against the\n"
        "receiver's speed and course, with a DBC or without; then the car's measures.\n"
        "A vehicle.toml in DRIVE is not read.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "drive", metavar="DRIVE", type=Path, nargs="+", help="a folder, or a CAN log and an NMEA log"
    )
    parser.add_argument("--dbc", metavar="FILE", type=Path, help="the bus's DBC (default: bus.dbc in DRIVE)")
    parser.add_argument("--no-dbc", action="store_true", help="use no DBC, also where DRIVE has one")
    parser.add_argument("--tyre", metavar="SIZE", help="size of the tyres, such as 205/55R16")
    parser.add_argument("--write", metavar="FILE", type=Path, help="write the configuration to FILE")
    parser.add_argument("--force", action="store_true", help="let --write replace files that are there")
    add_json_option(parser)


def run(args: argparse.Namespace) -> int:
    """Run `tpmsd discover`; return the exit code."""
    from tpmsd.foundation.provenance import provenance
    from tpmsd.interfaces.api.car_library import load_cars
    from tpmsd.interfaces.cli.drive_reading import say
    from tpmsd.offline.discovery.discover import discover
    from tpmsd.offline.drives.raw_drive import read_drive
    from tpmsd.offline.rings.tooth_count import tyre_radius_m
    from tpmsd.onboard.sources.can.databases import load_database

    if args.tyre is not None and tyre_radius_m(args.tyre) is None:
        raise ConfigError(f"--tyre {args.tyre}: not a tyre's size, such as 205/55R16")
    if args.no_dbc and args.dbc is not None:
        raise ConfigError("--dbc and --no-dbc contradict each other")
    dbc = None if args.no_dbc else args.dbc or _dbc_of_drive(args.drive)
    if args.write is not None:
        check_writable(args.write, args.force)
        if dbc is None or _is_copied(dbc, args.write):
            check_writable(args.write.with_suffix(".dbc"), args.force)
    outputs = Outputs(("--json", args.json))
    database = None if dbc is None else load_database(dbc)
    drive = read_drive(args.drive, say)
    found = discover(drive.log, drive.fixes, database, args.tyre, load_cars())
    if args.json != "-":
        print(fitted_to(sys.stdout, "\n".join(summary(found))))
    if args.write is not None:
        written = [] if found.kind is None else write_files(found, dbc, args.write)
        print_written(
            written, args.drive, found.wheels_decided, sys.stderr if args.json == "-" else sys.stdout
        )
    head = provenance(SCHEMA, [drive.can_log, drive.nmea_log], dbc)
    outputs.write({"--json": lambda: json_text({**head, **found.document()})})
    return 0 if found.wheels_decided else EXIT_UNDECIDED


def _dbc_of_drive(paths: list[Path]) -> Path | None:
    folder = paths[0] if paths[0].is_dir() else paths[0].parent
    dbc = folder / "bus.dbc"
    return dbc if dbc.is_file() else None


def check_writable(path: Path, force: bool) -> None:
    """Raise ConfigError if the file exists (without `force`), is a folder, or its folder is missing."""
    if path.is_dir():
        raise ConfigError(f"{path}: a folder; the name of a file is wanted")
    if path.exists() and not force:
        raise ConfigError(f"{path}: is there already; --force replaces it")
    if not path.absolute().parent.is_dir():
        raise ConfigError(f"{path}: there is no folder {path.parent}")


def write_files(found: BusDiscovery, dbc: Path | None, target: Path) -> list[Path]:
    """Write the configuration and its DBC, which is made where the fields were found in raw frames.

    A DBC of another folder is copied beside the configuration, so that the two can be moved together.

    Returns:
        The files that were written, the configuration first.
    """
    from tpmsd.offline.discovery.result_files import dbc_name_of_bus, dbc_text, further_buses, vehicle_text

    written = [target]
    own_dbc = target.with_suffix(".dbc")
    if dbc is None:
        replace_file(own_dbc, dbc_text(found))
        written.append(own_dbc)
        for bus in further_buses(found):
            of_bus = own_dbc.with_name(dbc_name_of_bus(own_dbc.name, found.channel(bus)))
            replace_file(of_bus, dbc_text(found, bus))
            written.append(of_bus)
    elif _lies_elsewhere(dbc, target):
        if _is_copied(dbc, target):
            replace_file(own_dbc, dbc.read_bytes())
            written.append(own_dbc)
    else:
        own_dbc = dbc
    replace_file(target, vehicle_text(found, own_dbc.name))
    return written


def _lies_elsewhere(dbc: Path, target: Path) -> bool:
    """Return whether the DBC lies in another folder than the configuration."""
    return dbc.resolve().parent != target.absolute().parent.resolve()


def _is_copied(dbc: Path, target: Path) -> bool:
    """Return whether a copy of the DBC has to be written: not if the file next to the configuration is that
    copy."""
    own_dbc = target.with_suffix(".dbc")
    is_there = own_dbc.is_file() and dbc.is_file() and own_dbc.read_bytes() == dbc.read_bytes()
    return _lies_elsewhere(dbc, target) and not is_there


def print_written(written: list[Path], drive: list[Path], decided: bool, out: IO[str]) -> None:
    """Print which files were written and the command that comes next, or that nothing was written."""
    if not written:
        print("\nNothing was written: no wheels were found.", file=out)
        return
    print(f"\nWrote {' and '.join(map(str, written))}.", file=out)
    if not decided:
        print(f"Look over what {written[0]} marks as undecided.", file=out)
    if len(drive) == 1:
        command = shlex.join(["tpmsd", "check", str(written[0]), "--drive", str(drive[0])])
    else:
        command = shlex.join(["tpmsd", "check", str(written[0])])
    print(f"Next: {command}", file=out)


def replace_file(path: Path, content: str | bytes) -> None:
    """Write a temporary file next to it, then rename: a full disk leaves the old file."""
    temporary = path.with_name(f".{path.name}.new")
    try:
        temporary.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise ConfigError(f"{path}: cannot be written: {error.strerror or error}") from None


def summary(found: BusDiscovery) -> list[str]:
    """Return the discovered signals and measures in lines for people."""
    from tpmsd.offline.discovery.settings import SETTINGS

    lines = [f"{found.duration_s:.0f} s of driving with fixes, {found.frames} frames"]
    if found.car is not None:
        lines.append(f"The bus is that of {found.car} in the car library.")
    if found.kind is not None:
        lines += ["", f"wheels ({found.kind}) and other signals:"]
    width = max((len(role) for role in found.roles), default=0)
    for role, one in found.roles.items():
        lines.append(f"  {role:{width}}  {_role_text(found, one)}")
    if found.counts_per_rev is not None:
        counts = found.counts_per_rev
        probability = found.counts_probability
        by = f"{probability:.2f}" if probability > 0.0 else "by the rolling radius alone"
        lines.append(f"  counts per revolution {counts.value:g} +- {counts.std:.2g} ({by})")
    axle = found.driven_axle
    if axle is not None:
        tends = f"not identified ({axle[0]} {axle[1]:.2f})"
        lines.append(
            f"  driven axle {f'{axle[0]} ({axle[1]:.2f})' if axle[1] >= SETTINGS.decided else tends}"
        )
    for key, one_estimate in {**found.geometry, **found.gnss}.items():
        lines.append(f"  {key} {one_estimate.value:.3f} +- {one_estimate.std:.3f}")
    if found.candidates:
        lines += ["", "candidates, none of them decided:"]
        lines += [
            f"  {one.field.signal}: a wheel's {one.kind} {one.any_wheel:.2f}, on the {one.side}"
            f" {one.probability:.2f}"
            for one in found.candidates
        ]
    if found.contradictions:
        lines += ["", "contradicted:", *(f"  {said}." for said in found.contradictions)]
    if found.undecided:
        lines += ["", "undecided:"]
        lines += [f"  {one.key}: {one.why}. It takes: {one.drive}." for one in found.undecided]
    return lines


def _role_text(found: BusDiscovery, one: FoundRole) -> str:
    """Return the signal of a role with its qualities, probability and alternatives."""
    alternatives = "".join(f"; {name} {p:.2f}" for name, p in one.alternatives)
    extra = f", modulus {one.modulus}" if one.modulus else ""
    extra += f", in {one.unit}" if one.unit else ""
    extra += f", scale {one.scale:g}" if one.scale is not None else ""
    extra += ", sign turned" if one.sign < 0 else ""
    extra += f", on {found.channel(one.bus)}" if len(found.channels) > 1 else ""
    return f"{one.field.signal}{extra}  {one.probability:.3f}{alternatives}"
