"""A time line that only rises, made of a host clock that does not always.

In: host time stamps in the order in which they were taken. Out: logical seconds: the same numbers until the
clock steps back, from then on shifted so that time goes on. Forward steps look like a pause and are left to
the timeline.
"""

from __future__ import annotations

import math

BACKWARD_STEP_S = 0.5
"""Smaller set-backs are late frames of another queue, not a step of the clock."""
ASSUMED_ADVANCE_S = 0.01
"""Time taken to have passed over a backward step."""


class HostClock:
    """Maps host time to logical time and back."""

    def __init__(self) -> None:
        self._shift_s = 0.0
        self.latest_s = -math.inf
        """The greatest logical time so far."""
        self.steps = 0

    def advance(self, host_s: float) -> float:
        """Return the logical time of a new stamp, from now on the latest unless an earlier one is later; a
        backward step of the host clock changes the shift so that time goes on."""
        logical = host_s + self._shift_s
        if logical > self.latest_s:
            self.latest_s = logical
        elif logical < self.latest_s - BACKWARD_STEP_S:
            self._shift_s += self.latest_s + ASSUMED_ADVANCE_S - logical
            self.steps += 1
            logical = host_s + self._shift_s
            self.latest_s = max(logical, self.latest_s)
        return logical

    def to_logical(self, host_s: float) -> float:
        """Return the logical time of a host time by the present shift; the clock is left as it is."""
        return host_s + self._shift_s

    def to_host(self, logical_s: float) -> float:
        """Return the host clock's time at a logical time by the present shift."""
        return logical_s - self._shift_s
