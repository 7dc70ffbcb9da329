"""`tpmsd import TABLE --map map.toml DRIVE`: a user's own table as a drive folder.

In: a table (CSV, Parquet, MF4, MATLAB v7.3) and its map, or a Racelogic VBO file. Out: a drive folder that
every command takes; of a VBO file one with `signals.csv`.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from tpmsd.foundation.errors import ConfigError
from tpmsd.interfaces.cli.output import Subparsers, add_json_option, json_text
from tpmsd.interfaces.cli.output_files import Outputs

EXIT_UNDECIDED = 4
_DESCRIPTION = """\
Makes a drive folder of a table that your own simulator or logger wrote, so that replay, diagnose
and calibrate take it like a recording.

TABLE is CSV, Parquet, MF4 or MATLAB v7.3. The map says which column is what, in which unit, and of which
car; it is checked like a configuration. Without a map the columns' names tell role and unit, as in the
tables that `tpmsd replay --csv` and `--parquet` write. --guess prints a map to begin with: roles by
names, units, signs and the rolling radius by the values.

A Racelogic VBO file (.vbo) becomes a folder with signals.csv, for diagnose --baseline single-track and
three-dof and replay --vehicle-state. It needs no map; --vehicle copies the car's vehicle.toml beside it.
"""
_EPILOG = """\
a map:
  vehicle = "vehicle.toml"        # or the tables [vehicle] and [gnss] of one, here
  [table]
  time = "t"                      # time_unit = "ms"
  [columns]
  wheel_speed_fl = { column = "v_fl", unit = "km/h" }     and fr, rl, rr
  gnss_latitude = "lat"
  gnss_longitude = "lon"

examples:
  tpmsd import log.csv --guess > map.toml
  tpmsd import log.csv --map map.toml drives/monday
  tpmsd import monday.parquet drives/again         a table of tpmsd replay --parquet
  tpmsd import track.vbo drives/track --vehicle car.toml

exit codes: 0 done, 2 wrong usage or map, 3 unusable table, 4 --guess found no wheels
"""


class _GuessFlag(argparse.Action):
    """A flag with which DRIVE is not required.

    DRIVE keeps its place as a required argument, for argparse takes an optional one for absent as soon as an
    option stands between it and TABLE.
    """

    def __init__(self, drive: argparse.Action, **named: Any) -> None:
        super().__init__(nargs=0, default=False, **named)
        self._drive = drive

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: object,
        option_string: str | None = None,
    ) -> None:
        """Set the flag, with which DRIVE is not required."""
        self._drive.required = False
        setattr(namespace, self.dest, True)


def add_parser(subparsers: Subparsers) -> None:
    """Add `import` to the command line."""
    parser = subparsers.add_parser(
        "import",
        help="make a drive of a table",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("table", type=Path, metavar="TABLE", help="a table")
    drive = parser.add_argument("drive", type=Path, metavar="DRIVE", help="folder to write the drive to")
    parser.add_argument("--map", type=Path, metavar="FILE", help="which column is what")
    parser.add_argument(
        "--guess", action=_GuessFlag, drive=drive, help="print a map of TABLE, guessed; takes no DRIVE"
    )
    parser.add_argument(
        "--vehicle", type=Path, metavar="FILE", help="of a VBO file: the vehicle.toml to be put beside it"
    )
    add_json_option(parser)


def run(args: argparse.Namespace) -> int:
    """Run `tpmsd import`; return the exit code."""
    if args.guess:
        return _run_guess(args)

    from tpmsd.foundation.provenance import provenance
    from tpmsd.interfaces.api.import_table import load_table
    from tpmsd.interfaces.cli.drive_reading import say
    from tpmsd.onboard.sources.can.frame import CanFrame

    outputs = Outputs(("--json", args.json))
    if args.drive.exists() and (not args.drive.is_dir() or any(args.drive.iterdir())):
        raise ConfigError(f"{args.drive}: exists already")
    if args.table.suffix.lower() == ".vbo":
        return _run_vbo(args, outputs)
    if args.vehicle is not None:
        raise ConfigError("--vehicle is for VBO files; a map names the car of other tables")
    drive = load_table(args.table, args.map, say)
    drive.save(args.drive)
    items = getattr(drive.recording, "items", ())
    frames = sum(isinstance(item, CanFrame) for item in items)
    span_s = items[-1].time_s - items[0].time_s if items else 0.0
    document = {
        **provenance("tpmsd.import/1", [args.table], args.map),
        "folder": str(args.drive),
        "duration_s": span_s,
        "frames": frames,
        "sentences": len(items) - frames,
        "signals": drive.config.can.signals,
    }
    if not outputs.fill_stdout:
        print(f"{span_s:.0f} s, {frames} frames, {len(items) - frames} sentences: written to {args.drive}")
    outputs.write({"--json": lambda: json_text(document)})
    return 0


def _run_guess(args: argparse.Namespace) -> int:
    """Print the guessed map; return 0 if both rear wheels have a column."""
    from tpmsd.interfaces.api.import_table import guess_map

    for given, name in ((args.drive, "DRIVE"), (args.map, "--map"), (args.json, "--json")):
        if given is not None:
            raise ConfigError(f"--guess and {name} contradict each other")
    text, has_wheels = guess_map(args.table)
    print(text, end="")
    if not has_wheels:
        print(f"tpmsd: {args.table}: no column was taken for each rear wheel", file=sys.stderr)
    return 0 if has_wheels else EXIT_UNDECIDED


def _run_vbo(args: argparse.Namespace, outputs: Outputs) -> int:
    """Write the folder of a Racelogic VBO file with its `signals.csv`; return the exit code."""
    from tpmsd.foundation.provenance import provenance
    from tpmsd.foundation.text_file import read_text
    from tpmsd.interfaces.cli.drive_reading import say
    from tpmsd.offline.signals.vbo import CAR_TEMPLATE, read_vbo
    from tpmsd.offline.signals.write import write_signals_text

    if args.map is not None:
        raise ConfigError("--map is not for VBO files: they name their columns themselves")
    car = CAR_TEMPLATE if args.vehicle is None else read_text(args.vehicle, 1 << 20, "a vehicle.toml")
    table = read_vbo(args.table, say)
    write_signals_text(args.drive, table.columns, car)
    time_s = table.columns["time_s"]
    span_s = float(time_s.max() - time_s.min())
    document = {
        **provenance("tpmsd.import/1", [args.table], args.vehicle),
        "folder": str(args.drive),
        "duration_s": span_s,
        "frames": 0,
        "sentences": 0,
        "signals": table.sources,
    }
    if not outputs.fill_stdout:
        print(f"{span_s:.0f} s, {len(time_s)} rows of {' '.join(table.columns)}: written to {args.drive}")
        if args.vehicle is None:
            print(f"Fill in {args.drive / 'vehicle.toml'}: the car is not known yet.")
    outputs.write({"--json": lambda: json_text(document)})
    return 0
