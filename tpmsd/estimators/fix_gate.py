"""Which fixes are believed: outliers are refused, but a receiver that insists is believed again.

In: how far a fix is from where it is expected, and how sure both are. Out: use it, refuse it, or the pose is
lost.
"""

from __future__ import annotations

import math
from typing import Literal

REFUSE_DISTANCE = 6.0
"""Fixes further off than this many standard deviations (plus `REFUSE_SLACK_M`) are refused."""
REFUSE_SLACK_M = 5.0
LOST_AFTER_S = 8.0
"""Fixes refused for this long: it is the pose that is wrong."""


class FixGate:
    """Memory of refusals."""

    def __init__(self) -> None:
        self.refused = 0
        self._since_s: float | None = None

    @property
    def refusing(self) -> bool:
        """Whether the last fix was refused."""
        return self._since_s is not None

    def reset(self) -> None:
        """Forget the refusals (the pose was given up)."""
        self._since_s = None

    def judge(self, off_m: float, variance_m2: float, time_s: float) -> Literal["use", "refuse", "lost"]:
        """Judge a fix `off_m` from its expectation; `variance_m2` is that of the difference."""
        if off_m <= REFUSE_SLACK_M + REFUSE_DISTANCE * math.sqrt(variance_m2):
            self._since_s = None
            return "use"
        self.refused += 1
        if self._since_s is None:
            self._since_s = time_s
        return "lost" if time_s - self._since_s > LOST_AFTER_S else "refuse"
