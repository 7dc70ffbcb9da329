"""Messages to the service manager and their times: READY, STATUS, WATCHDOG, STOPPING.

In: the number of ticks so far, monotonic time. Out: sd_notify messages. Ready is a daemon that makes
ticks, and the watchdog is fed only while there are new ones: a loop that turns without an estimate is as
good as dead.
"""

from __future__ import annotations

from collections.abc import Callable

from tpmsd.onboard.daemon.deadlines import PeriodicTask
from tpmsd.onboard.sinks.sd_notify import Notifier

STATUS_S = 5.0


class ServiceManager:
    """Speaks through a `Notifier`; `scale`: how much faster than real time the clock runs."""

    def __init__(self, notifier: Notifier, scale: float = 1.0) -> None:
        self._notifier = notifier
        self._status = PeriodicTask(scale * STATUS_S)
        period_s = notifier.watchdog_period_s
        self._watchdog = None if period_s is None else PeriodicTask(scale * period_s)
        self._fed_ticks = 0
        self.is_ready = False

    def note_ticks(self, ticks: int, line: Callable[[], str], now_s: float) -> None:
        """Report readiness at the first tick, feed the watchdog while ticks advance, and send the status now
        and then; call after every turn."""
        if ticks == 0:
            return
        if not self.is_ready:
            self.is_ready = True
            self._notifier.ready(line())
            self._status.due(now_s)
        if ticks > self._fed_ticks and self._watchdog is not None and self._watchdog.due(now_s):
            self._notifier.watchdog()
            self._fed_ticks = ticks
        if self._status.due(now_s):
            self._notifier.status(line())

    def stopping(self, why: str) -> None:
        """Report that shut-down has begun."""
        self._notifier.stopping(f"stopping: {why}")

    def close(self) -> None:
        """Close the socket."""
        self._notifier.close()
