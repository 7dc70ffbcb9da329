"""`tpmsd explain [DRIVE]`: why an alarm is active, or why none is.

In: the running daemon's socket, or a drive folder that is replayed. Out: the probabilities before, the
evidence by contrast of wheels over time, the alternatives and why they lost, what would clear it; as text or
JSON.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import StatusConfig
from tpmsd.foundation.errors import ConfigError, InputError
from tpmsd.foundation.provenance import provenance
from tpmsd.interfaces.cli.daemon_socket import daemon_socket
from tpmsd.interfaces.cli.filter_options import (
    add_filter_options,
    compensated_model,
    refuse_without_drive,
    with_filter,
)
from tpmsd.interfaces.cli.output import Progress, Subparsers, add_json_option, json_text
from tpmsd.interfaces.cli.output_files import Outputs
from tpmsd.offline.report.explanation_text import explanation_text

SCHEMA = "tpmsd.explanation/1"

_DESCRIPTION = """\
Explains every alarm: the probabilities before, which evidence spoke for it by contrast of wheels over time,
which alternatives were considered and why they lost, and what would clear it. Where there is no alarm it says
why not yet: what is missing of motion, sky and learning.

Without DRIVE the running daemon is asked; with DRIVE the drive is replayed.
"""
_EPILOG = """\
examples:
  tpmsd explain                          why does the daemon say what it says?
  tpmsd explain drives/monday            the alarms of a recorded drive
  tpmsd explain drives/monday --json -   as JSON
  tpmsd explain drives/monday --method mpf-pn   by another estimator
"""


def add_parser(subparsers: Subparsers) -> None:
    """Declare the command's arguments."""
    parser = subparsers.add_parser(
        "explain", help="why an alarm is active, or why none is", description=_DESCRIPTION, epilog=_EPILOG
    )
    parser.add_argument("drive", type=Path, metavar="DRIVE", nargs="?", help="drive folder to replay")
    parser.add_argument(
        "--socket", metavar="PATH", type=Path, help=f"the daemon's socket ({StatusConfig().socket})"
    )
    parser.add_argument(
        "--config", metavar="FILE", type=Path, help="configuration instead of DRIVE/vehicle.toml"
    )
    add_filter_options(parser)
    add_json_option(parser)


def run(args: argparse.Namespace) -> int:
    """Run `tpmsd explain`; TpmsdError with one line where the daemon or the drive cannot be read."""
    if args.drive is not None and args.socket is not None:
        raise ConfigError("give a drive or the daemon's --socket, not both")
    if args.drive is None:
        refuse_without_drive(args)
    outputs = Outputs(("--json", args.json))
    document = _explanation_of_daemon(args) if args.drive is None else _explanation_of_drive(args.drive, args)
    outputs.say(explanation_text(document), end="")
    outputs.write({"--json": lambda: json_text(document)})
    return 0


def _explanation_of_daemon(args: argparse.Namespace) -> dict[str, Any]:
    from tpmsd.onboard.sinks.status_client import read_explanation

    return {**provenance(SCHEMA, [], args.config), **read_explanation(daemon_socket(args))}


def _explanation_of_drive(folder: Path, args: argparse.Namespace) -> dict[str, Any]:
    from tpmsd.interfaces.cli.drive_reading import say, span_s
    from tpmsd.offline.drives.drive import Drive
    from tpmsd.offline.drives.playing import explain_drive
    from tpmsd.offline.drives.reading import FolderRecording

    if not folder.is_dir():
        raise InputError(folder, "not a folder" if folder.exists() else "no such drive folder")
    config = with_filter(load_config(args.config if args.config is not None else folder), args)
    model = compensated_model(config, args, say)
    drive = Drive(folder.resolve().name, config, FolderRecording(folder))
    with Progress(span_s(folder) if sys.stderr.isatty() else 0.0, "explain") as progress:
        found = explain_drive(drive, model, progress.update, say)
    return {**provenance(SCHEMA, [folder], config.file), **found}
