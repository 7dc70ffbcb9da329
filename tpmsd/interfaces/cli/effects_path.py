"""`--effects-path` and `[physics] effects_path`: folders of effects that users bring.

In: the command line. Out: the folder handed to `tpmsd.car.physics.own_effects`, before the command runs. The
configuration of a drive folder is part of a recording, and no code is taken from recordings: there the key is
not followed, and that is said.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.text_file import read_text
from tpmsd.foundation.toml_text import parse_toml
from tpmsd.interfaces.cli.output import Subparsers

COMMANDS = (
    *("run", "replay", "explain", "web", "check", "simulate", "calibrate"),
    *("diagnose", "effects", "plan", "fleet"),
)
"""Those that know effects."""
MAX_BYTES = 1 << 20
FILE = "vehicle.toml"


def add_effects_option(command: str, subparsers: Subparsers) -> None:
    """Add the option `--effects-path DIR` to a command, if it knows effects."""
    parser = subparsers.choices.get(command)
    if parser is not None and command in COMMANDS:
        parser.add_argument(
            "--effects-path",
            type=Path,
            metavar="DIR",
            help="folder of Python files with effects of your own, which are run: name only what you trust",
        )


def use_own_effects(args: argparse.Namespace) -> None:
    """Load the effects in the folders that the command line or its configuration names; else ConfigError."""
    wanted: list[Path] = []
    if (given := getattr(args, "effects_path", None)) is not None:
        wanted.append(given)
    file = getattr(args, "config", None)
    if isinstance(file, Path) and file.is_file() and (named := _effects_path_in(file)) is not None:
        wanted.append(named)
    for folder in wanted:
        from tpmsd.car.physics.own_effects import use_folder  # here, since most runs have none

        use_folder(folder)
    if not wanted:
        _note_ignored_paths(args)


def _note_ignored_paths(args: argparse.Namespace) -> None:
    """Print a note for each drive folder whose `[physics] effects_path` is ignored."""
    drives = [getattr(args, "drive", None), getattr(args, "onto", None), getattr(args, "config", None)]
    more = getattr(args, "drives", None)
    for drive in [*drives, *(more if isinstance(more, list) else [])]:
        if isinstance(drive, Path) and drive.is_dir() and _effects_path_in(drive / FILE) is not None:
            print(
                f"tpmsd: {drive / FILE}: [physics] effects_path is not followed in a drive folder, for no"
                " code is taken from recordings: give --effects-path DIR",
                file=sys.stderr,
            )


def _effects_path_in(file: Path) -> Path | None:
    """Return `[physics] effects_path` of a configuration; None without one, or where it cannot be read: the
    command states such errors later."""
    try:
        document = parse_toml(read_text(file, MAX_BYTES, "a configuration"))
    except (ConfigError, ValueError, RecursionError):
        return None
    table = document.get("physics")
    named = table.get("effects_path") if isinstance(table, dict) else None
    if not isinstance(named, str) or not named or "\0" in named:
        return None
    return file.parent / Path(named).expanduser()
