"""`tpmsd replay DRIVE`: runs a recorded drive through the daemon's own core, at full speed.

In: a drive folder. Out: a summary, JSON and a picture; progress on standard error.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import VEHICLE_STATE_METHODS, Config
from tpmsd.car.config.vehicle_state import check_vehicle_state
from tpmsd.foundation.errors import InputError
from tpmsd.foundation.provenance import provenance
from tpmsd.foundation.startup import keep_freed_memory
from tpmsd.interfaces.cli.drive_reading import say, span_s
from tpmsd.interfaces.cli.filter_options import add_filter_options, compensated_model, with_filter
from tpmsd.interfaces.cli.output import Progress, Subparsers, add_json_option, json_text
from tpmsd.interfaces.cli.output_files import Outputs
from tpmsd.interfaces.cli.replay_signals import has_signals_alone, run_signals
from tpmsd.offline.drives import playing
from tpmsd.offline.drives.drive import Drive, car_settings
from tpmsd.offline.drives.reading import FolderRecording
from tpmsd.offline.report.replay_document import REPLAY_SCHEMA, replay_document
from tpmsd.offline.report.replay_result import ReplayResult
from tpmsd.offline.report.replay_summary import replay_summary

if TYPE_CHECKING:
    from tpmsd.car.physics.model import ExtendedModel
    from tpmsd.offline.tables.tick_table import TickTable

_DESCRIPTION = """\
Runs a recorded drive through the same core as the daemon, at full speed, and says what the daemon would
have said: radius of each wheel with its standard deviation, alarms, and how well the inputs served.

DRIVE is a folder with vehicle.toml, bus.dbc, can.log (or .log.gz .asc .blf .trc .mf4) and gnss.nmea.
"""
_EPILOG = """\
examples:
  tpmsd replay drives/monday
  tpmsd replay drives/monday --plot monday.png --json monday.json
  tpmsd replay drives/monday --html monday.html      one page with plots, track and tables
  tpmsd replay drives/monday --config other.toml     the same drive with another configuration
  tpmsd replay drives/monday --parquet monday.parquet --mcap monday.mcap
  tpmsd replay drives/monday --vehicle-state arupf --csv monday.csv     speeds and side slip
"""
_TABLES = {
    "csv": "as CSV",
    "parquet": "as Parquet",
    "mcap": "as MCAP, for Foxglove and PlotJuggler",
}


def add_parser(subparsers: Subparsers) -> None:
    """Add `replay` to the command line."""
    parser = subparsers.add_parser(
        "replay",
        help="run a recorded drive through the daemon's core",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )
    parser.add_argument("drive", type=Path, metavar="DRIVE", help="drive folder")
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help="configuration instead of DRIVE/vehicle.toml"
    )
    parser.add_argument("--plot", type=Path, metavar="FILE", help="write a picture (.png .svg .pdf)")
    parser.add_argument("--html", type=Path, metavar="FILE", help="write a page with plots and the track")
    for kind, what in _TABLES.items():
        parser.add_argument(f"--{kind}", type=Path, metavar="FILE", help=f"write the tick table {what}")
    parser.add_argument(
        "--vehicle-state",
        choices=VEHICLE_STATE_METHODS,
        metavar="FILTER",
        help="also estimate speeds, side slip and yaw rate of the centre of gravity, by "
        + ", ".join(VEHICLE_STATE_METHODS)
        + "; needs [dynamics]; DRIVE may hold signals.csv instead of a bus",
    )
    add_filter_options(parser)
    add_json_option(parser)


_KINDS = ("csv", "parquet", "mcap")


def run(args: argparse.Namespace) -> int:
    """Run `tpmsd replay`; return the exit code."""
    if has_signals_alone(args.drive):
        return run_signals(args)
    outputs = _outputs(args)
    config = load_config(args.config if args.config is not None else _checked_folder(args.drive))
    config = _with_vehicle_state(with_filter(config, args), args)
    model = compensated_model(config, args, say)
    wanted = args.html is not None or any(outputs.asked(f"--{kind}") for kind in _KINDS)
    keep_freed_memory()
    result, table = replayed(args.drive, config, model, table=wanted)
    if table is not None and table.fixes_left_out:
        say(f"the tick table lacks {table.fixes_left_out} fixes: the receiver is faster than the ticks")
    origin = cache(lambda: provenance(REPLAY_SCHEMA, [args.drive], config.file))
    outputs.say(replay_summary(result))
    outputs.write(
        {
            "--plot": lambda: _picture(result, args.plot),
            "--html": lambda: _page(result, table, origin()),
            **_table_writers(table, config),
            "--json": lambda: json_text({**origin(), **replay_document(result)}),
        }
    )
    return 0


def _outputs(args: argparse.Namespace) -> Outputs:
    """Return the outputs that were asked for; ConfigError where a package for one is missing."""
    asked = [(f"--{kind}", getattr(args, kind)) for kind in _KINDS]
    outputs = Outputs(("--plot", args.plot), ("--html", args.html), *asked, ("--json", args.json))
    if args.plot is not None:
        from tpmsd.offline.report.replay_plot import check_plot_target

        check_plot_target(args.plot)
    if args.html is not None:
        from tpmsd.offline.report.page import check_report_packages

        check_report_packages()
    for kind in _KINDS:
        if outputs.asked(f"--{kind}"):
            from tpmsd.offline.tables.write import check_packages

            check_packages(kind)
    return outputs


def _table_writers(table: TickTable | None, config: Config) -> dict[str, Callable[[], str | bytes]]:
    """Return option -> function that makes the tick table's text or bytes; empty where there is no table."""
    if table is None:
        return {}
    # Imported where it is used: most replays write none.
    from tpmsd.offline.tables.car_file import toml_text
    from tpmsd.offline.tables.write import csv_text, parquet_bytes
    from tpmsd.offline.tables.write_mcap import mcap_bytes

    return {
        "--csv": lambda: csv_text(table),
        "--parquet": lambda: parquet_bytes(table, toml_text(car_settings(config))),
        "--mcap": lambda: mcap_bytes(table),
    }


def _picture(result: ReplayResult, file: Path) -> bytes:
    """Return the replay as a picture of the form of the file's suffix."""
    from tpmsd.offline.report.replay_plot import plot_replay

    return plot_replay(result, file.suffix)


def _page(result: ReplayResult, table: TickTable | None, origin: dict[str, Any]) -> str:
    """Return the replay as an HTML page."""
    from tpmsd.interfaces.api.pages import replay_html
    from tpmsd.offline.report.page import Origin

    return replay_html(result, table, Origin.now(origin))


def _checked_folder(drive: Path) -> Path:
    """Return the drive's folder; InputError if it is none."""
    if not drive.is_dir():
        raise InputError(drive, "not a folder" if drive.exists() else "no such drive folder")
    return drive


def _with_vehicle_state(config: Config, args: argparse.Namespace) -> Config:
    """Return the configuration with the filter of `--vehicle-state`; ConfigError if the car is not known."""
    if args.vehicle_state is None:
        return config
    check_vehicle_state(config)
    chosen = dataclasses.replace(config.vehicle_state, method=args.vehicle_state)
    return dataclasses.replace(config, vehicle_state=chosen)


def replay(folder: Path, config: Config, model: ExtendedModel | None = None) -> ReplayResult:
    """Run a drive through the core; raises InputError if nothing usable is in it."""
    return replayed(folder, config, model)[0]


def replayed(
    folder: Path, config: Config, model: ExtendedModel | None = None, table: bool = False
) -> tuple[ReplayResult, TickTable | None]:
    """Return result and tick table (None unless `table`) of a drive; progress and notes on standard error."""
    recording = FolderRecording(folder)
    drive = Drive(folder.resolve().name, config, recording)
    with Progress(span_s(folder) if sys.stderr.isatty() else 0.0, "replay") as progress:
        return playing.replay_drive(drive, model, table, progress.update, say)
