"""Plays a recorded drive into the core: what replay, calibrate and diagnose share.

In: a drive folder, or frames and sentences in memory, and the configuration. Out: what the core makes of each
frame and sentence. What is wrong with the recording goes to a callback, a line each.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

import cantools.database
import numpy as np
from cantools.database.can import Database
from numpy.typing import NDArray

from tpmsd.car.config.coarse_speed import coarse_step_warnings
from tpmsd.car.config.model import Config
from tpmsd.foundation.english import counted
from tpmsd.foundation.errors import ConfigError, InputError
from tpmsd.foundation.plain import brief
from tpmsd.foundation.startup import no_collection
from tpmsd.onboard.sources.can.block import FrameBlock
from tpmsd.onboard.sources.can.channels import bus_numbers, channel_names, choose_channel
from tpmsd.onboard.sources.can.databases import load_databases
from tpmsd.onboard.sources.can.decoder import CanDecoder
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.can.log import read_can_blocks
from tpmsd.onboard.sources.can.signal_plan import compile_plans, signal_steps
from tpmsd.onboard.sources.drive import FolderStream, FrameSlice, Sentence
from tpmsd.onboard.sources.gnss.plain_nmea import clock_offset
from tpmsd.onboard.timeline.block_source import BlockSource
from tpmsd.onboard.timeline.tick import Tick
from tpmsd.onboard.timeline.tick_source import TickSource

DESK_RATE_HZ = 10.0
"""Fast enough for the motion of a car, and slow enough for the counts of a coarse ring."""
PROGRESS_EVERY = 2000
"""Frames and sentences between two calls of the progress callback."""

Out = TypeVar("Out")
Note = Callable[[str], None]
Progress = Callable[[float], None]


def ignore_note(line: str) -> None:
    """Do nothing with a note."""


def ignore_progress(done_s: float) -> None:
    """Do nothing with a report of progress."""


class Core(Protocol[Out]):
    """Core that a drive can be played into: `BlockSource` and `Pipeline`."""

    @property
    def decoder(self) -> CanDecoder:
        """The decoder, whose counts show whether the DBC fits."""
        ...

    def on_frame(
        self, time_s: float, arbitration_id: int, is_extended: bool, data: bytes, bus: int = 0
    ) -> list[Out]:
        """Process one CAN data frame; return what follows from it."""
        ...

    def on_frames(self, block: FrameBlock, start: int, stop: int, bus: NDArray[np.intp]) -> Iterator[Out]:
        """Process the data frames `start` to before `stop` of a block. `bus` (channels,): number of the bus
        of each channel.
        """
        ...

    def on_sentence(self, time_s: float, line: bytes) -> list[Out]:
        """Process one NMEA line; return what follows from it."""
        ...

    def finish(self) -> list[Out]:
        """Return what the end of the recording completes."""
        ...


class Stream(Protocol):
    """One pass over a recording, oldest first."""

    counts: Counter[str]
    first_bad: dict[str, str]
    buses: dict[str, int]
    """Channel -> number of the bus, as `CanDecoder.decode` has it; 0 for those that are not here."""

    @property
    def can_log(self) -> Path:
        """Path of the file that an error about the frames names."""
        ...

    def parts(self) -> Iterator[FrameSlice | CanFrame | Sentence]:
        """Yield frames (also slices of a block) and sentences in the order of their stamps."""
        ...


class DriveReader(Protocol):
    """A drive that can be opened any number of times."""

    def open(self, config: Config, note: Note = ignore_note) -> tuple[Stream, Database]:
        """Return a new pass over it, its clocks aligned, and its DBC."""
        ...


@dataclass(frozen=True)
class FolderRecording:
    """A drive folder (docs: formats)."""

    folder: Path

    def open(self, config: Config, note: Note = ignore_note) -> tuple[FolderStream, Database]:
        """Return the drive, its clocks aligned, and its DBC.

        InputError if there is no such drive; ConfigError (with the configuration's file) if the signals do
        not fit.
        """
        folder = self.folder
        if not folder.is_dir():
            raise InputError(folder, "not a folder" if folder.exists() else "no such drive folder")
        stream = FolderStream(folder)
        database = load_databases(config)
        try:
            decoder = CanDecoder(config, database)
        except ConfigError as error:
            raise ConfigError(f"{config.file or folder}: {error}") from None
        plans = compile_plans(config, database)
        for line in coarse_step_warnings(config, signal_steps(config, database)):
            note(line)
        if config.can.buses:
            others = [bus.channel for bus in config.can.buses.values()]
            names = channel_names(read_can_blocks(stream.can_log))
            stream.buses = bus_numbers(names, config.can.channel, others)
        else:
            channel = choose_channel(read_can_blocks(stream.can_log), plans, config.can.channel)
            stream.channel = channel.name
            if channel.note:
                note(f"{stream.can_log}: {channel.note}")
        if not stream.host_times:
            _align_clocks(stream, config, decoder, note)
        return stream, database


@brief
@dataclass(frozen=True)
class MemoryRecording:
    """Frames and sentences that never were files, in the order of their stamps."""

    name: str
    items: Sequence[CanFrame | Sentence]
    dbc: str

    def open(self, config: Config, note: Note = ignore_note) -> tuple[MemoryStream, Database]:
        """Return a new pass over them, and their DBC."""
        return MemoryStream(self.name, self.items), self.database()

    def database(self) -> Database:
        """Return the parsed DBC."""
        database = cantools.database.load_string(self.dbc, "dbc")
        assert isinstance(database, Database)
        return database


class MemoryStream:
    """One pass over frames and sentences in memory."""

    def __init__(self, name: str, items: Iterable[CanFrame | Sentence]) -> None:
        self._items = items
        self.can_log = Path(name)
        self.counts: Counter[str] = Counter()
        self.first_bad: dict[str, str] = {}
        self.buses: dict[str, int] = {}

    def parts(self) -> Iterator[CanFrame | Sentence]:
        """Yield frames and sentences, oldest first."""
        return iter(self._items)


def play(
    stream: Stream,
    core: Core[Out],
    progress: Progress = ignore_progress,
    note: Note = ignore_note,
) -> Iterator[Out]:
    """Yield what the core makes of the whole drive, in order; `progress` is called with the seconds that are
    done.

    InputError at the end if no frame had an identifier that the configured signals need.
    """
    start, next_report, done = None, 0, 0
    of, bus = None, np.zeros(0, dtype=np.intp)
    for item in stream.parts():
        if isinstance(item, FrameSlice):
            block = item.block
            if block is not of:
                of, bus = block, np.array([stream.buses.get(name, 0) for name in block.channels], np.intp)
            yield from core.on_frames(block, item.start, item.stop, bus)
            time_s, done = float(block.time_s[item.stop - 1]), done + item.stop - item.start
        else:
            time_s, done = item.time_s, done + 1
            if isinstance(item, Sentence):
                yield from core.on_sentence(time_s, item.line)
            elif not (item.is_error or item.is_remote):
                number = stream.buses.get(item.channel, 0)
                identifier, extended = item.arbitration_id, item.is_extended
                yield from core.on_frame(time_s, identifier, extended, item.data, number)
        if done >= next_report:
            start, next_report = time_s if start is None else start, done + PROGRESS_EVERY
            progress(time_s - start)
    yield from core.finish()
    counts = core.decoder.counts
    if counts["frames"] == counts["ignored"]:
        # A drive in which no wheel ever turned up is the wrong DBC or the wrong log, not a quiet drive.
        raise InputError(
            stream.can_log,
            f"none of its {counts['frames']} frames has an identifier that the configured signals need "
            "(wrong DBC or log?)",
        )
    for source, first in stream.first_bad.items():
        count = stream.counts[f"{source} bad lines"]
        note(f"{counted(count, 'bad line')} skipped, first {first}")


def read_ticks(
    recording: DriveReader,
    config: Config,
    rate_hz: float = DESK_RATE_HZ,
    progress: Progress = ignore_progress,
    note: Note = ignore_note,
) -> list[Tick]:
    """Return all ticks of a drive, made by the daemon's own core without an estimator."""
    stream, database = recording.open(config, note)
    with no_collection():
        return list(play(stream, BlockSource(TickSource(config, database, rate_hz)), progress, note))


def _align_clocks(stream: FolderStream, config: Config, decoder: CanDecoder, note: Note) -> None:
    """Shift plain NMEA lines, whose UTC is their only clock, onto the host clock of the CAN log."""
    again = FolderStream(stream.folder)
    again.channel = stream.channel
    found = clock_offset(again, decoder, config.vehicle.wheel_radius_m[2])
    if found is not None and found.trusted:
        stream.gnss_offset_s = found.offset_s
        shown = f"shifted by {found.offset_s:+.2f} s to fit the wheels (correlation {found.correlation:.3f})"
    else:
        shown = "taken as the host clock, for the speeds do not tell its offset"
    note(f"{stream.nmea_log}: lines bear no host time; their UTC is {shown}")
