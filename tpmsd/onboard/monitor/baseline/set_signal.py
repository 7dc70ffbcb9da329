"""Set of tyres that the car itself states as mounted.

In: ticks. Out: the name of a set, when the car has changed to it. Some cars let the driver say so, or read it
from the wheels' transponders; the number 0 is the set that is learned where nothing is said.
"""

from __future__ import annotations

import math

from tpmsd.onboard.monitor.settings import TYRE_SETS
from tpmsd.onboard.timeline.tick import Tick

DEFAULT_SET = "default"
"""The set that is learned where nobody names one."""


class SetSignal:
    """Follows the role `tyre_set`."""

    def __init__(self) -> None:
        self._number = math.nan
        self._steady_s = 0.0

    def update(self, tick: Tick) -> str | None:
        """Return the name of the set that was just stated for long enough to be meant; None otherwise."""
        number = tick.tyre_set
        if number != self._number:  # true for NaN, too
            self._number, self._steady_s = number, 0.0
            return None
        before = self._steady_s
        self._steady_s += tick.dt_s
        if not before < TYRE_SETS.signal_steady_s <= self._steady_s:
            return None
        if number < 0.0 or not number.is_integer():
            return None
        return DEFAULT_SET if number == 0.0 else f"set-{int(number)}"
