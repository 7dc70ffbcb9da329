"""Ticks of whole logs: blocks of frames in, the ticks that the frames would make one by one out.

In: parts of blocks in the order of the drive, between them whatever else goes into the `TickSource`. Out:
ticks. A range of regular frames is decoded at once, ahead of the sentences that stand between its frames; its
samples are handed to the timeline as time comes to them. The rest goes through `TickSource.on_frame`.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tpmsd.onboard.sources.ahead.decoded_block import BlockFrames, DecodedBlock, decode_block
from tpmsd.onboard.sources.can.block import FrameBlock, float_sequence
from tpmsd.onboard.sources.can.decoder import CanDecoder
from tpmsd.onboard.sources.events import RotationRun
from tpmsd.onboard.timeline.tick import Tick
from tpmsd.onboard.timeline.tick_plan import TickReadings
from tpmsd.onboard.timeline.tick_source import TickSource
from tpmsd.onboard.timeline.timeline import MAX_PAUSE_S, Timeline

RETRY_FRAMES, MAX_RETRY_FRAMES = 16, 1024
"""Frames that go one by one after an irregular one: doubled as long as no range can be decoded."""
FIRST_FRAMES = 1024
"""Frames that are tried at once after irregular ones; doubled as long as all are regular."""


class _Playback:
    """A decoded block while its frames reach the timeline in the order of time."""

    def __init__(self, block: FrameBlock, decoded: DecodedBlock, timeline: Timeline) -> None:
        self.block = block
        self.decoded = decoded
        self._timeline, self._shift_s = timeline, timeline.shift_s
        self._plan = timeline.plan(decoded)
        time_s = block.time_s[decoded.start : decoded.stop]
        latest_s = np.maximum.accumulate(time_s)
        interval_s = np.diff(time_s)
        self.flows = bool(np.all((interval_s >= 0.0) & (interval_s <= MAX_PAUSE_S)))
        """True if no stamp is before the one before it or a pause behind it."""
        # As a rule all three are the same.
        self._time_s = float_sequence(time_s)
        self._host_s = self._time_s if self.flows else float_sequence(latest_s)
        """Greatest host time up to each frame."""
        self._now_s = float_sequence(latest_s + self._shift_s) if self._shift_s else self._host_s
        """These as logical times."""
        self._given = [0] * len(decoded.groups)
        """Number of frames of each group of signals that were handed on."""
        self._shown_s = -math.inf
        """End of the tick before which samples were last handed on."""

    def latest_s(self, frame_index: int) -> float:
        """Return the greatest host time of the frames before this one, which is not the first."""
        return self._host_s[frame_index - 1 - self.decoded.start]

    def time_s(self, frame_index: int) -> float:
        """Return the host time of a frame."""
        return self._time_s[frame_index - self.decoded.start]

    def next_due_frame(self, due_s: float, deadline_s: float, start: int, stop: int) -> int:
        """Return the index of the first frame from `start` on at which a tick is due; at most `stop`.

        That is a frame which reaches `due_s` (logical) or passes the deadline (host).
        """
        origin = self.decoded.start
        frame_index = bisect_left(self._now_s, due_s) + origin
        if deadline_s < math.inf:
            frame_index = min(frame_index, bisect_right(self._host_s, deadline_s) + origin)
        return min(max(frame_index, start), stop)

    def planned_tick(self, index: int, end_s: float, frame_index: int) -> TickReadings | None:
        """Return the rotations and readings of a tick that is due, the frames before `frame_index` having
        been played; None where the plan has none. The timeline is given the samples before that frame where
        it needs them."""
        tick = None if self._plan is None else self._plan.tick(index, end_s, frame_index)
        if tick is None:
            self._plan = None  # Late readings go into other ticks than it says.
        timeline = self._timeline
        if tick is None or timeline.observer_needs(end_s, self._shown_s):
            self._shown_s = end_s
            self.hand_on(frame_index)
        return tick

    def hand_on(self, frame_index: int) -> None:
        """Give the timeline the samples of all frames before `frame_index` that it has not got."""
        rows: list[slice] = []
        frames: list[tuple[list[int], list[float]]] = []
        for number, group in enumerate(self.decoded.groups):
            first, last = self._given[number], int(group.indices.searchsorted(frame_index))
            here, self._given[number] = slice(first, last), last
            rows.append(here)
            frames.append((group.indices[here].tolist(), group.time_s[here].tolist()))
        self._timeline.add_samples(
            [
                RotationRun(
                    *(angles.wheel, angles.segment, angles.quantum_rad, *frames[angles.group]),
                    angles.angle_rad[rows[angles.group]].tolist(),
                )
                for angles in self.decoded.wheels
                if frames[angles.group][0]
            ],
            [
                (values.role, frames[values.group][1], values.value[rows[values.group]].tolist())
                for values in self.decoded.readings
                if frames[values.group][0]
            ],
            self._shift_s,
        )


class BlockSource:
    """`TickSource` that takes blocks of frames as well."""

    def __init__(self, source: TickSource) -> None:
        self._source = source
        source.use_look_ahead(self)
        self._block: FrameBlock | None = None
        self._frames: BlockFrames | None = None
        self._bus: NDArray[np.intp] = np.zeros(1, dtype=np.intp)
        self._playback: _Playback | None = None
        self._at = 0
        """The next frame of the block that is not yet played."""
        self._retry_at = 0
        self._pause = RETRY_FRAMES
        self._reach = FIRST_FRAMES
        self.ended: Counter[str] = Counter()
        """Number of ranges of regular frames that each reason (`Reason`) ended."""

    @property
    def decoder(self) -> CanDecoder:
        """Decoder of the `TickSource`."""
        return self._source.decoder

    def on_frame(
        self, time_s: float, arbitration_id: int, is_extended: bool, data: bytes, bus: int = 0
    ) -> list[Tick]:
        """Process a frame as `TickSource.on_frame` does."""
        return self._source.on_frame(time_s, arbitration_id, is_extended, data, bus)

    def on_sentence(self, time_s: float, line: bytes) -> list[Tick]:
        """Process a sentence as `TickSource.on_sentence` does."""
        return self._source.on_sentence(time_s, line)

    def finish(self) -> list[Tick]:
        """End the recording as `TickSource.finish` does."""
        return self._source.finish()

    def on_frames(self, block: FrameBlock, start: int, stop: int, bus: NDArray[np.intp]) -> Iterator[Tick]:
        """Process the data frames `start` to before `stop` of a block; yield the ticks that they complete.
        `bus` (channels,): number of the bus of each channel."""
        if block is not self._block:
            self._block, self._bus = block, bus
            self._frames = BlockFrames(self._source.decoder, block, bus)
            self._retry_at = start
        assert self._frames is not None
        self._at = start
        while self._at < stop:
            with_data = self._frames.next_without_data(self._at)
            if with_data == self._at:  # an error or remote frame
                self._at += 1
                continue
            playback = self._playback or self._look_ahead(block, with_data)
            if playback is not None:
                yield from self._play(playback, min(stop, playback.decoded.stop))
                continue
            nothing = block.time_s[self._at : min(stop, with_data, self._frames.next_relevant(self._at))]
            passed = self._source.pass_empty_frames(nothing.tolist()) if len(nothing) else 0
            self._at += passed
            if not passed:
                yield from self._play_one_by_one(
                    block, min(stop, with_data, max(self._retry_at, self._at + 1))
                )

    def planned_tick(self, index: int, end_s: float) -> TickReadings | None:
        """Return the planned tick of this index and end; None if no block is being played or its plan has
        none."""
        return None if self._playback is None else self._playback.planned_tick(index, end_s, self._at)

    def continues_at(self, time_s: float) -> bool:
        """Return whether frames are decoded ahead of a host time, so that no message can be overdue then; the
        look-ahead ends where the time lies behind the next frame."""
        if self._playback is not None and not time_s <= self._playback.time_s(self._at):
            self.end_look_ahead()
        return self._playback is not None

    def end_look_ahead(self) -> None:
        """Bring the decoder into the state after the frames played so far, dropping those decoded ahead."""
        playback, self._playback = self._playback, None
        if playback is not None:
            playback.hand_on(self._at)
            decoder, start = self._source.decoder, playback.decoded.start
            for frame_index, frame in enumerate(playback.block.frames(start, self._at), start):
                bus = int(self._bus[playback.block.channel[frame_index]])
                # What they hold was handed on already.
                decoder.decode(frame.time_s, frame.arbitration_id, frame.is_extended, frame.data, bus)

    def _play_one_by_one(self, block: FrameBlock, stop: int) -> Iterator[Tick]:
        """Process the frames up to `stop` by `TickSource.on_frame`; yield the ticks that they complete."""
        source, first = self._source, self._at
        # As a rule it is one: frames between it and the next carry nothing.
        frames = (block.frame(first),) if stop == first + 1 else block.frames(first, stop)
        for frame_index, frame in enumerate(frames, first):
            time_s, _, identifier, is_extended, _, _, _, data, _ = frame
            self._at = frame_index + 1
            bus = int(self._bus[block.channel[frame_index]])
            yield from source.on_frame(time_s, identifier, is_extended, data, bus)

    def _look_ahead(self, block: FrameBlock, with_data: int) -> _Playback | None:
        """Return the playback of a range decoded from the next frame on, to before `with_data`; None where
        none can be decoded or it is too early to try again."""
        source, start = self._source, self._at
        if start < self._retry_at or not source.may_look_ahead:
            return None
        assert self._frames is not None
        stop = min(with_data, start + self._reach)
        decoded, reason = decode_block(source.decoder, self._frames, start, stop)
        if reason is not None:
            self.ended[reason] += 1
        if decoded is None:
            self._retry_at = start + self._pause
            self._pause, self._reach = min(2 * self._pause, MAX_RETRY_FRAMES), FIRST_FRAMES
            return None
        self._pause = RETRY_FRAMES
        if decoded.stop < stop:
            self._reach, self._retry_at = FIRST_FRAMES, decoded.stop + RETRY_FRAMES
        else:
            self._reach *= 2
        self._playback = _Playback(block, decoded, source.timeline)
        return self._playback

    def _play(self, playback: _Playback, stop: int) -> Iterator[Tick]:
        """Play a decoded block up to the frame `stop`; yield the ticks that its stamps complete."""
        source, timeline = self._source, self._source.timeline
        flows = playback.flows and timeline.follows_without_pause(playback.time_s(self._at))
        if not flows and not timeline.is_continuous(playback.block.time_s[self._at : stop]):
            self.end_look_ahead()
            self._retry_at = stop
            return
        while self._at < stop:
            due_s, deadline_s = timeline.due_s, source.assembler.deadline_s
            frame_index = playback.next_due_frame(due_s, deadline_s, self._at, stop)
            if frame_index > self._at:
                timeline.advance_clock(playback.latest_s(frame_index))
                self._at = frame_index
            if frame_index == stop:
                break
            # Something is due with this very frame: as in `TickSource.on_frame`.
            ticks = source.advance(playback.time_s(frame_index))
            if self._playback is None:
                # The clock stepped, which the decoder has to know: this frame goes through it.
                self._retry_at = stop
                yield from ticks
                return
            self._at = frame_index + 1
            yield from ticks
        if stop == playback.decoded.stop:
            playback.hand_on(stop)
            playback.decoded.commit()
            self._playback = None
