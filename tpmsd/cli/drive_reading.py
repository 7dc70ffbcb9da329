"""Plays a recorded drive into the core: what replay, calibrate and diagnose share.

In: a drive folder and its configuration. Out: what the core makes of each frame and sentence. Notes on the
drive's state go to standard error.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol, TypeVar

from cantools.database import Database

from tpmsd.cli.output import Progress
from tpmsd.config.model import Config
from tpmsd.errors import ConfigError, InputError
from tpmsd.sources.can_channels import choose_channel
from tpmsd.sources.can_decoder import CanDecoder, load_database
from tpmsd.sources.can_frame import CanFrame
from tpmsd.sources.can_log import read_can_log
from tpmsd.sources.drive import Drive
from tpmsd.sources.plain_nmea import clock_offset
from tpmsd.sources.signal_plan import compile_plans
from tpmsd.timeline.tick import Tick
from tpmsd.timeline.tick_source import TickSource

DESK_RATE_HZ = 10.0
"""Fast enough for the motion of a car, and slow enough for the counts of a coarse ring."""

Out = TypeVar("Out")


class Core(Protocol[Out]):
    """What a drive can be played into: `TickSource` and `Pipeline`."""

    @property
    def decoder(self) -> CanDecoder:
        """Its counts tell whether the DBC fits."""
        ...

    def on_frame(
        self, time_s: float, arbitration_id: int, is_extended: bool, data: bytes, is_fd: bool = False
    ) -> list[Out]:
        """Take one CAN data frame."""
        ...

    def on_sentence(self, time_s: float, line: bytes) -> list[Out]:
        """Take one NMEA line."""
        ...

    def finish(self) -> list[Out]:
        """Complete what the end of the recording completes."""
        ...


def open_drive(folder: Path, config: Config) -> tuple[Drive, Database]:
    """The drive in a folder, its clocks aligned, and its DBC.

    InputError if there is no such drive; ConfigError (with the configuration's file) if the signals do not
    fit.
    """
    if not folder.is_dir():
        raise InputError(folder, "not a folder" if folder.exists() else "no such drive folder")
    drive = Drive(folder)
    database = load_database(config.can.dbc)
    try:
        decoder = CanDecoder(config, database)
    except ConfigError as error:
        raise ConfigError(f"{config.file or folder}: {error}") from None
    plans = compile_plans(config, database)
    channel = choose_channel(read_can_log(drive.can_log), plans, config.can.channel)
    drive.channel = channel.name
    if channel.note:
        print(f"tpmsd: {drive.can_log}: {channel.note}", file=sys.stderr)
    if not drive.host_times:
        _align_clocks(drive, config, decoder)
    return drive, database


def play(drive: Drive, core: Core[Out], label: str) -> Iterator[Out]:
    """What the core makes of the whole drive, in order, with a progress bar on a terminal.

    InputError at the end if no frame had an identifier that the configured signals need.
    """
    start: float | None = None
    with Progress(drive.span_s() if sys.stderr.isatty() else 0.0, label) as progress:
        for number, item in enumerate(drive):
            if isinstance(item, CanFrame):
                time_s, _, identifier, is_extended, is_fd, is_error, is_remote, data, _ = item
                if not (is_error or is_remote):
                    yield from core.on_frame(time_s, identifier, is_extended, data, is_fd)
            else:
                yield from core.on_sentence(item.time_s, item.line)
            if number % 2000 == 0:
                start = item.time_s if start is None else start
                progress.update(item.time_s - start)
    yield from core.finish()
    counts = core.decoder.counts
    if counts["frames"] == counts["ignored"]:
        # A drive in which no wheel ever turned up is the wrong DBC or the wrong log, not a quiet drive.
        raise InputError(
            drive.can_log,
            f"none of its {counts['frames']} frames has an identifier that the configured signals need "
            "(wrong DBC or log?)",
        )
    for source, note in drive.first_bad.items():
        count = drive.counts[f"{source} bad lines"]
        lines = "1 bad line" if count == 1 else f"{count} bad lines"
        print(f"tpmsd: {lines} skipped, first {note}", file=sys.stderr)


def read_ticks(folder: Path, config: Config, rate_hz: float = DESK_RATE_HZ) -> list[Tick]:
    """All ticks of a drive, made as the daemon's own core makes them, without an estimator."""
    drive, database = open_drive(folder, config)
    return list(play(drive, TickSource(config, database, rate_hz), folder.name or str(folder)))


def _align_clocks(drive: Drive, config: Config, decoder: CanDecoder) -> None:
    """Put plain NMEA lines, whose UTC is their only clock, onto the host clock of the CAN log."""
    again = Drive(drive.folder)
    again.channel = drive.channel
    found = clock_offset(again, decoder, config.vehicle.wheel_radius_m[2])
    if found is not None and found.trusted:
        drive.gnss_offset_s = found.offset_s
        note = f"shifted by {found.offset_s:+.2f} s to fit the wheels (correlation {found.correlation:.3f})"
    else:
        note = "taken as the host clock, for the speeds do not tell its offset"
    print(f"tpmsd: {drive.nmea_log}: lines bear no host time; their UTC is {note}", file=sys.stderr)
