"""`tpmsd calibrate DRIVE...`: radii and tracks of a car from recorded drives.

In: drive folders. Out: a summary, JSON, a picture, and a vehicle.toml with the calibrated values; progress on
standard error.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING

from tpmsd.cli.output import Subparsers, add_json_option, write_json
from tpmsd.errors import ConfigError, InputError, TpmsdError

if TYPE_CHECKING:
    from tpmsd.calibration.recording import Recording
    from tpmsd.calibration.result import Calibration
    from tpmsd.config.model import Config

_DESCRIPTION = """\
Learns each wheel's circumference and the tracks from one or several drives of a car whose tyres are as they
should be, with their standard deviations. One drive round the block will do: some minutes, with straights and
bends; the more the better.

DRIVE is a folder with vehicle.toml, bus.dbc, can.log (or .log.gz .asc .blf .trc .mf4) and gnss.nmea. The
radii there may be guessed: a data sheet's value is near enough.
"""
_EPILOG = """\
examples:
  tpmsd calibrate drives/monday
  tpmsd calibrate drives/monday drives/tuesday --write vehicle.toml
  tpmsd replay drives/wednesday --config vehicle.toml
"""


def add_parser(subparsers: Subparsers) -> None:
    """Add `calibrate` to the command line."""
    parser = subparsers.add_parser(
        "calibrate",
        help="learn the radii of a car from a recorded drive",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("drives", type=Path, metavar="DRIVE", nargs="+", help="drive folder")
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help="configuration instead of DRIVE/vehicle.toml"
    )
    parser.add_argument(
        "--method",
        default="joint",
        help="joint: all wheels and drives at once (default); paper: the rear pair as in paper 002",
    )
    parser.add_argument("--write", type=Path, metavar="FILE", help="write a vehicle.toml with what was found")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="write a picture (.png .svg .pdf)")
    add_json_option(parser)


def run(args: argparse.Namespace) -> int:
    """Calibrate."""
    # Thousands of small matrices: threads of the linear algebra only get in each other's way.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    from tpmsd.calibration.calibrate import METHODS, calibrate
    from tpmsd.calibration.checks import RefusedError
    from tpmsd.calibration.wording import document, summary

    if args.method not in METHODS:
        raise ConfigError(f"no such method: {args.method!r} (methods: {' '.join(METHODS)})")
    if args.plot is not None:
        from tpmsd.report.replay_plot import check_plot_target

        check_plot_target(args.plot)  # before the work, not after it
    recordings, config = read_recordings(args.drives, args.config)
    try:
        found, car = calibrate(recordings, config.vehicle, args.method)
    except RefusedError as refusal:
        at = refusal.drive
        where = args.drives[at] if at is not None else ", ".join(str(drive) for drive in args.drives)
        raise InputError(where, f"cannot be calibrated from: {refusal}") from None
    if args.write is not None:
        write_vehicle(config, found, args.write)
    if args.plot is not None:
        from tpmsd.calibration.plot import plot_calibration

        plot_calibration(found, recordings, config.vehicle, car, args.plot)
    if args.json is not None:
        write_json(document(found), args.json)
    if args.json != "-":
        print(summary(found))
    return 0


def read_recordings(folders: list[Path], config_file: Path | None) -> tuple[list[Recording], Config]:
    """The drives as arrays, and the configuration of the first; InputError where they do not go together."""
    from tpmsd.calibration.recording import record
    from tpmsd.cli.drive_reading import read_ticks
    from tpmsd.config.load import load_config

    first: Config | None = None
    recordings = []
    for folder in folders:
        if not folder.is_dir():
            raise InputError(folder, "not a folder" if folder.exists() else "no such drive folder")
        config = load_config(config_file if config_file is not None else folder)
        if first is None:
            first = config
        elif config.vehicle != first.vehicle:
            raise InputError(
                folder, f"its [vehicle] is not that of {folders[0]}; give one for all with --config"
            )
        try:
            recordings.append(record(folder.resolve().name, read_ticks(folder, config), config))
        except InputError:
            raise
        except ValueError as error:
            raise InputError(folder, str(error)) from None
    assert first is not None
    return recordings, first


def write_vehicle(config: Config, found: Calibration, target: Path) -> None:
    """Write the configuration with the calibrated values; TpmsdError where it cannot be written or read
    back."""
    from tpmsd.calibration.vehicle_file import calibrated_toml
    from tpmsd.config.load import load_config
    from tpmsd.wheels import WHEELS

    source = config.file
    assert source is not None
    radii = dict(zip(WHEELS, config.vehicle.wheel_radius_m, strict=True))
    radii |= {wheel: result.radius_m for wheel, result in found.wheels.items()}
    dbc = os.path.relpath(config.can.dbc.resolve(), target.resolve().parent)
    made = time.strftime("%Y-%m-%d", time.gmtime())
    try:
        text = calibrated_toml(source.read_text(encoding="utf-8"), found, radii, dbc, made)
        target.write_text(text, encoding="utf-8")
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise TpmsdError(f"{target}: cannot write: {reason}") from None
    written = load_config(target).vehicle
    if max(abs(a - b) for a, b in zip(written.wheel_radius_m, radii.values(), strict=True)) > 1e-6:
        raise TpmsdError(f"{target}: the calibrated radii did not get into it")
