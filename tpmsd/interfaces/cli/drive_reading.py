"""A recorded drive for commands: `tpmsd.offline.drives.reading` with a progress bar and its notes on
standard error.

In: a drive folder and its configuration. Out: what the core makes of each frame and sentence.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from cantools.database.can import Database

from tpmsd.car.config.model import Config
from tpmsd.foundation.startup import no_collection
from tpmsd.interfaces.cli.output import Progress
from tpmsd.offline.drives import reading
from tpmsd.offline.drives.reading import DESK_RATE_HZ, Core, FolderRecording, Out
from tpmsd.onboard.sources.drive import FolderStream
from tpmsd.onboard.timeline.block_source import BlockSource
from tpmsd.onboard.timeline.tick import Tick
from tpmsd.onboard.timeline.tick_source import TickSource

__all__ = ["open_drive", "play", "read_ticks", "say", "span_s"]


def say(line: str) -> None:
    """Print a note on standard error."""
    print(f"tpmsd: {line}", file=sys.stderr)


def open_drive(folder: Path, config: Config) -> tuple[FolderStream, Database]:
    """Return the drive in a folder, its clocks aligned, and its DBC.

    InputError if there is no such drive; ConfigError (with the configuration's file) if the signals do not
    fit.
    """
    return FolderRecording(folder).open(config, say)


def span_s(folder: Path) -> float:
    """Return the duration of a drive by the receiver's log (s), for progress bars; 0 if not known cheaply."""
    return FolderStream(folder).span_s() if folder.is_dir() else 0.0


def play(drive: FolderStream, core: Core[Out], label: str) -> Iterator[Out]:
    """Yield the core's output over the whole drive, in order, with a progress bar on a terminal.

    InputError at the end if no frame had an identifier that the configured signals need.
    """
    with Progress(drive.span_s() if sys.stderr.isatty() else 0.0, label) as progress:
        yield from reading.play(drive, core, progress.update, say)


def read_ticks(folder: Path, config: Config, rate_hz: float = DESK_RATE_HZ) -> list[Tick]:
    """Return all ticks of a drive, made as the daemon's own core makes them, without an estimator."""
    drive, database = open_drive(folder, config)
    source = BlockSource(TickSource(config, database, rate_hz))
    with no_collection():
        return list(play(drive, source, folder.name or str(folder)))
