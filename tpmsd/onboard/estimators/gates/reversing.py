"""Notices that a car drives backward whose wheel signals bear no sign.

In: the rear axle's speed as the wheels tell it, fixes, the heading. Out: whether it drives backward.

Most buses count wheels up in either direction. A car that reverses out of a parking space then seems to drive
the other way round its turning circle. From a standstill either direction is open; the receiver's course
against the heading decides, as soon as the car is fast enough for a course, and until it stands again or is
faster than cars reverse.
"""

from __future__ import annotations

import math

from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Fix


class ReverseWatch:
    """One car; begins at a standstill."""

    def __init__(self) -> None:
        self.backward = False
        self._open = True
        """True until the direction of driving is known."""
        self._signed = False
        self._rest_s = 0.0
        self._against_s: float | None = None

    @property
    def undecided(self) -> bool:
        """True while a fix can still decide the direction of travel."""
        return self._open and not self._signed

    def update_speed(self, speed_mps: float, dt_s: float) -> None:
        """Update by a tick's speed, m/s; a negative one shows that the signals bear a sign."""
        if speed_mps == 0.0:
            self._rest_s += dt_s
            if self._rest_s >= SETTINGS.reverse_rest_s:
                self.backward, self._open, self._against_s = False, True, None
            return
        self._rest_s = 0.0
        self._signed = self._signed or speed_mps < -SETTINGS.moving_mps
        if speed_mps > SETTINGS.start_speed_mps or self._signed:
            self.backward = self._open = False

    def compare_course(self, fix: Fix, heading_rad: float) -> None:
        """Decide the direction of travel by a fix's course against the heading."""
        if not self.undecided or not fix.speed_mps >= SETTINGS.reverse_course_mps:  # false for NaN
            return
        apart = abs(math.remainder(fix.heading_rad - heading_rad, 2.0 * math.pi))
        if apart < math.pi - SETTINGS.reverse_within_rad:
            self._open, self._against_s = False, None
        elif apart >= math.pi - SETTINGS.reverse_within_rad:  # false for NaN
            if self._against_s is None:
                self._against_s = fix.time_s
            if fix.time_s - self._against_s >= SETTINGS.reverse_after_s:
                self.backward, self._open = True, False
