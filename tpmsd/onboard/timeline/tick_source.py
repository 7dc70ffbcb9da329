"""Stamped inputs in, ticks out: decoder, assembler and timeline of one car, strung together.

In: CAN frames and NMEA lines in the order of their host time stamps, and the passing of time. Out: `Tick`s.
No I/O, no clock: daemon, replay, calibration and diagnosis all see a drive through this.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Protocol

from cantools.database import Database

from tpmsd.car.config.gnss_source import source_of
from tpmsd.car.config.model import GNSS_ROLES, Config
from tpmsd.onboard.sources.can.decoder import CanDecoder
from tpmsd.onboard.sources.can.signal_plan import signal_steps
from tpmsd.onboard.sources.events import Event, InertialSample
from tpmsd.onboard.sources.gnss.nmea_epoch import NmeaAssembler
from tpmsd.onboard.sources.gnss.on_can import CanFixAssembler
from tpmsd.onboard.timeline.tick import Tick
from tpmsd.onboard.timeline.timeline import TickPlanner, Timeline


class LookAhead(TickPlanner, Protocol):
    """Decodes frames of a block before their time has come, and plans the ticks that they make."""

    def continues_at(self, time_s: float) -> bool:
        """Return whether frames are decoded ahead of a host time, so that no message can be overdue then; the
        look-ahead ends where the time lies behind the next frame."""
        ...

    def end_look_ahead(self) -> None:
        """Bring the decoder into the state after the frames played so far, dropping those decoded ahead."""
        ...


class TickSource:
    """Decoder, assembler of fixes and timeline of one car: inputs in, ticks out."""

    def __init__(self, config: Config, database: Database, rate_hz: float | None = None) -> None:
        """`rate_hz`: ticks per second instead of the configured ones."""
        self.decoder = CanDecoder(config, database)
        source = source_of(config.gnss)
        self._on_bus: CanFixAssembler | None = None
        if source is not None and source.kind == "can":
            self._on_bus = CanFixAssembler(config.can.signals, signal_steps(config, database))
        self.assembler: NmeaAssembler | CanFixAssembler = self._on_bus or NmeaAssembler()
        """Maker of fixes, of sentences or of signals."""
        on_utc = config.gnss.host_clock == "utc"
        self.timeline = Timeline(rate_hz or config.filter.rate_hz, config.gnss.latency_s, on_utc)
        self._look_ahead: LookAhead | None = None

    def use_look_ahead(self, look_ahead: LookAhead) -> None:
        """Set the source that decodes frames ahead of time and plans ticks; a live run has none."""
        self._look_ahead = look_ahead
        self.timeline.set_planner(look_ahead)

    @property
    def may_look_ahead(self) -> bool:
        """True if frames may be decoded ahead of time: fixes are not made of them, the first event has come,
        and the wheels roll or stand together."""
        decoder = self.decoder
        return (
            self._on_bus is None
            and self.timeline.due_s > -math.inf
            and (decoder.all_rolling or decoder.all_at_rest)
        )

    def on_frame(
        self, time_s: float, arbitration_id: int, is_extended: bool, data: bytes, bus: int = 0
    ) -> list[Tick]:
        """Process one CAN data frame; return the ticks that it completes. `bus` as in `CanDecoder.decode`."""
        # Most frames of a bus carry nothing and meet nothing that is due: as below, only quicker.
        if self.decoder.ignores(arbitration_id, is_extended, bus) and self.pass_empty_frames((time_s,)):
            return []
        ticks = self.advance(time_s)
        add = self.timeline.add
        for event in self.decoder.decode(time_s, arbitration_id, is_extended, data, bus):
            if isinstance(event, InertialSample) and event.role in GNSS_ROLES:
                if self._on_bus is not None:
                    ticks += self._add_events(self._on_bus.take(event))
                continue
            ticks += add(event)
        return ticks

    def pass_empty_frames(self, times_s: Iterable[float]) -> int:
        """Advance time over frames that carry nothing, up to the first at which something is due; return
        their number."""
        decoder, advance, deadline_s = (
            self.decoder,
            self.timeline.advance_if_nothing_due,
            self.assembler.deadline_s,
        )
        frames = 0
        for time_s in times_s:
            if not (time_s <= deadline_s and decoder.none_overdue(time_s) and advance(time_s)):
                break
            frames += 1
        decoder.count_ignored(frames)
        return frames

    def on_sentence(self, time_s: float, line: bytes) -> list[Tick]:
        """Process one NMEA line; return the ticks that it completes. Where the receiver is on the bus, only
        its time counts."""
        ticks = self.advance(time_s)
        if isinstance(self.assembler, NmeaAssembler):
            ticks += self._add_events(self.assembler.feed(time_s, line))
        return ticks

    def on_event(self, event: Event) -> list[Tick]:
        """Process a source's own event (interface down, receiver unplugged); return the ticks that it
        completes."""
        return self._add_events([event])

    def advance(self, time_s: float) -> list[Tick]:
        """Advance to a host time: close epochs, find overdue messages; return the ticks that are complete by
        then."""
        # Ticks that were due while the receiver's epoch was still open come before its fix, whether or not
        # the time was stated in between: else a run with more of such statements would make other ticks.
        timeline, ticks = self.timeline, []
        steps = timeline.counts["clock_steps"]
        deadline_s = self.assembler.deadline_s
        if deadline_s < time_s:
            ticks = timeline.advance(deadline_s) + self._add_events(self.assembler.advance(time_s))
        covered = self._look_ahead is not None and self._look_ahead.continues_at(time_s)
        if not covered and (overdue := self.decoder.poll(time_s)):
            ticks += self._add_events(overdue)
        ticks += timeline.advance(time_s)
        if timeline.counts["clock_steps"] != steps:
            if self._look_ahead is not None:
                self._look_ahead.end_look_ahead()
            # A message by itself would need a second of late frames to tell a step from a late frame.
            self.decoder.note_clock_step()
        return ticks

    def finish(self) -> list[Tick]:
        """Return the ticks that the end of a recording completes."""
        return self._add_events(self.assembler.flush()) + self.timeline.finish()

    def _add_events(self, events: Iterable[Event]) -> list[Tick]:
        """Add events to the timeline; return the ticks that they complete."""
        ticks: list[Tick] = []
        for event in events:
            ticks += self.timeline.add(event)
        return ticks
