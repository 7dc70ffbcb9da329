"""A recorded drive as one stream.

In: a drive folder (docs/reference/formats.md). Out: stamped CAN frames and NMEA lines in the order in which
they came.

Both files bear the same host clock, but it may step back within a recording. At a backward step in one file
the other is played until it steps too, so that the second half of one is not played against the first of the
other; a step that shows in one file alone (the other was silent, or is too slow to show it) holds neither up.
A single stamp that leaps away and back is a damaged line and is left out.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tpmsd.foundation.errors import InputError
from tpmsd.onboard.sources.can.block import FrameBlock, float_sequence
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.can.log import find_can_log, read_can_blocks
from tpmsd.onboard.sources.gnss.leaps import BACKWARD_STEP_S, LeapWatch
from tpmsd.onboard.sources.gnss.nmea_log import bears_host_times, read_nmea_log

PATIENCE_S = {"can": 10.0, "gnss": 0.5}
"""Time by which a file is played past a step of the other file before it is taken not to show that step, s.

Sentences come once a second or less often, so the frames may run on for long before they come to a step that
the sentences showed first."""


NMEA_LOGS = ("gnss.nmea", "gnss.nmea.gz")
"""The receiver's log in a drive folder."""


def find_nmea_log(folder: Path) -> Path | None:
    """Return the path of the receiver's log in a drive folder, None if it has none; InputError where it is no
    file."""
    there = [path for name in NMEA_LOGS if (path := folder / name).exists() or path.is_symlink()]
    found = next((path for path in there if path.is_file()), None)
    if there and found is None:
        raise InputError(there[0], "not a file")
    return found


class Sentence(NamedTuple):
    """One NMEA line and when it came."""

    time_s: float
    line: bytes
    number: int


class FrameSlice(NamedTuple):
    """The frames `start` to before `stop` of a block."""

    block: FrameBlock
    start: int
    stop: int


class FolderStream:
    """The recording in a folder; iterate it once."""

    def __init__(self, folder: Path) -> None:
        """InputError if the folder holds no CAN log; a missing gnss.nmea is a drive without a receiver."""
        self.folder = folder
        self.can_log = find_can_log(folder)
        self.nmea_log = find_nmea_log(folder)
        self.host_times = self.nmea_log is None or bears_host_times(self.nmea_log)
        """True if the NMEA lines bear the host clock; else their UTC needs `gnss_offset_s`."""
        self.gnss_offset_s = 0.0
        """Added to the time of every NMEA line; see `plain_nmea.clock_offset`."""
        self.channel: str | None = None
        """Frames of other channels are left out; None takes all. See `channels.choose_channel`."""
        self.buses: dict[str, int] = {}
        """Channel -> number of the bus, as `CanDecoder.decode` has it; 0 for those that are not here."""
        self.counts: Counter[str] = Counter()
        self.first_bad: dict[str, str] = {}

    def __iter__(self) -> Iterator[CanFrame | Sentence]:
        """Yield frames and sentences, oldest first."""
        for part in self.parts():
            if isinstance(part, FrameSlice):
                yield from part.block.frames(part.start, part.stop)
            else:
                yield part

    def parts(self) -> Iterator[FrameSlice | Sentence]:
        """Yield sentences and runs of frames in the order of their play; frames between two sentences come
        together."""
        can, gnss = _FrameStream(self._undamaged_frames()), _SentenceStream(self._undamaged_sentences())
        while can.head_s is not None or gnss.head_s is not None:
            stream = _next_stream(can, gnss)
            steps = stream.steps
            # As a rule hundreds of frames stand before the next sentence, and none of them needs a decision.
            yield from stream.up_to(_limit_s(stream, can, gnss))
            if stream.steps != steps:
                self.counts[f"{stream.source} clock steps"] += 1

    def _channel_blocks(self) -> Iterator[FrameBlock]:
        """Yield the log's frames on the chosen channel, or all of them if none was chosen."""
        for block in read_can_blocks(self.can_log, self._count_bad_lines("can", self.can_log)):
            if self.channel is None:
                yield block
            elif self.channel in block.channels:
                mine = block.channel == block.channels.index(self.channel)
                if mine.all():
                    yield block
                elif mine.any():
                    yield block.select(mine)

    def _undamaged_frames(self) -> Iterator[FrameBlock]:
        """Yield the blocks without frames whose stamps leap; most have none and need no look at each
        frame."""
        watch = LeapWatch[FrameBlock]()
        for block in self._channel_blocks():
            frame_index = 0
            while frame_index < len(block):
                stop = watch.take_regular(block.time_s, frame_index)
                if stop > frame_index:
                    yield (
                        block if stop - frame_index == len(block) else block.select(slice(frame_index, stop))
                    )
                    frame_index = stop
                    continue
                yield from watch.take(
                    float(block.time_s[frame_index]), block.select(slice(frame_index, frame_index + 1))
                )
                frame_index += 1
        yield from watch.release_doubted()
        self._count_damaged("can", watch.damaged)

    def _undamaged_sentences(self) -> Iterator[Sentence]:
        """Yield the sentences without those whose stamps leap away from their neighbours and back."""
        watch = LeapWatch[Sentence]()
        for item in self._sentences():
            yield from watch.take(item.time_s, item)
        yield from watch.release_doubted()
        self._count_damaged("gnss", watch.damaged)

    def _count_damaged(self, source: str, damaged: int) -> None:
        """Add to the count of damaged stamps of a source."""
        if damaged:
            self.counts[f"{source} damaged stamps"] += damaged

    def _sentences(self) -> Iterator[Sentence]:
        """Yield the sentences of the receiver's log, none if there is no log."""
        path = self.nmea_log
        if path is None:
            return
        for time_s, line, number in read_nmea_log(path, self._count_bad_lines("gnss", path)):
            yield Sentence(time_s + self.gnss_offset_s, line, number)

    def _count_bad_lines(self, source: str, path: Path) -> Callable[[int, str], None]:
        """Return a function that counts the bad lines of a file and keeps the first."""

        def note(line: int, reason: str) -> None:
            self.counts[f"{source} bad lines"] += 1
            self.first_bad.setdefault(source, f"{path}:{line}: {reason}")

        return note

    def span_s(self) -> float:
        """Return the duration by the receiver's log, for progress bars; 0 if it is not known cheaply."""
        if self.nmea_log is None:
            return 0.0
        first = last = None
        try:
            for time_s, _, _ in read_nmea_log(self.nmea_log):
                first = time_s if first is None else first
                last = time_s
        except InputError:
            return 0.0
        return 0.0 if first is None or last is None else max(last - first, 0.0)


class _SentenceStream:
    """The receiver's file: when its next sentence came, and where it last stepped back."""

    source = "gnss"

    def __init__(self, items: Iterator[Sentence]) -> None:
        self._items = items
        self._head = next(items, None)
        self.steps = 0
        self.step_from_s = 0.0
        self.step_to_s = 0.0

    @property
    def head_s(self) -> float | None:
        """Time stamp of the next sentence, s; None at the end."""
        return None if self._head is None else self._head.time_s

    def up_to(self, limit_s: float) -> Iterator[Sentence]:
        """Yield the next sentence and those behind it up to a time, but none behind a backward step of the
        clock."""
        item = self._head
        assert item is not None
        before_s = item.time_s
        for following in self._items:
            yield item
            item, time_s = following, following.time_s
            if time_s < before_s - BACKWARD_STEP_S:
                self.steps += 1
                self.step_from_s, self.step_to_s = before_s, time_s
                break
            if time_s > limit_s:
                break
            before_s = time_s
        else:
            yield item
            item = None
        self._head = item


class _FrameStream:
    """The bus's file in the same way, in blocks."""

    source = "can"

    def __init__(self, blocks: Iterator[FrameBlock]) -> None:
        self._channel_blocks = blocks
        self.steps = 0
        self.step_from_s = 0.0
        self.step_to_s = 0.0
        self._load_block(None)

    @property
    def head_s(self) -> float | None:
        """Time stamp of the next frame, s; None at the end."""
        return None if self._block is None else self._time_s[self._at]

    def _load_block(self, before_s: float | None) -> None:
        """Load the next block and find where its stamps step back; `before_s`: the last stamp before it."""
        self._block, self._at = next(self._channel_blocks, None), 0
        self._backward: list[int] = []
        """Indices before which the clock steps back."""
        self._rises = True
        self._time_s: Sequence[float] = ()
        if self._block is not None:
            time_s = self._block.time_s
            self._time_s = float_sequence(time_s)
            before = np.append(time_s[0] if before_s is None else before_s, time_s[:-1])
            self._rises = bool(np.all(time_s[1:] >= before[1:]))
            self._backward += np.flatnonzero(time_s < before - BACKWARD_STEP_S).tolist()

    def up_to(self, limit_s: float) -> Iterator[FrameSlice]:
        """Yield the next frame and those behind it up to a time, but none behind a backward step of the
        clock."""
        last_s = math.nan
        head = 1  # the next is played whatever its time: it has been chosen
        while (block := self._block) is not None:
            start = self._at
            step = next(
                (frame_index for frame_index in self._backward if frame_index >= start + head), len(block)
            )
            stop = min(step, self._first_behind(limit_s, start + head))
            if stop > start:
                yield FrameSlice(block, start, stop)
                last_s = self._time_s[stop - 1]
            self._at, head = stop, 0
            if stop < len(block):
                if stop == step:
                    self.steps += 1
                    self.step_from_s, self.step_to_s = last_s, self._time_s[stop]
                return
            self._load_block(last_s)

    def _first_behind(self, limit_s: float, start: int) -> int:
        """Return the index of the first frame from `start` on that is stamped later than the limit."""
        assert self._block is not None
        if self._rises:
            return max(bisect_right(self._time_s, limit_s), start)
        time_s = self._block.time_s
        late = time_s[start:] > limit_s
        return start + int(np.argmax(late)) if late.any() else len(time_s)


_Stream = _FrameStream | _SentenceStream


def _next_stream(one: _Stream, other: _Stream) -> _Stream:
    """Return the stream whose head is to be played next."""
    if one.head_s is None or other.head_s is None:
        return other if one.head_s is None else one
    if one.steps != other.steps:
        ahead, behind = (one, other) if one.steps > other.steps else (other, one)
        time_s = behind.head_s
        assert time_s is not None
        beyond = time_s > ahead.step_from_s + PATIENCE_S[behind.source]
        if not beyond and abs(time_s - ahead.step_from_s) < abs(time_s - ahead.step_to_s):
            return behind  # it has yet to come to the step
        behind.steps = ahead.steps
    return one if one.head_s <= other.head_s else other


def _limit_s(stream: _Stream, one: _Stream, other: _Stream) -> float:
    """Return the time up to which `_next_stream` would choose this stream again, if no clock steps."""
    waiting = other if stream is one else one
    if waiting.head_s is None:
        return math.inf
    if one.steps != other.steps:
        return -math.inf  # one at a time
    return waiting.head_s if stream is one else math.nextafter(waiting.head_s, -math.inf)
