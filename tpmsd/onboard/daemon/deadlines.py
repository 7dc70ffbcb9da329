"""Absolute deadlines, so that the rate does not drift.

In: a period, and monotonic time. Out: when the next tick is due, how late one is, how many were missed.
"""

from __future__ import annotations


class Deadlines:
    """Tick k is due at start + k * period, however long the ticks before it took."""

    def __init__(self, period_s: float, start_s: float) -> None:
        self._period_s = period_s
        self._start_s = start_s
        self._next = 1
        self.taken = 0
        self.missed = 0
        """Deadlines that passed unnoticed, because the loop was busy or the process did not run."""

    @property
    def next_s(self) -> float:
        """Deadline of the next tick, s."""
        return self._start_s + self._next * self._period_s

    def due_lateness_s(self, now_s: float) -> float | None:
        """Return the lateness of the tick that is due now, s, None if none is; skips all deadlines that have
        passed."""
        late_s = now_s - self.next_s
        if late_s < 0.0:
            return None
        skipped = int(late_s / self._period_s)
        self.missed += skipped
        self.taken += 1
        self._next += skipped + 1
        return late_s


class PeriodicTask:
    """Schedule of a periodic task: due at once, then once per period, without bursts after a pause."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._next_s: float | None = None

    def due(self, now_s: float) -> bool:
        """Return whether the task is due; if so, it is due next a period from now."""
        if self._next_s is not None and now_s < self._next_s:
            return False
        self._next_s = now_s + self._period_s
        return True
