"""Log lines for the journal, or for a terminal.

In: log records. Out: lines on standard error. For the journal each begins with its priority as
sd-daemon(3) has it (`<4>`) and bears no time, because the journal adds one; elsewhere it bears the time
and the level.
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Mapping
from typing import IO

from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind

LOGGER = "tpmsd"

_PRIORITIES = (
    (logging.CRITICAL, 2),
    (logging.ERROR, 3),
    (logging.WARNING, 4),
    (logging.INFO, 6),
    (logging.NOTSET, 7),
)
_RAISED = {
    AlarmKind.DEFLATION: logging.CRITICAL,
    AlarmKind.RADIUS_DEVIATION: logging.WARNING,
    AlarmKind.MALFUNCTION: logging.ERROR,
    AlarmKind.SLOW_LEAK: logging.WARNING,
}


class JournalFormatter(logging.Formatter):
    """One line with its priority in front."""

    def format(self, record: logging.LogRecord) -> str:
        """Return one line, also of a message with line breaks: each line is an entry of its own in the
        journal."""
        priority = next(number for level, number in _PRIORITIES if record.levelno >= level)
        return f"<{priority}>{' '.join(super().format(record).split())}"


def set_up_logging(
    verbose: bool = False,
    stream: IO[str] | None = None,
    environment: Mapping[str, str] | None = None,
) -> logging.Logger:
    """Return the daemon's logger, writing to `stream` (standard error)."""
    stream = sys.stderr if stream is None else stream
    environment = os.environ if environment is None else environment
    handler = logging.StreamHandler(stream)
    if environment.get("JOURNAL_STREAM") and not stream.isatty():
        handler.setFormatter(JournalFormatter("%(message)s"))
    else:
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)-8s %(message)s", "%H:%M:%S"))
    log = logging.getLogger(LOGGER)
    log.handlers[:] = [handler]
    log.propagate = False
    log.setLevel(logging.DEBUG if verbose else logging.INFO)
    return log


def log_alarm(log: logging.Logger, event: AlarmEvent) -> None:
    """Log one line for an alarm that was raised or cleared."""
    where = "" if event.wheel is None else f" {event.wheel}"
    if event.state == "raised":
        log.log(_RAISED[event.kind], "ALARM %s%s raised: %s", event.kind, where, event.reason)
    else:
        log.info("alarm %s%s cleared: %s", event.kind, where, event.reason)
