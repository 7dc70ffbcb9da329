"""`tpmsd status`: asks the running daemon how the tyres are.

In: the daemon's Unix socket. Out: a table, or the document as JSON; with `--watch` again with every update.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shutil
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO, Any

from tpmsd.foundation.errors import TpmsdError
from tpmsd.interfaces.cli.daemon_socket import add_socket_options, daemon_socket
from tpmsd.interfaces.cli.output import Subparsers, dumps, write_json
from tpmsd.interfaces.cli.output_files import Outputs
from tpmsd.interfaces.cli.status_table import WIDTH, render_status
from tpmsd.interfaces.cli.status_watch import watch_screen
from tpmsd.onboard.sinks.status_client import read_status, watch_status

_EPILOG = """\
examples:
  tpmsd status                         how are the tyres?
  tpmsd status --watch                 live, with trends and rates; q or Ctrl-C ends it
  tpmsd status --json | jq .alarms     for programs; with --watch one JSON line per update
"""


def add_parser(subparsers: Subparsers) -> None:
    """Declare the command's arguments."""
    parser = subparsers.add_parser(
        "status",
        help="ask the running daemon how the tyres are",
        description="Shows how each tyre is, how the daemon's inputs are, and which alarms are active.",
        epilog=_EPILOG,
    )
    add_socket_options(parser)
    parser.add_argument(
        "--json",
        metavar="FILE",
        nargs="?",
        const="-",
        help="write JSON to FILE (no FILE or '-': standard output)",
    )
    parser.add_argument("--watch", action="store_true", help="show every update until Ctrl-C")


def run(args: argparse.Namespace) -> int:
    """Run `tpmsd status`; TpmsdError with one line where the daemon cannot be asked."""
    Outputs(("--json", args.json))  # before the daemon is asked
    path = daemon_socket(args)
    if not args.watch:
        document = read_status(path)
        if args.json is None:
            show(document, sys.stdout)
        else:
            write_json(document, args.json)
        return 0
    with contextlib.closing(watch_status(path)) as documents, contextlib.suppress(KeyboardInterrupt):
        if args.json is None:
            watch(documents, sys.stdout)
        else:
            _write_json_lines(documents, args.json)
    return 0


def show(document: Mapping[str, Any], out: IO[str], environment: Mapping[str, str] | None = None) -> None:
    """Write the table once."""
    out.write(render_status(document, colour=colour_wanted(out, environment), width=terminal_width(out)))
    out.flush()


def watch(
    documents: Iterable[Mapping[str, Any]], out: IO[str], environment: Mapping[str, str] | None = None
) -> None:
    """Show each document: on a terminal as a screen of its own, else one table below the other."""
    if can_move(out, environment):
        watch_screen(documents, out, colour_wanted(out, environment))
        return
    for number, document in enumerate(documents):
        table = render_status(document, width=terminal_width(out))
        out.write(("\n" if number else "") + table)
        out.flush()


def can_move(out: IO[str], environment: Mapping[str, str] | None = None) -> bool:
    """Return whether `out` is a terminal on which lines can be written again in place."""
    environment = os.environ if environment is None else environment
    return out.isatty() and environment.get("TERM") != "dumb"


def colour_wanted(out: IO[str], environment: Mapping[str, str] | None = None) -> bool:
    """Return whether `out` is a terminal with colours and NO_COLOR is not set (https://no-color.org)."""
    environment = os.environ if environment is None else environment
    return can_move(out, environment) and not environment.get("NO_COLOR")


def terminal_width(out: IO[str]) -> int | None:
    """Return the columns of the terminal; None for a file or a pipe, which takes lines of any length."""
    if not out.isatty():
        return None
    return shutil.get_terminal_size((WIDTH, 24)).columns


def _write_json_lines(documents: Iterable[Mapping[str, Any]], target: str) -> None:
    if target == "-":
        _write_line_per_document(documents, sys.stdout)
        return
    try:
        with Path(target).open("w", encoding="utf-8") as file:
            _write_line_per_document(documents, file)
    except OSError as error:
        raise TpmsdError(f"{target}: cannot write: {error.strerror or error}") from error


def _write_line_per_document(documents: Iterable[Mapping[str, Any]], out: IO[str]) -> None:
    for document in documents:
        out.write(dumps(document, indent=None) + "\n")
        out.flush()
