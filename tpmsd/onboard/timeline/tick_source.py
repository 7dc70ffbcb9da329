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

    def covers(self, time_s: float) -> bool:
        """Return whether the decoder is ahead of a host time, so that no message can be overdue then."""
        ...

    def leave(self) -> None:
        """Make the decoder one that has taken the frames that were played, and no more."""
        ...


class TickSource:
    """Everything left of the estimator."""

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

    def follow(self, look_ahead: LookAhead) -> None:
        """Let `look_ahead` decode frames before their time; a live run has none."""
        self._look_ahead = look_ahead
        self.timeline.plan_with(look_ahead)

    @property
    def may_look_ahead(self) -> bool:
        """True if nothing stands against decoding frames before their time: fixes are not made of them, there
        is a time, and the wheels roll or stand together."""
        decoder = self.decoder
        return self._on_bus is None and self.timeline.due_s > -math.inf and (decoder.rolls or decoder.rests)

    def on_frame(
        self, time_s: float, arbitration_id: int, is_extended: bool, data: bytes, bus: int = 0
    ) -> list[Tick]:
        """Take one CAN data frame; `bus` as in `CanDecoder.decode`."""
        # Most frames of a bus carry nothing and meet nothing that is due: as below, only quicker.
        if self.decoder.ignores(arbitration_id, is_extended, bus) and self.pass_by((time_s,)):
            return []
        ticks = self.advance(time_s)
        add = self.timeline.add
        for event in self.decoder.decode(time_s, arbitration_id, is_extended, data, bus):
            if isinstance(event, InertialSample) and event.role in GNSS_ROLES:
                if self._on_bus is not None:
                    ticks += self._take(self._on_bus.take(event))
                continue
            ticks += add(event)
        return ticks

    def pass_by(self, times_s: Iterable[float]) -> int:
        """Take frames that carry nothing, up to the first that meets something due; return their number."""
        decoder, pass_by, deadline_s = self.decoder, self.timeline.pass_by, self.assembler.deadline_s
        frames = 0
        for time_s in times_s:
            if not (time_s <= deadline_s and decoder.none_overdue(time_s) and pass_by(time_s)):
                break
            frames += 1
        decoder.count_ignored(frames)
        return frames

    def on_sentence(self, time_s: float, line: bytes) -> list[Tick]:
        """Take one NMEA line; it counts for nothing where the receiver is on the bus."""
        ticks = self.advance(time_s)
        if isinstance(self.assembler, NmeaAssembler):
            ticks += self._take(self.assembler.feed(time_s, line))
        return ticks

    def on_event(self, event: Event) -> list[Tick]:
        """Take a source's own event (an interface that went down, a receiver unplugged)."""
        return self._take([event])

    def advance(self, time_s: float) -> list[Tick]:
        """Let time pass: ends epochs, finds time-outs, completes ticks."""
        # Ticks that were due while the receiver's epoch was still open come before its fix, whether or not
        # anybody told the time in between: else a run that is told it more often would make other ticks.
        timeline, ticks = self.timeline, []
        steps = timeline.counts["clock_steps"]
        deadline_s = self.assembler.deadline_s
        if deadline_s < time_s:
            ticks = timeline.advance(deadline_s) + self._take(self.assembler.advance(time_s))
        covered = self._look_ahead is not None and self._look_ahead.covers(time_s)
        if not covered and (overdue := self.decoder.poll(time_s)):
            ticks += self._take(overdue)
        ticks += timeline.advance(time_s)
        if timeline.counts["clock_steps"] != steps:
            if self._look_ahead is not None:
                self._look_ahead.leave()
            # A message by itself would need a second of late frames to tell a step from a late frame.
            self.decoder.clock_stepped()
        return ticks

    def finish(self) -> list[Tick]:
        """Return the ticks that the end of a recording completes."""
        return self._take(self.assembler.flush()) + self.timeline.finish()

    def _take(self, events: Iterable[Event]) -> list[Tick]:
        ticks: list[Tick] = []
        for event in events:
            ticks += self.timeline.add(event)
        return ticks
