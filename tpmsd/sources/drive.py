"""A recorded drive as one stream.

In: a drive folder (CONTRACT section 1). Out: stamped CAN frames and NMEA lines in the order in which they
came.

Both files bear the same host clock, but it may step back within a recording. At a backward step in one file
the other is played until it steps too, so that the second half of one is not played against the first of the
other; a step that shows in one file alone (the other was silent, or is too slow to show it) holds neither up.
A single stamp that leaps away and back is a damaged line and is left out.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple, TypeVar

from tpmsd.errors import InputError
from tpmsd.sources.can_frame import CanFrame
from tpmsd.sources.can_log import find_can_log, read_can_log
from tpmsd.sources.nmea_log import bears_host_times, read_nmea_log

BACKWARD_STEP_S = 0.5
LEAP_S = 2.0
"""Up to `MAX_DAMAGED` stamps that leap this far from the last good one are damaged if the next follows it."""
MAX_DAMAGED = 4
PATIENCE_S = {"can": 10.0, "gnss": 0.5}
"""How far past a step of the other file a file is played before it is taken not to show that step.

Sentences come once a second or less often, so the frames may run on for long before they come to a step that
the sentences showed first."""


class Sentence(NamedTuple):
    """One NMEA line and when it came."""

    time_s: float
    line: bytes
    number: int


Item = TypeVar("Item", CanFrame, Sentence)


class Drive:
    """The recording in a folder; iterate it once."""

    def __init__(self, folder: Path) -> None:
        """InputError if the folder holds no CAN log; a missing gnss.nmea is a drive without a receiver."""
        self.folder = folder
        self.can_log = find_can_log(folder)
        self.nmea_log = next(
            (p for p in (folder / "gnss.nmea", folder / "gnss.nmea.gz") if p.is_file()), None
        )
        self.host_times = self.nmea_log is None or bears_host_times(self.nmea_log)
        """Whether the NMEA lines bear the host clock; else their UTC needs `gnss_offset_s`."""
        self.gnss_offset_s = 0.0
        """Added to the time of every NMEA line; see `plain_nmea.clock_offset`."""
        self.channel: str | None = None
        """Frames of other channels are left out; None takes all. See `can_channels.choose_channel`."""
        self.buses: dict[str, int] = {}
        """Channel -> number of the bus, as `CanDecoder.decode` has it; 0 for those that are not here."""
        self.counts: Counter[str] = Counter()
        self.first_bad: dict[str, str] = {}

    def __iter__(self) -> Iterator[CanFrame | Sentence]:
        """Frames and sentences, oldest first."""
        can = _Stream("can", self._undamaged(self._frames(), "can"))
        gnss = _Stream("gnss", self._undamaged(self._sentences(), "gnss"))
        while can.head is not None or gnss.head is not None:
            stream = _next(can, gnss)
            steps = stream.steps
            # As a rule hundreds of frames stand before the next sentence, and none of them needs a decision.
            yield from stream.up_to(_limit_s(stream, can, gnss))
            if stream.steps != steps:
                self.counts[f"{stream.source} clock steps"] += 1

    def _frames(self) -> Iterator[CanFrame]:
        frames = read_can_log(self.can_log, self._noting("can", self.can_log))
        if self.channel is None:
            return frames
        return (frame for frame in frames if frame.channel == self.channel)

    def _sentences(self) -> Iterator[Sentence]:
        path = self.nmea_log
        if path is None:
            return
        for time_s, line, number in read_nmea_log(path, self._noting("gnss", path)):
            yield Sentence(time_s + self.gnss_offset_s, line, number)

    def _noting(self, source: str, path: Path) -> Callable[[int, str], None]:
        def note(line: int, reason: str) -> None:
            self.counts[f"{source} bad lines"] += 1
            self.first_bad.setdefault(source, f"{path}:{line}: {reason}")

        return note

    def _undamaged(self, items: Iterable[Item], source: str) -> Iterator[Item]:
        """The items without those whose stamps leap away from their neighbours and back."""
        before: float | None = None
        doubted: list[Item] = []
        for item in items:
            if before is not None and not doubted and abs(item.time_s - before) <= LEAP_S:
                yield item
                before = item.time_s
                continue
            if before is None:
                # The first of a file has no neighbour but the one behind it.
                if doubted and abs(item.time_s - doubted[0].time_s) <= LEAP_S:
                    yield doubted.pop()
                    before = item.time_s
                    yield item
                elif doubted:
                    self.counts[f"{source} damaged stamps"] += 1
                    doubted = [item]
                else:
                    doubted.append(item)
                continue
            if doubted and _follows(before, item.time_s) and not _follows(doubted[-1].time_s, item.time_s):
                self.counts[f"{source} damaged stamps"] += len(doubted)
                doubted.clear()
                yield item
                before = item.time_s
                continue
            doubted.append(item)
            if len(doubted) > MAX_DAMAGED:
                yield from doubted
                before = item.time_s
                doubted.clear()
        yield from doubted

    def span_s(self) -> float:
        """Duration by the receiver's log, for progress bars; 0 if it is not known cheaply."""
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


def _follows(before_s: float, time_s: float) -> bool:
    """Whether a stamp goes on from another."""
    return -BACKWARD_STEP_S <= time_s - before_s <= LEAP_S


class _Stream:
    """One file: its next item, and where it last stepped back."""

    def __init__(self, source: str, items: Iterator[CanFrame] | Iterator[Sentence]) -> None:
        self.source = source
        self._items = items
        self.head: CanFrame | Sentence | None = next(items, None)
        self.steps = 0
        self.step_from_s = 0.0
        self.step_to_s = 0.0

    def up_to(self, limit_s: float) -> Iterator[CanFrame | Sentence]:
        """The next item and those behind it up to a time, but none behind a backward step of the clock."""
        item = self.head
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
        self.head = item


def _next(one: _Stream, other: _Stream) -> _Stream:
    """The stream whose head is to be played next."""
    if one.head is None or other.head is None:
        return other if one.head is None else one
    if one.steps != other.steps:
        ahead, behind = (one, other) if one.steps > other.steps else (other, one)
        assert behind.head is not None
        time_s = behind.head.time_s
        beyond = time_s > ahead.step_from_s + PATIENCE_S[behind.source]
        if not beyond and abs(time_s - ahead.step_from_s) < abs(time_s - ahead.step_to_s):
            return behind  # it has yet to come to the step
        behind.steps = ahead.steps
    return one if one.head.time_s <= other.head.time_s else other


def _limit_s(stream: _Stream, one: _Stream, other: _Stream) -> float:
    """Up to when `_next` would choose this stream again, as long as it does not step."""
    rival = other if stream is one else one
    if rival.head is None:
        return math.inf
    if one.steps != other.steps:
        return -math.inf  # one at a time
    return rival.head.time_s if stream is one else math.nextafter(rival.head.time_s, -math.inf)
