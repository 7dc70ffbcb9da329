"""Stamps that leap away from their neighbours and back: damaged lines, which are left out.

In: stamps in the order of a file, each with what bears it. Out: what is sound, in the same order. Pure.
"""

from __future__ import annotations

from typing import Generic, TypeVar

import numpy as np

from tpmsd.foundation.wheels import FloatArray

BACKWARD_STEP_S = 0.5
LEAP_S = 2.0
"""Up to `MAX_DAMAGED` stamps that leap this far from the last good one are damaged if the next follows it."""
MAX_DAMAGED = 4
START_PAUSE_S = 60.0
"""A lone first stamp is sound if the next ones come within this time, s: a pause of the recording computer at
its start. A damaged stamp that is kept by this makes the drive longer by no more."""

Item = TypeVar("Item")


class LeapWatch(Generic[Item]):
    """Judges the stamps of one file."""

    def __init__(self) -> None:
        self.damaged = 0
        """Stamps that were left out."""
        self._before_s: float | None = None
        self._doubted: list[tuple[float, Item]] = []

    @property
    def calm(self) -> bool:
        """True if the last stamp was sound and none is in doubt."""
        return self._before_s is not None and not self._doubted

    def take_regular(self, time_s: FloatArray, start: int) -> int:
        """Take the stamps from `start` on that do not leap; return the index of the first that is not
        taken."""
        if self._before_s is None or self._doubted or start == len(time_s):
            return start
        leaps = np.abs(np.diff(time_s[start:], prepend=self._before_s)) > LEAP_S
        stop = start + int(np.argmax(leaps)) if leaps.any() else len(time_s)
        if stop > start:
            self._before_s = float(time_s[stop - 1])
        return stop

    def take(self, time_s: float, item: Item) -> list[Item]:
        """Take one stamp's record; return the records, this one or earlier ones, that are found sound by
        it."""
        before_s, doubted = self._before_s, self._doubted
        if before_s is not None and not doubted and abs(time_s - before_s) <= LEAP_S:
            self._before_s = time_s
            return [item]
        if before_s is None:
            # The first of a file have no neighbours but those behind them: two that go together are sound,
            # and of those before them the ones that a pause leads from to these two.
            if doubted and abs(time_s - doubted[-1][0]) <= LEAP_S:
                sound = [item for stamp_s, item in doubted if -LEAP_S <= time_s - stamp_s <= START_PAUSE_S]
                self.damaged += len(doubted) - len(sound)
                self._doubted, self._before_s = [], time_s
                return [*sound, item]
        elif doubted and _is_continuous(before_s, time_s) and not _is_continuous(doubted[-1][0], time_s):
            self.damaged += len(doubted)
            self._doubted, self._before_s = [], time_s
            return [item]
        doubted.append((time_s, item))
        if len(doubted) > MAX_DAMAGED:
            self._before_s = time_s
            return self.release_doubted()
        return []

    def release_doubted(self) -> list[Item]:
        """Return the records that are still in doubt and take them as sound, as at the end of the file."""
        left, self._doubted = [item for _, item in self._doubted], []
        return left


def _is_continuous(before_s: float, time_s: float) -> bool:
    """Return whether a stamp follows another by at most `LEAP_S`, or precedes it by at most
    `BACKWARD_STEP_S`."""
    return -BACKWARD_STEP_S <= time_s - before_s <= LEAP_S
