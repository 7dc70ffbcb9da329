"""A recorded drive as ticks, without an estimator: what the desk commands begin with.

In: a drive folder and its configuration. Out: its `Tick`s, made as the daemon's own core makes them.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from tpmsd.cli.output import Progress
from tpmsd.config.model import Config
from tpmsd.errors import InputError
from tpmsd.sources.can_decoder import CanDecoder, load_database
from tpmsd.sources.can_frame import CanFrame
from tpmsd.sources.drive import Drive
from tpmsd.sources.events import Event
from tpmsd.sources.nmea_epoch import NmeaAssembler
from tpmsd.sources.plain_nmea import clock_offset
from tpmsd.timeline.tick import Tick
from tpmsd.timeline.timeline import Timeline

RATE_HZ = 10.0
"""Fast enough for the motion of a car, and slow enough for the counts of a coarse ring."""


def read_ticks(folder: Path, config: Config, rate_hz: float = RATE_HZ) -> list[Tick]:
    """All ticks of the drive; InputError if there is no such drive or its frames hold no configured
    signal."""
    if not folder.is_dir():
        raise InputError(folder, "not a folder" if folder.exists() else "no such drive folder")
    drive = Drive(folder)
    database = load_database(config.can.dbc)
    if not drive.host_times:
        found = clock_offset(Drive(folder), CanDecoder(config, database), config.vehicle.wheel_radius_m[2])
        if found is not None and found.trusted:
            drive.gnss_offset_s = found.offset_s
    decoder, assembler = CanDecoder(config, database), NmeaAssembler()
    timeline = Timeline(rate_hz, config.gnss.latency_s)
    ticks: list[Tick] = []

    def take(events: Iterable[Event]) -> None:
        for event in events:
            ticks.extend(timeline.add(event))

    start: float | None = None
    with Progress(drive.span_s() if sys.stderr.isatty() else 0.0, folder.name or str(folder)) as progress:
        for number, item in enumerate(drive):
            start = item.time_s if start is None else start
            if isinstance(item, CanFrame) and (item.is_error or item.is_remote):
                continue
            _advance(item.time_s, timeline, assembler, decoder, ticks)
            if isinstance(item, CanFrame):
                take(
                    decoder.decode(item.time_s, item.arbitration_id, item.is_extended, item.data, item.is_fd)
                )
            else:
                take(assembler.feed(item.time_s, item.line))
            if number % 2000 == 0:
                progress.update(item.time_s - start)
    take(assembler.flush())
    ticks.extend(timeline.finish())
    if decoder.counts["frames"] == decoder.counts["ignored"]:
        raise InputError(
            drive.can_log,
            f"none of its {decoder.counts['frames']} frames has an identifier that the configured signals "
            "need (wrong DBC or log?)",
        )
    return ticks


def _advance(
    time_s: float, timeline: Timeline, assembler: NmeaAssembler, decoder: CanDecoder, ticks: list[Tick]
) -> None:
    """Let time pass, in the order in which `Pipeline.advance` does it."""
    deadline_s = assembler.deadline_s
    if deadline_s < time_s:
        ticks.extend(timeline.advance(deadline_s))
    for event in (*assembler.advance(time_s), *decoder.poll(time_s)):
        ticks.extend(timeline.add(event))
    ticks.extend(timeline.advance(time_s))
