"""Puts inputs into the order of their stamps before the pipeline sees them.

In: CAN frames and NMEA sentences as they are read, each with its stamp. Out: the same, oldest first, once
nothing older can be expected. So the pipeline is fed live just as a replay of the recording feeds it.

The two streams reach the process on different ways (a frame is stamped by the kernel, and may wait there
for a busy loop), so the order of reading is not the order of stamps. Memory is bounded: beyond the
capacity the oldest are dropped and counted.
"""

from __future__ import annotations

import heapq
import math
from collections import Counter
from collections.abc import Iterator

from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.drive import Sentence

Input = CanFrame | Sentence

CAPACITY = 50_000
"""Half a minute of a busy bus, about 20 MB; of which in good order some ten are in use."""
STRANGE_S = 60.0
"""A stamp this far from the host's clock is of another clock (adapters that count from their own start)."""
LATE_S = 0.4
"""An input this much behind the others is dropped: half a second would pass for a step of the clock."""

_FRAME, _SENTENCE = 0, 1
"""Order at equal stamps: frames go first, as in the merge of a recording."""


def rounded_stamp_s(stamp_s: float) -> float:
    """Return a stamp rounded to microseconds, as a recording holds it: live and replay compute with
    the same numbers."""
    return round(stamp_s, 6)


class InputQueue:
    """Inputs that wait for those which may still come before them.

    `counts`: `overflow` dropped for want of room, `late` dropped as too old, `bad_stamp` stamped again.
    """

    def __init__(self, capacity: int = CAPACITY) -> None:
        self.counts: Counter[str] = Counter()
        self._capacity = capacity
        self._heap: list[tuple[float, int, int, Input]] = []
        self._number = 0
        self._released_until_s = -math.inf

    def __len__(self) -> int:
        return len(self._heap)

    def put_frame(self, frame: CanFrame, stamp_s: float, now_s: float) -> None:
        """Queue a frame that was stamped at `stamp_s`."""
        if not abs(stamp_s - now_s) <= STRANGE_S:
            self.counts["bad_stamp"] += 1
            stamp_s = now_s
        stamp_s = rounded_stamp_s(stamp_s)
        self._push(stamp_s, _FRAME, frame._replace(time_s=stamp_s))

    def put_sentence(self, line: bytes, stamp_s: float) -> None:
        """Queue a line whose first byte came at `stamp_s`."""
        stamp_s = rounded_stamp_s(stamp_s)
        self._push(stamp_s, _SENTENCE, Sentence(stamp_s, line, 0))

    def release(self, until_s: float) -> Iterator[Input]:
        """Remove and yield the inputs stamped up to `until_s`, oldest first; drop and count those that are
        late."""
        while self._heap and self._heap[0][0] <= until_s:
            stamp_s, _, _, item = heapq.heappop(self._heap)
            if stamp_s < self._released_until_s - LATE_S:
                self.counts["late"] += 1
                continue
            yield item
        self._released_until_s = max(self._released_until_s, until_s)

    def release_at_clock_step(self, now_s: float) -> list[Input]:
        """Return the inputs stamped before a backward step of the host's clock, oldest first, and remove
        them.

        Those stamps lie ahead of the clock as it is now. They go first; what follows is on the new time.
        """
        before = sorted(entry for entry in self._heap if entry[0] > now_s)
        self._heap = [entry for entry in self._heap if entry[0] <= now_s]
        heapq.heapify(self._heap)
        self._released_until_s = -math.inf
        return [entry[3] for entry in before]

    def _push(self, stamp_s: float, kind: int, item: Input) -> None:
        """Add an input; drop the oldest one, counted, beyond the capacity."""
        self._number += 1
        heapq.heappush(self._heap, (stamp_s, kind, self._number, item))
        if len(self._heap) > self._capacity:
            heapq.heappop(self._heap)
            self.counts["overflow"] += 1
