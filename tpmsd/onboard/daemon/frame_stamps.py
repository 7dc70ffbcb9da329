"""Brings the stamps of a CAN adapter's own clock onto the host's clock.

In: the stamps of frames that were read together, and the host's time just after that. Out: what brings them
onto the host's clock.

Only SocketCAN stamps with the host's clock. Adapters behind other backends count from when they were
plugged in, or were set once and drift since; their stamps are exact against each other, though, which is
what a wheel's rotation rests on. Reading only ever adds delay, so the least lag seen lately is the
offset.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

WINDOW_S = 10.0
"""Memory of the least lag: a crystal drifts by half a millisecond in it."""
TOLERANCE_S = 0.05
"""A lag up to this is left as it is: it may be a busy moment of this process."""


class FrameStamps:
    """One adapter's clock; `tolerance_s` and `window_s` in seconds of the host's clock."""

    def __init__(self, tolerance_s: float = TOLERANCE_S, window_s: float = WINDOW_S) -> None:
        self._tolerance_s = tolerance_s
        self._window_s = window_s
        self.reset()

    def reset(self) -> None:
        """Forget the offset: the host's clock has stepped, or another adapter is there."""
        self._min_s = self._min_before_s = math.inf
        self._since_s = -math.inf

    def offset_s(self, stamps_s: Sequence[float], now_s: float) -> float:
        """Return the offset, s, to add to the stamps of frames that were all read by `now_s`.

        One offset for all of them: their distances are the adapter's, however long the reading took.
        """
        lag_s = now_s - max(stamps_s)
        if not 0.0 <= now_s - self._since_s < self._window_s:
            self._min_before_s, self._min_s = self._min_s, lag_s
            self._since_s = now_s
        self._min_s = min(self._min_s, lag_s)
        min_s = min(self._min_s, self._min_before_s)
        # Without a jump between what is tolerated and what is corrected.
        return max(min_s - self._tolerance_s, 0.0) + min(min_s, 0.0)
