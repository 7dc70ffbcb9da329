"""Whether monitoring can do its work: signals of wheels and receiver that stay away become malfunctions.

In: ticks and their estimates. Out: malfunction events, raised after a time without and cleared after a time
with the signal. A parked car whose bus goes quiet is in order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tpmsd.config.model import MonitorConfig
from tpmsd.estimators.base import RadiusEstimate
from tpmsd.monitor.records import AlarmEvent, AlarmKind
from tpmsd.timeline.tick import Tick
from tpmsd.wheels import RL, RR, WHEELS

GNSS_FRESH_S = 10.0
MOVING_MPS = 2.0
TURNING_RAD = 0.1
"""Rotation in a tick from which a wheel turns."""
FORGIVE_AFTER_S = 1.0
"""Time in good order that takes back the bad time counted so far."""
CLEAR_SHARE = 0.1
MIN_CLEAR_S = 2.0


@dataclass(slots=True)
class _Malfunction:
    """One way in which monitoring can be out of order."""

    reason: str
    wheel: int | None = None
    bad_s: float = 0.0
    good_s: float = 0.0
    raised: AlarmEvent | None = None

    def update(self, bad: bool, good: bool, limit_s: float, tick: Tick) -> list[AlarmEvent]:
        """Count bad time up to the limit; a tenth of it in good order clears. Neither: the counts stand
        still."""
        if bad:
            self.bad_s += tick.dt_s
            self.good_s = 0.0
        elif good:
            self.good_s += tick.dt_s
            if self.good_s > FORGIVE_AFTER_S:
                self.bad_s = 0.0
        if self.raised is None and self.bad_s >= limit_s:
            self.raised = self._event("raised", self.reason, tick)
            return [self.raised]
        if self.raised is not None and self.good_s >= max(CLEAR_SHARE * limit_s, MIN_CLEAR_S):
            self.raised, self.bad_s = None, 0.0
            return [self._event("cleared", f"over: {self.reason}", tick)]
        return []

    def _event(self, state: Literal["raised", "cleared"], reason: str, tick: Tick) -> AlarmEvent:
        wheel = None if self.wheel is None else WHEELS[self.wheel]
        nan = math.nan
        return AlarmEvent(tick.host_time_s, AlarmKind.MALFUNCTION, wheel, state, nan, nan, 1.0, reason)


class SignalWatch:
    """Watches the wheels' signals, the bus as a whole and the receiver."""

    def __init__(self, settings: MonitorConfig, wheels: Sequence[int]) -> None:
        """`wheels`: indices of the wheels whose signals the bus should have."""
        self._settings = settings
        self._rear = _Malfunction("no usable signal of the rear wheels")
        self._gnss = _Malfunction("no usable fix from the receiver while driving")
        self._wheels = {
            wheel: _Malfunction(f"no usable signal of wheel {WHEELS[wheel]} while the others turn", wheel)
            for wheel in wheels
        }
        self._stood = False
        self._bus_down = False
        self._last_valid_s = dict.fromkeys(wheels, -math.inf)

    @property
    def standing(self) -> tuple[AlarmEvent, ...]:
        """The malfunctions that stand now, each as it was raised."""
        everything = (self._rear, self._gnss, *self._wheels.values())
        return tuple(m.raised for m in everything if m.raised is not None)

    def is_lost(self, wheel: int, time_s: float) -> bool:
        """Whether a wheel has had no usable signal for as long as a malfunction takes."""
        return time_s - self._last_valid_s.get(wheel, -math.inf) > self._settings.malfunction_s

    def update(self, tick: Tick, estimate: RadiusEstimate) -> list[AlarmEvent]:
        """Take one tick; what it raised or cleared."""
        valid = np.isfinite(tick.rotation_rad)
        for wheel in self._wheels:
            if valid[wheel]:
                self._last_valid_s[wheel] = tick.time_s
        moving = estimate.speed_mps > MOVING_MPS
        rear = bool(valid[RL] and valid[RR])
        if rear:
            self._stood = not moving
        if np.any(valid):
            self._bus_down = False
        elif any(fault.kind == "down" and fault.source == "can" for fault in tick.faults):
            self._bus_down = True
        # A parked car's bus goes quiet: nothing is wrong, unless the interface itself is gone.
        asleep = not np.any(valid) and self._stood and not self._bus_down
        limit_s = self._settings.malfunction_s
        events = self._rear.update(not rear and not asleep, rear, limit_s, tick)
        stale = estimate.gnss_age_s > GNSS_FRESH_S
        events += self._gnss.update(stale and moving, not stale, self._settings.gnss_malfunction_s, tick)
        turning = bool(np.any(tick.rotation_rad > TURNING_RAD))  # false for NaN
        for wheel, malfunction in self._wheels.items():
            events += malfunction.update(not valid[wheel] and turning, bool(valid[wheel]), limit_s, tick)
        return events
