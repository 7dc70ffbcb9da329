"""`tpmsd init --car NAME`: a configuration to start from, by the car library.

In: a platform's name. Out: vehicle.toml on standard output, or in a file with its DBC beside it.
"""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from tpmsd.foundation.errors import ConfigError
from tpmsd.interfaces.cli.output import Subparsers

_EPILOG = """\
examples:
  tpmsd init                                 the cars that are known
  tpmsd init --car vw_mqb --write vehicle.toml

exit codes: 0 done, 2 wrong usage
"""


def add_parser(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "init",
        help="write a configuration to start from for a known car",
        description="Writes what is known of a car platform's wheel signals as vehicle.toml and DBC.\n"
        "Measures are usual ones; 'tpmsd discover' on a drive finds those of your car.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--car", metavar="NAME", help="a platform; without it the known ones are listed")
    parser.add_argument("--write", metavar="FILE", type=Path, help="write FILE, and its DBC beside it")
    parser.add_argument("--force", action="store_true", help="let --write replace files that are there")


def run(args: argparse.Namespace) -> int:
    """List the known cars, or print or write the configuration of one; return the exit code."""
    from tpmsd.car.config.suggest import nearest
    from tpmsd.interfaces.api.car_library import load_cars
    from tpmsd.interfaces.cli.discover import check_writable, write_files
    from tpmsd.offline.discovery.car_start import discovery_of_car
    from tpmsd.offline.discovery.result_files import vehicle_text

    cars = {car.name: car for car in load_cars()}
    if args.car is None and args.write is not None:
        raise ConfigError("--write takes --car NAME: of which car? 'tpmsd init' lists those that are known")
    if args.car is None:
        width = max(map(len, cars))
        print("\n".join(f"{name:{width}}  {car.title}" for name, car in cars.items()))
        return 0
    if args.car not in cars:
        near = nearest(args.car, cars)
        hint = f"did you mean {near}?" if near else "'tpmsd init' lists those that are"
        raise ConfigError(f"--car {args.car}: not in the car library; {hint}")
    found = discovery_of_car(cars[args.car])
    if args.write is None:
        print(vehicle_text(found, f"{args.car}.dbc"), end="")
        return 0
    check_writable(args.write, args.force)
    check_writable(args.write.with_suffix(".dbc"), args.force)
    written = write_files(found, None, args.write)
    print(f"Wrote {' and '.join(map(str, written))}.")
    print(f"Next: {shlex.join(['tpmsd', 'check', str(args.write)])}")
    return 0
