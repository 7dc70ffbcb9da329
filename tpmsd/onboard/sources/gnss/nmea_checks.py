"""Checks on a receiver's epochs that need a memory.

In: times, fixes and verdicts, one after the other. Out: how long a silence ends an epoch, whether a position
is frozen or out of reach, and each lasting fault once.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

from tpmsd.onboard.sources.events import GnssFix, SourceFault
from tpmsd.onboard.sources.gnss.nmea_clock import DAY_S

NAN = math.nan
MIN_GAP_S, MAX_GAP_S, GAP_OF_INTERVAL = 0.02, 0.25, 0.3
FROZEN_COUNT, FROZEN_SPEED_MPS = 5, 2.0
REACH_SPEED_MPS, REACH_M = 150.0, 500.0
"""Greatest speed of a car, and a constant distance that a receiver may drift when the sky is hidden."""
REACH_COUNT = 3
GOOD_TO_END = {"repeated": 20}
"""Good epochs that end an episode, where one is not enough: a doubled log is good every other epoch."""
_DEGREE_M = 111195.0


class EpochInterval:
    """Median of the last intervals between epochs on the receiver's clock: lost epochs do not stretch it."""

    def __init__(self) -> None:
        self._intervals: deque[float] = deque(maxlen=9)
        self._last = NAN
        self.gap_s = MAX_GAP_S

    def learn(self, time_of_day_s: float) -> None:
        """Update the median by the time of day of a new epoch; the same time again has no effect."""
        step = (time_of_day_s - self._last) % DAY_S
        self._last = time_of_day_s
        if 0.005 < step <= 10.0:
            self._intervals.append(step)
            median = sorted(self._intervals)[(len(self._intervals) - 1) // 2]
            self.gap_s = min(max(GAP_OF_INTERVAL * median, MIN_GAP_S), MAX_GAP_S)


class Episodes:
    """Reports a lasting fault once, when it begins, and counts every epoch that it spoils."""

    KINDS = ("range", "no_fix", "frozen", "leap", "repeated", "week_rollover")

    def __init__(self, counts: dict[str, int]) -> None:
        self._counts = counts
        self._good: dict[str, int] = {}

    def note(self, time_s: float, kind: str, wrong: bool, detail: str = "") -> list[SourceFault]:
        """Note whether an epoch has this fault; return its report if an episode begins with it, else
        nothing."""
        if not wrong:
            if kind in self._good:
                self._good[kind] += 1
                if self._good[kind] >= GOOD_TO_END.get(kind, 1):
                    del self._good[kind]
            return []
        self._counts[kind] += 1
        begins = kind not in self._good
        self._good[kind] = 0
        return [SourceFault(time_s, "gnss", kind, detail)] if begins else []


class FrozenPosition:
    """Detects a receiver that repeats its last position while it reports motion."""

    def __init__(self) -> None:
        self._position = (NAN, NAN)
        self._same = 0

    def judge(self, fix: GnssFix) -> bool:
        """Return whether the position of this fix is a frozen one."""
        position = (fix.latitude_deg, fix.longitude_deg)
        if position != self._position:
            self._position, self._same = position, 1
        elif self._same < FROZEN_COUNT:
            if fix.speed_mps > FROZEN_SPEED_MPS:
                self._same += 1
            elif fix.speed_mps <= FROZEN_SPEED_MPS:
                self._same = 1
        return self._same >= FROZEN_COUNT


class Leap:
    """Detects a position that no car could have reached since the last one.

    One damaged sentence in 256 passes its checksum. A leap is accepted when REACH_COUNT fixes in a row,
    within reach of one another, say so: then the positions before were the wrong ones.
    """

    def __init__(self) -> None:
        self._good: GnssFix | None = None
        self._doubted: list[GnssFix] = []

    def judge(self, fix: GnssFix) -> bool:
        """Return whether the position of this fix is out of reach (and not yet accepted)."""
        if self._good is None or _within_reach(self._good, fix):
            self._good = fix
            self._doubted.clear()
            return False
        if self._doubted and not _within_reach(self._doubted[-1], fix):
            self._doubted.clear()
        self._doubted.append(fix)
        if len(self._doubted) < REACH_COUNT:
            return True
        self._good = fix
        self._doubted.clear()
        return False


class PositionChecks:
    """Both checks of a position as episodes; a fix that fails one loses its position."""

    def __init__(self, episodes: Episodes) -> None:
        self._episodes = episodes
        self._frozen, self._leap = FrozenPosition(), Leap()

    def judge(self, fix: GnssFix) -> tuple[GnssFix, list[SourceFault]]:
        """Return the fix, without its position if that is frozen or out of reach, and the faults that begin
        with it."""
        at_s = fix.arrival_s
        frozen, leapt = self._frozen.judge(fix), self._leap.judge(fix)
        detail = f"the same position {FROZEN_COUNT} times while moving"
        faults = self._episodes.note(at_s, "frozen", frozen, detail)
        position = f"{fix.latitude_deg:.5f}, {fix.longitude_deg:.5f}" if leapt else ""
        faults += self._episodes.note(
            at_s, "leap", leapt, f"{position} is out of reach from the last position"
        )
        return without_position(fix) if frozen or leapt else fix, faults


def without_position(fix: GnssFix) -> GnssFix:
    """Return the fix with its motion and time alone."""
    return replace(fix, latitude_deg=NAN, longitude_deg=NAN, altitude_m=NAN, position_std_m=NAN)


def _within_reach(before: GnssFix, after: GnssFix) -> bool:
    """Return whether a car can have driven from one position to the other in the time between."""
    # By the clock that gives the car more time: the other may have stepped back.
    by_host_s, by_utc_s = abs(after.arrival_s - before.arrival_s), abs(after.utc_s - before.utc_s)
    longest_s = max(0.0, by_host_s, by_utc_s)  # in this order NaN is passed over
    allowed_m = REACH_M + REACH_SPEED_MPS * longest_s
    north_m = (after.latitude_deg - before.latitude_deg) * _DEGREE_M
    east_deg = math.remainder(after.longitude_deg - before.longitude_deg, 360.0)
    east_m = east_deg * _DEGREE_M * math.cos(math.radians(after.latitude_deg))
    return math.hypot(north_m, east_m) <= allowed_m
