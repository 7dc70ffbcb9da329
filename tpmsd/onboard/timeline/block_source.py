"""Ticks of whole logs: blocks of frames in, the ticks that the frames would make one by one out.

In: parts of blocks in the order of the drive, between them whatever else goes into the `TickSource`. Out:
ticks. A stretch of a block in which nothing is odd is decoded at once, ahead of the sentences that stand
between its frames; its samples are handed to the timeline as time comes to them. The rest goes through
`TickSource.on_frame`.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tpmsd.onboard.sources.can_block import FrameBlock
from tpmsd.onboard.sources.can_decoder import CanDecoder
from tpmsd.onboard.sources.events import RotationRun
from tpmsd.onboard.sources.stretch import BlockPlaces, Stretch, foresee
from tpmsd.onboard.timeline.tick import Tick
from tpmsd.onboard.timeline.tick_plan import PlannedTick
from tpmsd.onboard.timeline.tick_source import TickSource
from tpmsd.onboard.timeline.timeline import MAX_PAUSE_S, Timeline

RETRY_FRAMES, MOST_RETRY_FRAMES = 16, 1024
"""Frames that go one by one after an odd one: doubled as long as nothing comes of it."""
FIRST_FRAMES = 1024
"""Frames that are tried at once after odd ones; doubled as long as nothing is odd."""


class _Ahead:
    """A stretch that is being played."""

    def __init__(self, block: FrameBlock, stretch: Stretch, timeline: Timeline) -> None:
        self.block = block
        self.stretch = stretch
        self._timeline, self._shift_s = timeline, timeline.shift_s
        self._plan = timeline.plan(stretch)
        time_s = block.time_s[stretch.start : stretch.stop]
        latest_s = np.maximum.accumulate(time_s)
        interval_s = np.diff(time_s)
        self.flows = bool(np.all((interval_s >= 0.0) & (interval_s <= MAX_PAUSE_S)))
        """Whether no stamp is before the one before it or a pause behind it."""
        # Asked one by one some hundred thousand times: of lists that takes a tenth of the time.
        self._time_s: list[float] = time_s.tolist()
        self._host_s: list[float] = latest_s.tolist()
        """Greatest host time up to each frame."""
        self._now_s: list[float] = (latest_s + self._shift_s).tolist()
        self._given = [0] * len(stretch.groups)
        """Of each group of signals how many frames were handed on."""
        self._shown_s = -math.inf
        """End of the tick before which samples were last handed on."""

    def latest_s(self, place: int) -> float:
        """Greatest host time of the frames before a place, which is not the first."""
        return self._host_s[place - 1 - self.stretch.start]

    def time_s(self, place: int) -> float:
        """Host time of a frame."""
        return self._time_s[place - self.stretch.start]

    def next_due(self, due_s: float, deadline_s: float, start: int, stop: int) -> int:
        """The first frame from `start` on that reaches `due_s` (logical) or passes the deadline (host); at
        most `stop`."""
        origin = self.stretch.start
        place = bisect_left(self._now_s, due_s) + origin
        if deadline_s < math.inf:
            place = min(place, bisect_right(self._host_s, deadline_s) + origin)
        return min(max(place, start), stop)

    def planned_tick(self, index: int, end_s: float, place: int) -> PlannedTick | None:
        """What wheels and readings say in a tick that is about to be made when the frames before a place were
        played; the timeline is given their samples where it needs them."""
        tick = None if self._plan is None else self._plan.tick(index, end_s, place)
        if tick is None:
            self._plan = None  # Late readings go into other ticks than it says.
        timeline = self._timeline
        observed = timeline.observe is not None and end_s >= self._shown_s + timeline.observe_late_s
        if tick is None or observed:
            self._shown_s = end_s
            self.hand_on(place)
        return tick

    def hand_on(self, place: int) -> None:
        """Give the timeline the samples of all frames before a place that it has not got."""
        rows: list[slice] = []
        frames: list[tuple[list[int], list[float]]] = []
        for number, group in enumerate(self.stretch.groups):
            first, last = self._given[number], int(group.places.searchsorted(place))
            here, self._given[number] = slice(first, last), last
            rows.append(here)
            frames.append((group.places[here].tolist(), group.time_s[here].tolist()))
        self._timeline.take(
            [
                RotationRun(
                    *(angles.wheel, angles.segment, angles.quantum_rad, *frames[angles.group]),
                    angles.angle_rad[rows[angles.group]].tolist(),
                )
                for angles in self.stretch.wheels
                if frames[angles.group][0]
            ],
            [
                (values.role, frames[values.group][1], values.value[rows[values.group]].tolist())
                for values in self.stretch.readings
                if frames[values.group][0]
            ],
            self._shift_s,
        )


class BlockSource:
    """A `TickSource` that takes blocks as well."""

    def __init__(self, source: TickSource) -> None:
        self._source = source
        source.ahead = self
        source.timeline.planned_tick = self.planned_tick
        self._block: FrameBlock | None = None
        self._places: BlockPlaces | None = None
        self._bus: NDArray[np.intp] = np.zeros(1, dtype=np.intp)
        self._ahead: _Ahead | None = None
        self._at = 0
        """The next frame of the block that is not yet played."""
        self._retry_at = 0
        self._pause = RETRY_FRAMES
        self._reach = FIRST_FRAMES

    @property
    def decoder(self) -> CanDecoder:
        """Of the `TickSource`."""
        return self._source.decoder

    def on_frame(
        self, time_s: float, arbitration_id: int, is_extended: bool, data: bytes, bus: int = 0
    ) -> list[Tick]:
        """As of a `TickSource`."""
        return self._source.on_frame(time_s, arbitration_id, is_extended, data, bus)

    def on_sentence(self, time_s: float, line: bytes) -> list[Tick]:
        """As of a `TickSource`."""
        return self._source.on_sentence(time_s, line)

    def finish(self) -> list[Tick]:
        """As of a `TickSource`."""
        return self._source.finish()

    def on_frames(self, block: FrameBlock, start: int, stop: int, bus: NDArray[np.intp]) -> Iterator[Tick]:
        """Take the data frames `start` to before `stop` of a block. `bus` (channels,): number of the bus of
        each channel."""
        if block is not self._block:
            self._block, self._bus = block, bus
            self._places = BlockPlaces(self._source.decoder, block, bus)
            self._retry_at = start
        assert self._places is not None
        self._at = start
        while self._at < stop:
            told = self._places.told_until(self._at)
            if told == self._at:  # an error or remote frame
                self._at += 1
                continue
            ahead = self._ahead or self._look_ahead(block, told)
            if ahead is not None:
                yield from self._serve(ahead, min(stop, ahead.stretch.stop))
                continue
            nothing = block.time_s[self._at : min(stop, told, self._places.telling_from(self._at))]
            passed = self._source.pass_by(nothing.tolist()) if len(nothing) else 0
            self._at += passed
            if not passed:
                yield from self._one_by_one(block, min(stop, told, max(self._retry_at, self._at + 1)))

    def planned_tick(self, index: int, end_s: float) -> PlannedTick | None:
        """As the timeline asks."""
        return None if self._ahead is None else self._ahead.planned_tick(index, end_s, self._at)

    def covers(self, time_s: float) -> bool:
        """Whether the decoder is ahead of a host time, so that no message can be overdue then."""
        if self._ahead is not None and not time_s <= self._ahead.time_s(self._at):
            self.leave()
        return self._ahead is not None

    def leave(self) -> None:
        """Make the decoder one that has taken the frames that were played, and none of those foreseen."""
        ahead, self._ahead = self._ahead, None
        if ahead is not None:
            ahead.hand_on(self._at)
            decoder, start = self._source.decoder, ahead.stretch.start
            for place, frame in enumerate(ahead.block.frames(start, self._at), start):
                bus = int(self._bus[ahead.block.channel[place]])
                # What they hold was handed on already.
                decoder.decode(frame.time_s, frame.arbitration_id, frame.is_extended, frame.data, bus)

    def _one_by_one(self, block: FrameBlock, stop: int) -> Iterator[Tick]:
        source, first = self._source, self._at
        # As a rule it is one: frames between it and the next carry nothing.
        frames = (block.frame(first),) if stop == first + 1 else block.frames(first, stop)
        for place, frame in enumerate(frames, first):
            time_s, _, identifier, is_extended, _, _, _, data, _ = frame
            self._at = place + 1
            bus = int(self._bus[block.channel[place]])
            yield from source.on_frame(time_s, identifier, is_extended, data, bus)

    def _look_ahead(self, block: FrameBlock, told: int) -> _Ahead | None:
        """A stretch that begins with the next frame and ends before `told`, if it is time to try and there is
        one."""
        source, start = self._source, self._at
        if start < self._retry_at or not source.may_look_ahead:
            return None
        assert self._places is not None
        stop = min(told, start + self._reach)
        stretch = foresee(source.decoder, self._places, start, stop)
        if stretch is None:
            self._retry_at = start + self._pause
            self._pause, self._reach = min(2 * self._pause, MOST_RETRY_FRAMES), FIRST_FRAMES
            return None
        self._pause = RETRY_FRAMES
        if stretch.stop < stop:
            self._reach, self._retry_at = FIRST_FRAMES, stretch.stop + RETRY_FRAMES
        else:
            self._reach *= 2
        self._ahead = _Ahead(block, stretch, source.timeline)
        return self._ahead

    def _serve(self, ahead: _Ahead, stop: int) -> Iterator[Tick]:
        """The samples up to a frame, and the ticks that its stamps complete."""
        source, timeline = self._source, self._source.timeline
        flows = ahead.flows and timeline.goes_on(ahead.time_s(self._at))
        if not flows and not timeline.is_even(ahead.block.time_s[self._at : stop]):
            self.leave()
            self._retry_at = stop
            return
        while self._at < stop:
            due_s, deadline_s = timeline.due_s, source.assembler.deadline_s
            place = ahead.next_due(due_s, deadline_s, self._at, stop)
            if place > self._at:
                timeline.pass_to(ahead.latest_s(place))
                self._at = place
            if place == stop:
                break
            # Something is due with this very frame: as in `TickSource.on_frame`.
            ticks = source.advance(ahead.time_s(place))
            if self._ahead is None:
                # The clock stepped, and the decoder had to be told: this frame goes through it.
                self._retry_at = stop
                yield from ticks
                return
            self._at = place + 1
            yield from ticks
        if stop == ahead.stretch.stop:
            ahead.hand_on(stop)
            ahead.stretch.settle()
            self._ahead = None
