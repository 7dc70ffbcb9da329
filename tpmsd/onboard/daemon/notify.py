"""Runs a program on alarm events: `[notify] command`.

In: alarm events, monotonic time. Out: child processes, one at a time, without a shell, with what happened in
their environment. Starting one costs a fork and an exec; nothing here waits for its end.
"""

from __future__ import annotations

import contextlib
import logging
import math
import os
import signal
import subprocess
from collections import deque
from collections.abc import Mapping

from tpmsd.car.config.model import NotifyConfig
from tpmsd.onboard.monitor.records import AlarmEvent

MAX_WAITING = 32
"""Events that wait for their turn; of more the oldest are left out, for the newest say how it is."""
PASSED_ON = ("PATH", "HOME", "LANG", "LC_ALL", "TZ")
"""Variables of the daemon's own environment that the program is given; secrets of the service are left
out."""


class Notices:
    """One program, run for one event after the other.

    `counts`: `run`, `failed` (ended with another code than 0, or could not be started), `killed` (took too
    long), `left_out`.
    """

    def __init__(self, config: NotifyConfig, log: logging.Logger, environment: Mapping[str, str]) -> None:
        self._config, self._log = config, log
        self._base = {name: environment[name] for name in PASSED_ON if name in environment}
        self._waiting: deque[AlarmEvent] = deque()
        self._process: subprocess.Popen[bytes] | None = None
        self._begun_s = self._last_s = -math.inf
        self._last_logged = ""
        self.counts = {"run": 0, "failed": 0, "killed": 0, "left_out": 0}

    def add(self, event: AlarmEvent) -> None:
        """Queue a notice of an alarm that was raised or cleared."""
        if not self._config.command or event.kind not in (self._config.kinds or (event.kind,)):
            return
        if len(self._waiting) == MAX_WAITING:
            self._waiting.popleft()
            self.counts["left_out"] += 1
        self._waiting.append(event)

    def service(self, now_s: float) -> None:
        """Poll the running program, and start the next if one is due; never waits."""
        if self._process is not None:
            self._poll_process(self._process, now_s)
        due = now_s - self._last_s >= self._config.min_interval_s
        if self._process is None and self._waiting and due:
            self._start_process(self._waiting.popleft(), now_s)

    def close(self) -> None:
        """End with the daemon: the running program may go on, events that wait are left out."""
        self.counts["left_out"] += len(self._waiting)
        self._waiting.clear()
        self._process = None

    def _poll_process(self, process: subprocess.Popen[bytes], now_s: float) -> None:
        """Kill the program if it takes too long; log and count a failure if it has ended with one."""
        code = process.poll()
        if code is None and now_s - self._begun_s > self._config.timeout_s:
            self.counts["killed"] += 1
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)  # its children, too
            self._log_once(f"{self._config.command[0]} took longer than {self._config.timeout_s:g} s: killed")
            self._begun_s = math.inf  # killed once; it is reaped when it is gone
        elif code is not None:
            self._process = None
            if code != 0:
                self.counts["failed"] += 1
                self._log_once(f"{self._config.command[0]} ended with {code}")
            else:
                self._last_logged = ""

    def _start_process(self, event: AlarmEvent, now_s: float) -> None:
        """Start the program for an event; a failure to start is counted and logged."""
        self._last_s = self._begun_s = now_s
        try:
            self._process = subprocess.Popen(
                self._config.command,
                env={**self._base, **variables(event)},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            self.counts["failed"] += 1
            reason = getattr(error, "strerror", None) or error
            self._log_once(f"{self._config.command[0]} cannot be run: {reason}")
        else:
            self.counts["run"] += 1

    def _log_once(self, what: str) -> None:
        """Log one line, and no repetition of it."""
        if what != self._last_logged:
            self._log.warning("[notify] %s", what)
        self._last_logged = what


def variables(event: AlarmEvent) -> dict[str, str]:
    """Return the environment variables that the program is given; an unknown number is an empty text."""
    return {
        "TPMSD_KIND": str(event.kind),
        "TPMSD_STATE": event.state,
        "TPMSD_WHEEL": event.wheel or "",
        "TPMSD_TIME": _format_number(event.time_s, 3),
        "TPMSD_DEVIATION_MM": _format_number(1e3 * event.deviation_m, 2),
        "TPMSD_PRESSURE_LOSS_PERCENT": _format_number(100.0 * event.pressure_loss, 0),
        "TPMSD_PROBABILITY": _format_number(event.probability, 4),
        "TPMSD_REASON": "".join(c if c.isprintable() else " " for c in event.reason),
    }


def _format_number(value: float, digits: int) -> str:
    """Return a number with these decimals; an empty text if it is not finite."""
    return f"{value:.{digits}f}" if math.isfinite(value) else ""
