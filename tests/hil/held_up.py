"""How much of a processor the machine took away: by a thread that should wake at once, and does not.

In: a processor. Out: the share of the time in which the machine did something else, and the longest of those
times. A virtual machine whose neighbours are busy loses its processors for tens of milliseconds at a time,
and nothing that runs in it can keep to a clock then.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections.abc import Callable, Iterator

GLANCE_S = 0.004
USUAL_S = 0.002
"""Later than that is no matter of timers."""
MUCH, LONG_S = 0.15, 0.25
"""A share, and one time: what keeps from its clock a guest that needs half of a processor."""


class HeldUp:
    """What is known so far; `look` is one glance of the thread."""

    def __init__(
        self, monotonic: Callable[[], float] = time.monotonic, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        self._monotonic, self._sleep = monotonic, sleep
        self._watched_s = self._late_s = self.worst_s = 0.0

    def look(self) -> None:
        """Sleep a little, and see how late it is then."""
        began_s = self._monotonic()
        self._sleep(GLANCE_S)
        took_s = self._monotonic() - began_s
        late_s = took_s - GLANCE_S
        self._watched_s += took_s
        if late_s > USUAL_S:
            self._late_s += late_s
            self.worst_s = max(self.worst_s, late_s)

    @property
    def share(self) -> float:
        """Of the time, 0 to 1."""
        return self._late_s / self._watched_s if self._watched_s else 0.0

    @property
    def much(self) -> bool:
        """Whether what must keep to a clock could not be judged."""
        return self.share > MUCH or self.worst_s > LONG_S

    def __str__(self) -> str:
        return f"{100 * self.share:.0f} % of the processor taken away, {self.worst_s:.2f} s at the longest"


@contextlib.contextmanager
def watched(cpu: int | None) -> Iterator[HeldUp]:
    """Watch one processor (None: any); before all other work where that may be had."""
    seen, stop = HeldUp(), threading.Event()

    def watch() -> None:
        # Both calls are about this thread alone.
        if cpu is not None:
            os.sched_setaffinity(0, {cpu})
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        while not stop.is_set():
            seen.look()

    thread = threading.Thread(target=watch, name="held-up", daemon=True)
    thread.start()
    try:
        yield seen
    finally:
        stop.set()
        thread.join()
