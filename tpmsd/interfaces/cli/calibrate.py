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

from tpmsd.foundation.errors import ConfigError, InputError, TpmsdError
from tpmsd.interfaces.cli.output import Progress, Subparsers, add_json_option, json_text
from tpmsd.interfaces.cli.output_files import OutputError, Outputs, write_whole

if TYPE_CHECKING:
    from tpmsd.car.config.model import Config
    from tpmsd.offline.calibration.result import FittedGeometry
    from tpmsd.offline.inference.recording import Recording

MAX_FROM_NOMINAL = 0.2
"""Largest share by which a calibrated radius may leave the configured one. All tyres that fit one car lie
within 5 % (ETRTO); the smallest wrong unit, mph for km/h, is off by 38 %."""

SCHEMA = "tpmsd.calibration/2"
_DESCRIPTION = """\
Learns each wheel's circumference and the tracks from one or several drives of a car whose tyres are as they
should be, with their standard deviations. One drive round the block will do: some minutes, with straights and
bends; the more the better. Pressures right, tyres warm, and the open sky over the receiver make it good.

DRIVE is a folder with vehicle.toml, bus.dbc, can.log (or .log.gz .asc .blf .trc .mf4) and gnss.nmea, such as
`tpmsd run --record` writes. The radii there may be guessed: a data sheet's value is near enough.

A drive from which a calibration cannot be had (too short, never straight, never turning, no fixes, a tyre
that loses pressure) is refused with the reason.
"""
_EPILOG = """\
examples:
  tpmsd calibrate drives/monday
  tpmsd calibrate drives/monday drives/tuesday --write vehicle.toml
  tpmsd calibrate drives/monday --write /etc/tpmsd/tpmsd.toml    into a configuration that exists
  tpmsd calibrate drives/monday --plot monday.png --json -
  tpmsd replay drives/wednesday --config vehicle.toml            and so with run, diagnose, check

exit codes: 0 done; 2 wrong usage or configuration; 3 unusable drive (it says why); 1 anything else
"""


def add_parser(subparsers: Subparsers) -> None:
    """Add `calibrate` to the command line."""
    parser = subparsers.add_parser(
        "calibrate",
        help="learn the radii of a car from a recorded drive",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )
    parser.add_argument("drives", type=Path, metavar="DRIVE", nargs="+", help="drive folder")
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help="configuration instead of DRIVE/vehicle.toml"
    )
    parser.add_argument(
        "--method",
        default="joint",
        help="joint: all wheels and drives at once (default); paper: the rear pair, by the published method",
    )
    parser.add_argument(
        "--write",
        type=Path,
        metavar="FILE",
        help="put what was found into this vehicle.toml: into a new one, made after the drive's, or into one "
        "that exists, whose other keys, tables and comments stay",
    )
    parser.add_argument("--plot", type=Path, metavar="FILE", help="write a picture (.png .svg .pdf)")
    add_json_option(parser)


def run(args: argparse.Namespace) -> int:
    """Run `tpmsd calibrate`; return the exit code."""
    # Thousands of small matrices: threads of the linear algebra only get in each other's way.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    from tpmsd.foundation.provenance import provenance
    from tpmsd.offline.calibration.calibrate import METHODS, calibrate
    from tpmsd.offline.calibration.checks import RefusedError
    from tpmsd.offline.calibration.wording import document, summary

    if args.method not in METHODS:
        raise ConfigError(f"no such method: {args.method!r} (methods: {' '.join(METHODS)})")
    from tpmsd.offline.calibration.plot import draw_calibration
    from tpmsd.offline.report.replay_plot import check_plot_target, picture

    targets = (("--write", args.write), ("--plot", args.plot), ("--json", args.json))
    outputs = Outputs(*targets, configuration="--write")
    if args.plot is not None:
        check_plot_target(args.plot)
    if args.write is not None and args.write.exists():
        from tpmsd.car.config.load import load_config

        load_config(args.write)  # what is no configuration must not become one
    recordings, config = read_recordings(args.drives, args.config)
    span_s = sum(float(recording.edges_s[-1]) for recording in recordings)
    try:
        with Progress(span_s, "calibrating") as bar:
            found, car = calibrate(
                recordings, config.vehicle, args.method, lambda share: bar.update(share * span_s)
            )
    except RefusedError as refusal:
        at = refusal.drive
        where = args.drives[at] if at is not None else ", ".join(str(drive) for drive in args.drives)
        raise InputError(where, f"cannot be calibrated from: {refusal}") from None
    check_radii(found, config)
    outputs.say(summary(found, config.bus_radii_m))
    if args.write is not None:
        write_vehicle(config, found, args.write)
    outputs.write(
        {
            "--write": lambda: None,  # done: it is checked as a configuration before it takes its place
            "--plot": lambda: picture(
                draw_calibration(found, recordings, config.vehicle, car), args.plot.suffix
            ),
            "--json": lambda: json_text(
                {**provenance(SCHEMA, args.drives, config.file), **document(found, config.bus_radii_m)}
            ),
        }
    )
    return 0


def read_recordings(folders: list[Path], config_file: Path | None) -> tuple[list[Recording], Config]:
    """Return the drives as arrays, and the configuration of the first; InputError if they are of different
    cars."""
    from tpmsd.car.config.load import load_config
    from tpmsd.interfaces.cli.drive_reading import read_ticks
    from tpmsd.offline.inference.recording import record

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
            recordings.append(record(read_ticks(folder, config), config, folder.resolve().name))
        except TpmsdError:
            raise
        except ValueError as error:
            raise InputError(folder, str(error)) from None
    assert first is not None
    return recordings, first


def check_radii(found: FittedGeometry, config: Config) -> None:
    """Raise InputError where a radius is far from the configured one: a unit or the teeth are wrong."""
    from tpmsd.foundation.wheels import WHEELS

    nominal = dict(zip(WHEELS, config.vehicle.wheel_radius_m, strict=True))
    for wheel, result in found.wheels.items():
        if not abs(result.radius_m / nominal[wheel] - 1.0) <= MAX_FROM_NOMINAL:
            raise InputError(
                config.file or "the configuration",
                f"wheel {wheel} comes out with a radius of {result.radius_m:.3f} m, and"
                f" {nominal[wheel]:.3f} m is configured: its unit, teeth_per_rev or wheel_radius_m is wrong",
            )


def write_vehicle(config: Config, found: FittedGeometry, target: Path) -> None:
    """Write the calibrated values into a new copy of the configuration, or into the one that is there.

    The new text is read back as a configuration before it takes the target's place; what was there before is
    kept as `<name>.bak`.

    OutputError where it cannot be written or would be no configuration; the target is then as it was.
    """
    from tpmsd.car.config.load import load_config
    from tpmsd.foundation.wheels import WHEELS
    from tpmsd.offline.calibration.vehicle_file import calibrated_toml

    base = load_config(target) if target.exists() else config
    source = base.file
    assert source is not None
    radii = dict(zip(WHEELS, base.vehicle.wheel_radius_m, strict=True))
    radii |= {wheel: result.radius_m for wheel, result in found.wheels.items()}
    dbc = None
    if base is config:
        dbc = os.path.relpath(config.can.dbc.resolve(), target.resolve().parent)
    made = time.strftime("%Y-%m-%d", time.gmtime())
    real = target.resolve()
    trial = real.with_name(f".{real.name}.trial.toml")  # beside it, so that its relative paths hold
    try:
        text = calibrated_toml(
            source.read_text(encoding="utf-8-sig"), found, radii, config.bus_radii_m, dbc, made
        )
        trial.write_text(text, encoding="utf-8")
        read_back = load_config(trial).vehicle.wheel_radius_m
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise OutputError(f"{target}: not written: {reason}") from None
    finally:
        trial.unlink(missing_ok=True)
    if max(abs(a - b) for a, b in zip(read_back, radii.values(), strict=True)) > 1e-6:
        raise OutputError(f"{target}: not written: the calibrated radii would not get into it")
    write_whole(target, text, backup=True)
