"""A recorded drive as one stream.

In: a drive folder (CONTRACT section 1). Out: stamped CAN frames and NMEA lines in the order in which they
came.

Both files bear the same host clock, but it may step back within a recording. Each file is cut into stretches
at backward steps, and stretches are merged one by one, so that the second half of one file is not played
against the first of the other. A single stamp that leaps away and back is a damaged line and is left out.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple, TypeVar

from tpmsd.errors import InputError
from tpmsd.sources.can_frame import CanFrame
from tpmsd.sources.can_log import find_can_log, read_can_log
from tpmsd.sources.nmea_log import read_nmea_log

BACKWARD_STEP_S = 0.5
LEAP_S = 30.0
"""A stamp this far from both its neighbours, which agree with each other, is damaged."""


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
        self.counts: Counter[str] = Counter()
        self.first_bad: dict[str, str] = {}

    def __iter__(self) -> Iterator[CanFrame | Sentence]:
        """Frames and sentences, oldest first."""
        frames = self._stretches(read_can_log(self.can_log, self._noting("can", self.can_log)), "can")
        streams: list[Iterator[tuple[int, float, CanFrame | Sentence]]] = [frames]
        if self.nmea_log is not None:
            streams.append(self._stretches(self._sentences(self.nmea_log), "gnss"))
        for _, _, item in heapq.merge(*streams, key=lambda entry: entry[:2]):
            yield item

    def _sentences(self, path: Path) -> Iterator[Sentence]:
        for time_s, line, number in read_nmea_log(path, self._noting("gnss", path)):
            yield Sentence(time_s, line, number)

    def _noting(self, source: str, path: Path) -> Callable[[int, str], None]:
        def note(line: int, reason: str) -> None:
            self.counts[f"{source} bad lines"] += 1
            self.first_bad.setdefault(source, f"{path}:{line}: {reason}")

        return note

    def _stretches(self, items: Iterator[Item], source: str) -> Iterator[tuple[int, float, Item]]:
        """(stretch, time, item) with damaged stamps left out."""
        stretch = 0
        before: float | None = None
        held: Item | None = None
        for item in items:
            if held is None:
                held = item
                continue
            if self._leaps(before, held.time_s, item.time_s):
                self.counts[f"{source} damaged stamps"] += 1
                held = item
                continue
            if before is not None and held.time_s < before - BACKWARD_STEP_S:
                stretch += 1
                self.counts[f"{source} clock steps"] += 1
            yield stretch, held.time_s, held
            before, held = held.time_s, item
        if held is not None and not self._leaps(before, held.time_s, before):
            if before is not None and held.time_s < before - BACKWARD_STEP_S:
                stretch += 1
            yield stretch, held.time_s, held

    @staticmethod
    def _leaps(before: float | None, time_s: float, after: float | None) -> bool:
        if before is None or after is None:
            return False
        return abs(time_s - before) > LEAP_S and abs(time_s - after) > LEAP_S and abs(after - before) < LEAP_S

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
