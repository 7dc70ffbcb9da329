"""The car's own speed (OBD-II) as a coarse reference: it says which of wheels and receiver is far off.

In: whole km/h as the car's control units state them, speeds of wheels and receiver per tick. Out:
`SpeedAgreement`. A control unit rounds or truncates, computes with the circumference of some tyre, and
answers late. So a statement is an interval, and what it is held against is the range of a speed over the last
two seconds. Only where the two do not meet they contradict each other. What is measured turns with the same
tyres and says nothing of their radii: it never moves an estimate, and takes no alarm back.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from tpmsd.onboard.monitor.settings import SIGNALS


@dataclass(frozen=True, slots=True)
class SpeedAgreement:
    """Agreement with the car's own speed at a tick; None where that is not known."""

    min_mps: float = 0.0
    """The car is at least so fast; 0 where that is not known."""
    wheels: bool | None = None
    """True if the wheels' speed agrees with it."""
    receiver: bool | None = None
    """True if the receiver's speed agrees with it."""

    @property
    def agreement_note(self) -> str:
        """Text for an alarm's reason: with which of wheels and receiver the car's own speed agrees; empty for
        neither or both."""
        if (self.wheels, self.receiver) == (True, False):
            return "; the car's own speed (OBD) agrees with the wheels"
        if (self.wheels, self.receiver) == (False, True):
            return "; the car's own speed (OBD) agrees with the receiver"
        return ""


NOTHING = SpeedAgreement()


class CarSpeed:
    """Compares the speeds that the car's control unit states with those of wheels and receiver."""

    def __init__(self) -> None:
        self._stated_kmh: int | None = None
        """Stated since the last tick."""
        self._taken_s = -math.inf
        self._recent: deque[tuple[float, float, float]] = deque()
        self.received = NOTHING

    def note_stated(self, kmh: int) -> None:
        """Record that a control unit states a speed, 0 to 255 km/h."""
        self._stated_kmh = kmh

    def update(self, time_s: float, wheels_mps: float, receiver_mps: float) -> SpeedAgreement:
        """Update by the speeds at one tick, NaN where not known; return the agreement of both with the car's
        speed."""
        self._recent.append((time_s, wheels_mps, receiver_mps))
        while self._recent[0][0] < time_s - SIGNALS.car_late_s:
            self._recent.popleft()
        if self._stated_kmh is not None:
            self.received, self._stated_kmh = self._compare(self._stated_kmh), None
            self._taken_s = time_s
        elif not 0.0 <= time_s - self._taken_s <= SIGNALS.speed_fresh_s:
            self.received = NOTHING
        return self.received

    def _compare(self, kmh: int) -> SpeedAgreement:
        """Return the agreement of a stated speed with the recent speeds of wheels and receiver."""
        low_mps, high_mps = stated_range(kmh)
        agree = []
        for index in (1, 2):
            speeds = [moment[index] for moment in self._recent if math.isfinite(moment[index])]
            agree.append(low_mps <= max(speeds) and min(speeds) <= high_mps if speeds else None)
        return SpeedAgreement(low_mps, *agree)


def stated_range(kmh: int) -> tuple[float, float]:
    """Return the lowest and highest speed over ground (m/s) that a statement of whole km/h allows; infinite
    for 255."""
    # SAE J1979 asks for whole km/h, and says not whether rounded, truncated or raised.
    low_mps = max(kmh - 1, 0) / 3.6 / (1.0 + SIGNALS.car_scale_share)
    high_mps = (kmh + 1) / 3.6 / (1.0 - SIGNALS.car_scale_share)
    return low_mps, math.inf if kmh == 255 else high_mps
