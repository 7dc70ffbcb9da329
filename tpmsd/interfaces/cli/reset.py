"""`tpmsd reset`: tells the running daemon to learn the tyres again, or that another set is on the car.

In: the daemon's Unix socket. Out: one line that says what the daemon made of it; exit code 1 if it refused.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

from tpmsd.foundation.errors import TpmsdError
from tpmsd.foundation.provenance import provenance
from tpmsd.interfaces.cli.daemon_socket import add_socket_options, daemon_socket
from tpmsd.interfaces.cli.output import Subparsers, add_json_option, json_text
from tpmsd.interfaces.cli.output_files import Outputs
from tpmsd.onboard.sinks.status_client import printable, read_status, request_reset

SCHEMA = "tpmsd.reset/2"
WAIT_S = 5.0
"""For the daemon's next tick."""
POLL_S = 0.1

_EPILOG = """\
examples:
  tpmsd reset                     the pressures were set: learn what is normal again
  tpmsd reset --tyres winter      the winter tyres are on; known ones need no learning

The daemon compares what it learns with what was normal before: a tyre that is soft is found, the reset is
refused, and the alarm stays. `tpmsd status --json` shows it as .baseline.reset and .baseline.reset_reason.
"""


def add_parser(subparsers: Subparsers) -> None:
    """Declare the command's arguments."""
    parser = subparsers.add_parser(
        "reset",
        help="tell the running daemon to learn the tyres again",
        description="Call it after pressures were set or wheels were changed. Then drive: learning takes a\n"
        "minute of steady driving, and goes on for half an hour.",
        epilog=_EPILOG,
    )
    parser.add_argument("--tyres", metavar="NAME", help="the set of tyres that is on the car now")
    add_socket_options(parser)
    add_json_option(parser)


def run(args: argparse.Namespace) -> int:
    """Request a reset, wait for the tick that takes it, and print the outcome; 1 if it was refused."""
    outputs = Outputs(("--json", args.json))
    path = daemon_socket(args)
    before = _reset_count(request_reset(path, args.tyres))
    until_s = time.monotonic() + WAIT_S
    while _reset_count(document := read_status(path)) <= before:
        if time.monotonic() > until_s:
            raise TpmsdError(
                f"{path}: tpmsd has not taken up the reset within {WAIT_S:g} s: are there ticks?"
            )
        time.sleep(POLL_S)
    baseline: dict[str, Any] = document["baseline"]
    outputs.say(printable(str(baseline.get("reset_reason", ""))))
    outputs.write(
        {"--json": lambda: json_text({**provenance(SCHEMA, (), args.config), "baseline": baseline})}
    )
    return 1 if baseline.get("reset") == "refused" else 0


def _reset_count(document: dict[str, Any]) -> int:
    """Return how many requests the daemon has taken."""
    baseline = document.get("baseline")
    count = baseline.get("resets") if isinstance(baseline, dict) else None
    return count if isinstance(count, int) else 0
