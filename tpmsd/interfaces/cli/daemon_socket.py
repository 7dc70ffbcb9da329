"""The options that say where the running daemon listens, and what they come to.

In: a parser; what it read. Out: the path of the daemon's Unix socket.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from tpmsd.car.config.model import StatusConfig


def add_socket_options(parser: argparse.ArgumentParser) -> None:
    """Add `--socket` and `--config`, which exclude each other."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--socket", metavar="PATH", type=Path, help=f"the daemon's socket ({StatusConfig().socket})"
    )
    where.add_argument(
        "--config", metavar="FILE", type=Path, help="take the socket from this configuration: [status] socket"
    )


def daemon_socket(args: argparse.Namespace) -> Path:
    """Return the path of the daemon's socket: as given, else as configured, else the default."""
    if args.socket is not None:
        return Path(args.socket)
    if args.config is not None:
        from tpmsd.car.config.load import load_config  # takes its time, and is seldom needed

        return load_config(args.config).status.socket
    return StatusConfig().socket
