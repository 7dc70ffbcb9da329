"""Check whether wheels and receiver report the same drive; where they do not, no tyre may be judged by them.

In: ticks, and the radii estimated some time ago. Out: `Agreement`: whether fixes are withheld from
the estimator, and whether anything may be judged. A receiver that replays another drive, wheels of another
car's DBC, a ferry, stamps that jump: each would be reported as radii that changed.

Each fix with a speed is held against all wheels. It is off when *every* wheel is off by more than noise, lag
and unknown radii can explain: one soft, spinning or locked wheel leaves the others. Half of the fixes of ten
seconds off is a disagreement; it ends when positions, speeds and wheels have agreed for half as long
as it lasted, 10 to 40 s. The receiver is held against itself, too: its positions against its speed
(`path_length`); where they part, wheels may follow the one that is wrong.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from statistics import median

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.gates.path_length import PathLength
from tpmsd.onboard.estimators.settings import AGREEMENT, PATH_LENGTH
from tpmsd.onboard.timeline.tick import Fix, Tick

FAULT_KINDS = frozenset({"jump", "reset", "late", "implausible"})


@dataclass(frozen=True, slots=True)
class Agreement:
    """Check of what may be trusted of a tick."""

    withheld: bool
    """Wheels and receiver disagree, or did a moment ago: the fixes are not for the estimator."""
    unsteady: bool
    """The wheels' readings are faulty again and again."""
    began: bool
    """One of them has just begun: what was estimated in the last seconds is not to be trusted."""
    recovering: bool = False
    """Wheels and receiver agree again, and not yet for so long that the fixes are given."""

    @property
    def trusted(self) -> bool:
        """True if tyres may be judged."""
        return not (self.withheld or self.unsteady)


AGREED = Agreement(withheld=False, unsteady=False, began=False)


class AgreementWatch:
    """Follows wheels and receiver of one car."""

    def __init__(self) -> None:
        # Plain numbers: for four of them numpy takes ten times as long, and this is asked every tick.
        self._speeds = [math.nan] * 4
        self._accel = 0.0
        self._radius_m: FloatArray | None = None
        self._radii: list[float] = []
        self._mean_m = math.nan
        self._window: deque[tuple[float, bool]] = deque()
        self._off = 0
        """Number of the window's samples that disagree."""
        self._paths = [PathLength(window_s) for window_s in PATH_LENGTH.windows_s]
        self._anchor: Fix | None = None
        self._withheld = self._unsteady = self._recovering = False
        self._bad_s = self._good_s = 0.0
        self._faulty: deque[float] = deque()

    def update(self, tick: Tick, radius_m: FloatArray, radius_std_m: float) -> Agreement:
        """Update by one tick and return the agreement. radius_m (4,): present estimate of the radii;
        radius_std_m: standard deviation of their common part."""
        if radius_m is not self._radius_m:
            self._radius_m, self._radii, self._mean_m = (
                radius_m,
                radius_m.tolist(),
                float(np.nanmean(radius_m)),
            )
        self._update_speeds(tick)
        share = AGREEMENT.speed_share + 3.0 * radius_std_m / self._mean_m
        for fix in tick.fixes:
            self._compare_speeds(fix, share)
            for path in self._paths:
                path.update(fix)
        while self._window and self._window[0][0] < tick.time_s - AGREEMENT.window_s:
            self._off -= self._window.popleft()[1]
        was = self._withheld or self._unsteady
        self._update_decision(tick.dt_s)
        self._update_faults(tick)
        now = self._withheld or self._unsteady
        if not now:
            return AGREED
        return Agreement(self._withheld, self._unsteady, not was, self._withheld and self._recovering)

    def _update_speeds(self, tick: Tick) -> None:
        """Smooth the wheels' speeds and their common acceleration by a tick."""
        if tick.gap_s > 0.0:
            self._speeds = [math.nan] * 4
        dt_s = tick.dt_s
        share = 1.0 - math.exp(-dt_s / AGREEMENT.smoothing_s)
        moved: list[float] = []
        steps: list[float] = []
        for before, turned, radius_m in zip(
            self._speeds, tick.rotation_rad.tolist(), self._radii, strict=True
        ):
            speed = turned * radius_m / dt_s
            if math.isfinite(before):
                speed = before + share * (speed - before)
                if math.isfinite(speed):
                    steps.append(speed - before)
            moved.append(speed)
        if steps:
            self._accel += share * (median(steps) / dt_s - self._accel)
        self._speeds = moved

    def _compare_speeds(self, fix: Fix, share: float) -> None:
        """Note whether the wheels' speeds disagree with a fix's speed or with that by positions; `share`:
        relative tolerance."""
        wheels = [speed for speed in self._speeds if math.isfinite(speed)]
        if not wheels:
            return
        speed = fix.speed_mps
        fastest = max(median(wheels), speed if math.isfinite(speed) else 0.0)
        chord = self._chord_speed(fix)
        if fastest < AGREEMENT.moving_mps:
            return
        lag = AGREEMENT.lag_s * abs(self._accel)
        off = False
        if math.isfinite(speed):
            off = min(abs(one - speed) for one in wheels) > AGREEMENT.speed_noise_mps + share * fastest + lag
        if math.isfinite(chord):
            limit = AGREEMENT.position_noise_mps + (AGREEMENT.position_share + share) * fastest + lag
            off = off or min(abs(one - chord) for one in wheels) > limit
        if math.isfinite(speed) or math.isfinite(chord):
            self._window.append((fix.time_s, off))
            self._off += off

    def _chord_speed(self, fix: Fix) -> float:
        """Return the speed by positions over one second or more, m/s; NaN where it is not known (in a bend it
        is too small by less than the limit)."""
        anchor = self._anchor
        if anchor is None or not 0.0 <= fix.time_s - anchor.time_s <= 3.0:
            self._anchor = fix
            return math.nan
        if fix.time_s - anchor.time_s < 0.95:
            return math.nan
        self._anchor = fix
        travel = math.hypot(fix.east_m - anchor.east_m, fix.north_m - anchor.north_m)
        return travel / (fix.time_s - anchor.time_s)

    def _update_decision(self, dt_s: float) -> None:
        """Withhold fixes while too many disagree; trust them again after a time of agreement."""
        enough = (
            len(self._window) >= AGREEMENT.min_fixes
            and self._window[-1][0] - self._window[0][0] >= AGREEMENT.min_span_s
        )
        if not enough:
            return
        off = self._off / len(self._window)
        self._recovering = False
        if off >= AGREEMENT.off_share or any(path.apart for path in self._paths):
            self._withheld, self._good_s = True, 0.0
            self._bad_s += dt_s
        elif self._withheld and off > AGREEMENT.fair_share:
            self._good_s = 0.0
        elif self._withheld:
            self._recovering = True
            self._good_s += dt_s
            if self._good_s >= min(
                max(AGREEMENT.recover_share * self._bad_s, AGREEMENT.recover_s[0]), AGREEMENT.recover_s[1]
            ):
                self._withheld, self._bad_s = False, 0.0

    def _update_faults(self, tick: Tick) -> None:
        """Count the intervals with faults of the bus, and decide by them whether the wheels' signals are
        unsteady."""
        if tick.faults and any(fault.source == "can" and fault.kind in FAULT_KINDS for fault in tick.faults):
            bin_s = AGREEMENT.fault_bin_s * math.floor(tick.time_s / AGREEMENT.fault_bin_s)
            if not self._faulty or self._faulty[-1] != bin_s:
                self._faulty.append(bin_s)
        while (
            self._faulty and self._faulty[0] < tick.time_s - AGREEMENT.faults_window_s - AGREEMENT.fault_bin_s
        ):
            self._faulty.popleft()
        if self._unsteady:
            self._unsteady = (
                bool(self._faulty)
                and tick.time_s - self._faulty[-1] < AGREEMENT.fault_bin_s + AGREEMENT.steady_s
            )
        else:
            self._unsteady = (
                len(self._faulty) >= AGREEMENT.fault_bins
                and self._faulty[-1] + AGREEMENT.fault_bin_s > tick.time_s
            )
