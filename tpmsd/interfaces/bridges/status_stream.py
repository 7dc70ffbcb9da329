"""The daemon's documents for as long as a bridge lives, also when the daemon is restarted.

In: the path of the status socket. Out: documents, and None after each try that meets no daemon, so that a
bridge answers those who ask it meanwhile. Never ends.
"""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from tpmsd.onboard.sinks.status_client import StatusError, watch_status

FIRST_DELAY_S, LONGEST_DELAY_S = 0.2, 1.0
"""A call to a bridge waits for the longest delay at most: `GetState` is answered within a second."""


def follow_status(
    path: Path, log: logging.Logger, sleep: Callable[[float], None] = time.sleep
) -> Iterator[dict[str, Any] | None]:
    """Yield each status document, and None after each failed try to reach the daemon, which is logged
    once."""
    delay_s, said = FIRST_DELAY_S, ""
    while True:
        try:
            with contextlib.closing(watch_status(path)) as answers:
                for document in answers:
                    if said:
                        log.info("the daemon answers again")
                    delay_s, said = FIRST_DELAY_S, ""
                    yield document
        except StatusError as error:
            if str(error) != said:
                log.warning("%s; trying again until it answers", error)
            said = str(error)
            yield None
        sleep(delay_s)
        delay_s = min(2.0 * delay_s, LONGEST_DELAY_S)
