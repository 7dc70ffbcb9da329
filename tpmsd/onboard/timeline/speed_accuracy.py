"""Accuracy of a receiver's speed, relative to its usual one, by the receiver's own statements.

In: the standard deviations that it states, one per fix. Out: a factor of at least one, by which the usual
error of a Doppler speed is multiplied.

The statement is taken against the receiver's own usual one, since makers calibrate it differently: what is
always wrong by the same factor, up to `TOLERATED`, changes nothing.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

TYPICAL_MPS = 0.06
"""Error of a Doppler speed under an open sky, as the estimators take it."""
TOLERATED = 3.0
"""A receiver whose usual statement is off by more is taken at its word beyond this."""
MEMORY = 600
"""Fixes: a minute at 10 Hz, ten at 1 Hz; longer than an underpass or a street of high houses."""
QUANTILE = 0.25
"""Quantile of the statements: that under an open sky, as long as a quarter of the drive has one."""
EVERY = 10
"""Number of fixes after which the quantile is computed again."""
MOST = 30.0
"""Largest factor (2 m/s): a less accurate speed carries no information."""


class SpeedAccuracy:
    """Memory of the accuracies that one receiver stated."""

    def __init__(self) -> None:
        self._stated: deque[float] = deque(maxlen=MEMORY)
        self._typical_mps = math.nan
        self._since = 0

    def factor(self, stated_mps: float) -> float:
        """Record a stated standard deviation (m/s); return the factor, 1 to `MOST`, by which the fix's speed
        is less accurate than usual. 1 where none is stated."""
        if not (math.isfinite(stated_mps) and stated_mps > 0.0):
            return 1.0
        self._stated.append(stated_mps)
        self._since += 1
        if self._since >= EVERY or len(self._stated) < EVERY:
            self._since = 0
            usual = float(np.quantile(self._stated, QUANTILE))
            self._typical_mps = min(max(usual, TYPICAL_MPS / TOLERATED), TYPICAL_MPS * TOLERATED)
        return min(max(stated_mps / self._typical_mps, 1.0), MOST)
