"""A command that raises: what the frame of the command line is tested with."""

from __future__ import annotations

import argparse

from tpmsd.foundation.errors import InputError, TpmsdError
from tpmsd.interfaces.cli.output import Subparsers

ERRORS: dict[str, BaseException] = {
    "plain": TpmsdError("disk full"),
    "input": InputError("can.log", "no frame", 7),
    "interrupt": KeyboardInterrupt(),
    "pipe": BrokenPipeError(),
    "defect": ZeroDivisionError("division\nby zero"),
}


def add_parser(subparsers: Subparsers) -> None:
    """Declare the command."""
    subparsers.add_parser("raise").add_argument("kind")


def run(args: argparse.Namespace) -> int:
    """Raise what is asked for."""
    raise ERRORS[args.kind]
