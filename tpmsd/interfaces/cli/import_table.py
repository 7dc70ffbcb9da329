"""`tpmsd import TABLE --map map.toml DRIVE`: a user's own table as a drive folder.

In: a table (CSV, Parquet, MF4, MATLAB v7.3) and its map. Out: a drive folder that every command takes.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from tpmsd.foundation.errors import ConfigError
from tpmsd.interfaces.cli.output import Subparsers, add_json_option, json_text
from tpmsd.interfaces.cli.outputs import Outputs

_DESCRIPTION = """\
Makes a drive folder of a table that your own simulator or logger wrote, so that replay, diagnose
and calibrate take it like a recording.

TABLE is CSV, Parquet, MF4 or MATLAB v7.3. The map says which column is what, in which unit, and of which
car; it is checked like a configuration. Without a map the columns' names tell role and unit, as in the
tables that `tpmsd replay --csv` and `--parquet` write.
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
  tpmsd import log.csv --map map.toml drives/monday
  tpmsd import monday.parquet drives/again         a table of tpmsd replay --parquet
"""


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
    parser.add_argument("drive", type=Path, metavar="DRIVE", help="folder to write the drive to")
    parser.add_argument("--map", type=Path, metavar="FILE", help="which column is what")
    add_json_option(parser)


def run(args: argparse.Namespace) -> int:
    """Read, write, report."""
    from tpmsd.foundation.provenance import provenance
    from tpmsd.interfaces.api.import_table import load_table
    from tpmsd.interfaces.cli.drive_reading import say
    from tpmsd.onboard.sources.can_frame import CanFrame

    outputs = Outputs(("--json", args.json))
    if args.drive.exists() and (not args.drive.is_dir() or any(args.drive.iterdir())):
        raise ConfigError(f"{args.drive}: exists already")
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
