"""An input that may be missing or go away: the state of a bus or a receiver.

In: what happens to it (opened, failed, gave data) and monotonic time. Out: when to try again, whether it
is down, one log line when it goes and one when it is back.
"""

from __future__ import annotations

import logging
import math

FIRST_DELAY_S = 0.2
LONGEST_DELAY_S = 5.0
STABLE_S = 2.0
"""An open line that gives nothing is taken to be well after this time: silence is no error."""


class Link:
    """State and back-off of one input; what is opened is for `BusLink` and `ReceiverLink` to know."""

    def __init__(self, label: str, log: logging.Logger) -> None:
        self.label = label
        self.reason = ""
        """Reason for which it is down, in a few words."""
        self.downs = 0
        """Number of times that it was lost or could not be opened."""
        self.generation = 0
        """Rises with every opening and closing: descriptors of another generation are stale."""
        self._log = log
        self._is_open = False
        self._down_since_s: float | None = None
        self._opened_s = 0.0
        self._delay_s = FIRST_DELAY_S
        self._next_try_s = -math.inf
        self._until_data = False

    @property
    def is_open(self) -> bool:
        """True if there is something to read."""
        return self._is_open

    @property
    def is_down(self) -> bool:
        """True from a failure until it works again."""
        return self._down_since_s is not None

    @property
    def next_try_s(self) -> float:
        """Time of the next attempt to open it (monotonic); infinite while it is open."""
        return math.inf if self._is_open else self._next_try_s

    def _note_opened(self, now_s: float) -> None:
        """Note that the input was opened."""
        self._is_open = True
        self._opened_s = now_s
        self.generation += 1

    def _note_working(self, now_s: float, data: bool) -> None:
        """Report the input as back once it has delivered data or stayed open; `data`: something was read."""
        if not data and (self._until_data or now_s - self._opened_s < STABLE_S):
            return
        self._until_data = False
        self._delay_s = FIRST_DELAY_S
        if self._down_since_s is not None:
            self._log.info("%s: is back after %.1f s", self.label, now_s - self._down_since_s)
            self._down_since_s = None
            self.reason = ""

    def _note_failure(self, now_s: float, reason: str, until_data: bool = False) -> None:
        """Note and log a failure, and schedule the next attempt; `until_data`: only data, not a mere opening,
        will show that the input works again."""
        self._is_open = False
        self._until_data |= until_data
        self.generation += 1
        self._next_try_s = now_s + self._delay_s
        self._delay_s = min(2.0 * self._delay_s, LONGEST_DELAY_S)
        if self._down_since_s is None:
            self._down_since_s = now_s
            self.downs += 1
            self._log.warning("%s: %s; trying again until it is back", self.label, reason)
        elif reason != self.reason:
            self._log.info("%s: still down: %s", self.label, reason)
        self.reason = reason
