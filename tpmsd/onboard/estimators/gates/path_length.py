"""Check whether a receiver's positions and its speeds are of one drive: path length against the integral of
speed.

In: fixes with position, speed and course. Out: whether the two have parted. A receiver whose speed is scaled
slowly, by an attacker or by a fault, is followed by the radii as fast as by anything that they are held
against; its own positions it contradicts.

Both are summed over a window of fixes that follow each other closely. A step of the path is the
chord between two fixes at least `step_s` apart, made an arc by the change of course. A speed that lags adds
the lag times the change of speed to the difference, whatever the length of the window.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise
from typing import NamedTuple

from tpmsd.onboard.estimators.settings import PATH_LENGTH
from tpmsd.onboard.timeline.tick import Fix

UNSTEADY = frozenset({5, 6})
"""GGA qualities: an RTK solution with float ambiguities slides by tens of metres while it converges; dead
reckoning has no position of its own."""


class _PathStep(NamedTuple):
    time_s: float
    path_m: float
    integral_m: float
    speed_mps: float
    with_before_m2: float
    """Its difference times that of the step before it; 0 for the first one."""

    @property
    def difference_m(self) -> float:
        """Path minus integral of speed, m."""
        return self.path_m - self.integral_m


class PathLength:
    """Follows one receiver."""

    def __init__(self, window_s: float = PATH_LENGTH.windows_s[0]) -> None:
        self._window_s = window_s
        self._before: Fix | None = None
        self._speeds: list[tuple[float, float]] = []
        self._steps: deque[_PathStep] = deque()
        self._path_m = self._integral_m = 0.0
        self._squares_m2 = self._with_before_m2 = 0.0
        self.apart = False

    @property
    def difference_m(self) -> float:
        """Path by positions minus integral of speed over the window, m."""
        return self._path_m - self._integral_m

    @property
    def limit_m(self) -> float:
        """Limit of the difference, m; infinite while the path is too short to be judged."""
        if self._path_m < PATH_LENGTH.min_m:
            return math.inf
        change = abs(self._steps[-1].speed_mps - self._steps[0].speed_mps)
        slack_m = max(PATH_LENGTH.position_slack_m, PATH_LENGTH.position_slack_stds * self._fluctuation_m())
        return slack_m + PATH_LENGTH.share * self._path_m + PATH_LENGTH.lag_s * change

    def _fluctuation_m(self) -> float:
        """Return the standard deviation of the difference, m, by positions whose error is a random walk, from
        its steps: their long-run variance to the first lag (Newey and West 1987), in which independent errors
        of positions cancel."""
        n = len(self._steps)
        mean = self.difference_m / n
        variance = self._squares_m2 / n - mean * mean
        covariance = self._with_before_m2 / n - mean * mean
        return math.sqrt(n * max(variance + 2.0 * covariance, 0.0))

    def update(self, fix: Fix) -> None:
        """Update path and integral by a fix, and the finding that they differ."""
        known = math.isfinite(fix.east_m + fix.north_m + fix.speed_mps) and fix.quality not in UNSTEADY
        before = self._before
        if not known or before is None or not self._is_continuous(before, fix):
            self._restart_path(fix if known else None)
            return
        self._speeds.append((fix.time_s, fix.speed_mps))
        if fix.time_s - before.time_s < PATH_LENGTH.step_s:
            return
        self._add_step(before, fix)
        self._before, self._speeds = fix, [(fix.time_s, fix.speed_mps)]
        while self._steps and self._steps[0].time_s < fix.time_s - self._window_s:
            self._drop_oldest()
        limit = self.limit_m
        if math.isfinite(limit):
            self.apart = abs(self.difference_m) > limit * (PATH_LENGTH.agree_share if self.apart else 1.0)

    @staticmethod
    def _is_continuous(before: Fix, fix: Fix) -> bool:
        """Return whether no fix is missing between the two, and both are of one solution."""
        return (
            before.quality == fix.quality and 0.0 < fix.time_s - before.time_s <= PATH_LENGTH.longest_step_s
        )

    def _restart_path(self, fix: Fix | None) -> None:
        """Begin the path again at a fix; the finding stays until another path is long enough."""
        self._before = fix
        self._speeds = [] if fix is None else [(fix.time_s, fix.speed_mps)]
        self._steps.clear()
        self._path_m = self._integral_m = 0.0
        self._squares_m2 = self._with_before_m2 = 0.0

    def _drop_oldest(self) -> None:
        """Remove the oldest step from the sums."""
        gone = self._steps.popleft()
        self._path_m -= gone.path_m
        self._integral_m -= gone.integral_m
        self._squares_m2 -= gone.difference_m**2
        if self._steps:
            self._with_before_m2 -= self._steps[0].with_before_m2

    def _add_step(self, before: Fix, fix: Fix) -> None:
        """Add the arc between two fixes and the integral of speed over it, unless it is slow, a sharp bend or
        a jump."""
        integral = sum(0.5 * (v0 + v1) * (t1 - t0) for (t0, v0), (t1, v1) in pairwise(self._speeds))
        if min(before.speed_mps, fix.speed_mps) < PATH_LENGTH.slowest_mps:
            return
        path = math.hypot(fix.east_m - before.east_m, fix.north_m - before.north_m)
        turn = math.remainder(fix.heading_rad - before.heading_rad, math.tau)
        if abs(turn) > PATH_LENGTH.max_turn_rad:
            return
        if abs(turn) > 1e-3:
            path *= 0.5 * turn / math.sin(0.5 * turn)
        if abs(path - integral) > PATH_LENGTH.jump_m + PATH_LENGTH.jump_share * integral:
            return
        off = path - integral
        product = off * self._steps[-1].difference_m if self._steps else 0.0
        self._steps.append(_PathStep(fix.time_s, path, integral, fix.speed_mps, product))
        self._path_m += path
        self._integral_m += integral
        self._squares_m2 += off * off
        self._with_before_m2 += product
