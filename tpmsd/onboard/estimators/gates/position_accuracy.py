"""Accuracy of a receiver's positions, over the one that it states, by its own Doppler speeds.

In: fixes. Out: the same, with a standard deviation of the position that the speeds bear out.

A position's error is white noise and a slow part, a first-order Gauss-Markov process of which the receiver
states the standard deviation. After poor reception some receivers state decimetres while their positions
slide back by a metre a second (RTK solutions with float ambiguities). Over some seconds T the way between
positions then differs from the integral of the speed by a difference S, by more than the statement explains.
The variance of the slow part is matched to it (covariance matching [Mehra 1970]),

    sigma^2 = stated^2 + max(S^2 - 9 Var(S), 0) / (2 (1 - exp(-T / tau)))

with Var(S) for a slow part of three times the stated size, since makers state theirs differently; what was
added fades as the slow part itself does. Wheels and radii do not enter: a tyre that loses air
makes no receiver look worse. A receiver without speeds is taken at its word. A position that jumps is no
slide but another solution, which the gate judges.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Fix


class _FixWithSums(NamedTuple):
    """A fix, and the sums up to it."""

    fix: Fix
    path_m: float
    """Along the positions."""
    integral_m: float
    """Integral of the speeds."""


class PositionAccuracy:
    """Follows one receiver."""

    def __init__(self) -> None:
        self._passed: deque[_FixWithSums] = deque()
        """Fixes of the window, `SETTINGS.slide_step_s` apart."""
        self._last: Fix | None = None
        self._integral_m = 0.0
        self._direction_rad = math.nan
        """Direction of the last step between two of `_passed`."""
        self._excess_m2, self._found_s = 0.0, -math.inf

    def with_judged_std(self, fix: Fix) -> Fix:
        """Return the fix with the standard deviation of its position that is to be used."""
        before, self._last = self._last, fix
        if before is None or not _speeds_give_distance(before, fix):
            self._restart_window(fix)
        else:
            self._integral_m += 0.5 * (before.speed_mps + fix.speed_mps) * (fix.time_s - before.time_s)
            if fix.time_s - self._passed[-1].fix.time_s >= SETTINGS.slide_step_s:
                self._add_step(fix)
        excess_m2 = self._faded_m2(fix.time_s)
        if excess_m2 == 0.0:
            return fix
        return fix.with_position_std(math.sqrt(fix.position_std_m**2 + excess_m2))

    def _restart_window(self, fix: Fix) -> None:
        """Begin the window with this fix, for the distance to it is not known."""
        self._passed.clear()
        self._passed.append(_FixWithSums(fix, 0.0, 0.0))
        self._integral_m, self._direction_rad = 0.0, math.nan

    def _add_step(self, fix: Fix) -> None:
        """Add the arc to this fix to the window, and raise the excess variance to what the window shows."""
        passed = self._passed
        before = passed[-1]
        east, north = fix.east_m - before.fix.east_m, fix.north_m - before.fix.north_m
        chord_m, rolled_m = math.hypot(east, north), self._integral_m - before.integral_m
        if abs(chord_m - rolled_m) > SETTINGS.slide_jump_m + SETTINGS.slide_jump_share * rolled_m:
            self._restart_window(fix)
            return
        direction_rad = math.atan2(north, east)
        turn = math.remainder(direction_rad - self._direction_rad, math.tau)
        arc = 1.0 + turn * turn / 24.0 if abs(turn) < SETTINGS.slide_max_turn_rad else 1.0  # false for NaN
        self._direction_rad = direction_rad
        passed.append(_FixWithSums(fix, before.path_m + chord_m * arc, self._integral_m))
        while passed[1].fix.time_s <= fix.time_s - SETTINGS.slide_window_s:
            passed.popleft()
        if fix.time_s - passed[0].fix.time_s >= SETTINGS.slide_window_s:
            excess_m2 = _excess_m2(passed[0], passed[-1])
            if excess_m2 >= self._faded_m2(fix.time_s):
                self._excess_m2, self._found_s = excess_m2, fix.time_s

    def _faded_m2(self, time_s: float) -> float:
        """Return the excess variance found last, m^2, faded by the time since."""
        if self._excess_m2 == 0.0:
            return 0.0
        return self._excess_m2 * math.exp(-2.0 * max(time_s - self._found_s, 0.0) / SETTINGS.bias_tau_s)


def _speeds_give_distance(before: Fix, fix: Fix) -> bool:
    """Return whether the Doppler speeds of two fixes give the distance between them."""
    known = math.isfinite(fix.east_m + fix.north_m)
    fast = min(before.speed_mps, fix.speed_mps) > SETTINGS.slide_slowest_mps  # false for NaN
    return known and fast and 0.0 < fix.time_s - before.time_s <= SETTINGS.block_max_s


def _excess_m2(first: _FixWithSums, last: _FixWithSums) -> float:
    """Return the variance of the slow position error between two fixes beyond the stated one, m^2."""
    span_s = last.fix.time_s - first.fix.time_s
    path_m = last.path_m - first.path_m
    difference_m = path_m - (last.integral_m - first.integral_m)
    growth = -2.0 * math.expm1(-span_s / SETTINGS.bias_tau_s)
    stated_m = max(first.fix.position_std_m, last.fix.position_std_m)
    doppler_mps = SETTINGS.doppler_mps * max(first.fix.speed_noise, last.fix.speed_noise)
    expected_m2 = (
        2.0 * min(SETTINGS.white_position_m, stated_m) ** 2
        + growth * (SETTINGS.slide_tolerated * stated_m) ** 2
        + doppler_mps**2 * 2.0 * SETTINGS.doppler_tau_s * span_s
        + (SETTINGS.slide_lag_s * (last.fix.speed_mps - first.fix.speed_mps)) ** 2
        + (SETTINGS.slide_share * path_m) ** 2
    )
    return max(difference_m**2 - SETTINGS.slide_stds**2 * expected_m2, 0.0) / growth
