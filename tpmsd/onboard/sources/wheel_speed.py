"""One wheel's speed signal, integrated to an angle, for buses that carry no counters.

In: time stamp and angular speed of each reading, in order of time. Out: `RotationSample` events with
`quantum_rad` 0; faults to the log. The rule is the trapezoid, exact for a speed that changes evenly between
two readings:

    angle += (omega + omega before) / 2 * interval

A speed that no car can have, or have reached since the reading before, is a suspect: if the next reading
returns, it was a single odd value; if the next one agrees with it, a new segment begins there. So does one
after a silence longer than the time-out, for nobody knows how the speed was in between.
"""

from __future__ import annotations

import copy
import math

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.sources.ahead.regular_readings import (
    RegularReadings,
    first_run_too_long,
    first_true,
    none_regular,
    still_runs,
)
from tpmsd.onboard.sources.can.arrival import MIN_TIMEOUT_S, TIMEOUT_PERIODS
from tpmsd.onboard.sources.can.faults import FaultLog
from tpmsd.onboard.sources.events import Event, RotationSample
from tpmsd.onboard.sources.settings import SETTINGS
from tpmsd.onboard.sources.wheel_counter import MAX_ACCEL_MPS2, MAX_SPEED_MPS, STUCK_S

SLACK_MPS = 1.0
"""Many senders round slow speeds to zero, so a wheel seems to start with a step."""
STUCK_ZERO_M = 2.0
"""Distance that the other wheels have rolled while this one reports zero, m."""
FINE_MPS = 0.03
"""0.1 km/h: a single tooth of a ring makes more of a difference from frame to frame."""


class FrozenSpeeds:
    """Detects speeds of several wheels that all stay the same to the last bit: their sender or a gateway
    hangs.

    Noise makes them differ from frame to frame, some signals more and some less. So a stretch is frozen that
    is several times as long as the longest one of the last minutes, or longer than `frozen_s`, and in which
    the noise would have turned the signal back and forth `noise_turns` times. A signal that turns as rarely
    as the car's own speed does carries no noise (a simulator's, a smoothing sender's): there an even speed
    is an even speed, and a sender that hangs shows by the receiver.
    """

    __slots__ = ("_before", "_longest_s", "_moving_s", "_run_s", "_since_s", "_turns", "trackers")

    def __init__(self, trackers: tuple[WheelSpeedIntegrator, ...]) -> None:
        self.trackers = trackers
        self._run_s = self._longest_s = 0.0
        self._since_s = math.nan
        self._before = (math.nan, 0.0, 0.0)
        """Time and speed of the reading before, and in which direction the speed last changed."""
        self._moving_s = self._turns = 0.0

    def judge(self, time_s: float) -> tuple[WheelSpeedIntegrator, ...]:
        """Return the wheels that are found frozen with the frame at `time_s`."""
        still_s = -math.inf
        for tracker in self.trackers:
            since_s = tracker.still_since
            if since_s is None or tracker.stuck or not abs(tracker.speed_mps) > SETTINGS.frozen_mps:
                still_s = math.inf
                break
            still_s = max(still_s, since_s)
        return self.trackers if self.update(time_s, still_s, self.trackers[0].speed_mps) else ()

    def copied(self) -> FrozenSpeeds:
        """Return an independent copy."""
        return copy.copy(self)

    def update(self, time_s: float, still_s: float, speed_mps: float) -> bool:
        """Update by a frame after which the last of all speeds is the same since `still_s` (infinite: they
        are not) and the first wheel's is `speed_mps`; return whether they are frozen."""
        if math.isnan(self._since_s) or time_s < self._since_s:
            self._since_s = time_s
        if still_s == math.inf:
            self._longest_s = max(self._run_s, SETTINGS.frozen_forget * self._longest_s)
            self._run_s = 0.0
            self._count_noise_turns(time_s, speed_mps)
            return False
        self._run_s = max(time_s - still_s, 0.0)
        typical_s = SETTINGS.frozen_s
        if time_s - self._since_s > SETTINGS.frozen_learn_s:
            typical_s = min(
                max(SETTINGS.frozen_runs * self._longest_s, SETTINGS.frozen_min_s), SETTINGS.frozen_s
            )
        return self._run_s > max(typical_s, SETTINGS.noise_turns * self._moving_s / (1.0 + self._turns))

    def _count_noise_turns(self, time_s: float, speed_mps: float) -> None:
        """Count how often the first wheel's speed turns from rising to falling, in motion."""
        before_s, before_mps, direction = self._before
        change = speed_mps - before_mps
        if 0.0 < time_s - before_s < SETTINGS.frozen_s and abs(speed_mps) > SETTINGS.frozen_mps:
            self._moving_s = SETTINGS.frozen_forget * self._moving_s + time_s - before_s
            self._turns = SETTINGS.frozen_forget * self._turns + (change * direction < 0.0)
        self._before = (time_s, speed_mps, change or direction)


class WheelSpeedIntegrator:
    """Integrates the speed of one wheel."""

    __slots__ = (
        "_angle",
        "_faults",
        "_omega",
        "_suspect",
        "_time_s",
        "_turned",
        "radius_m",
        "segment",
        "still_since",
        "stuck",
        "wheel",
    )

    def __init__(self, wheel: int, radius_m: float, faults: FaultLog) -> None:
        self.wheel = wheel
        self.segment = -1
        self.still_since: float | None = None
        """Time of the first reading with the value that has not changed since; None while it changes."""
        self.stuck = False
        self._faults = faults
        self.radius_m = radius_m
        self._omega: float | None = None
        self._time_s = 0.0
        self._angle = 0.0
        self._turned = 0.0
        self._suspect: tuple[float, float] | None = None

    @property
    def travel_m(self) -> float:
        """Distance rolled since the start over all segments, by the nominal radius, m."""
        return self._turned * self.radius_m

    @property
    def speed_mps(self) -> float:
        """The last reading; NaN before there is one."""
        return math.nan if self._omega is None else self._omega * self.radius_m

    @property
    def stopped_impossibly(self) -> bool:
        """True if the value stopped changing while the wheel must have turned on, as in `WheelCounter`;
        impossible speeds were rejected before."""
        return False

    def update(self, time_s: float, omega_radps: float, period_s: float, out: list[Event]) -> None:
        """Judge one reading; append its sample or its fault. `period_s` is the message's period (0: not
        known)."""
        before = self._omega
        if self.stuck and omega_radps == before:
            return
        if before is None or self.stuck:
            if abs(omega_radps) * self.radius_m > MAX_SPEED_MPS:
                self._faults.note(out, time_s, "jump", self.wheel, f"{omega_radps * self.radius_m:.1f} m/s")
                return
            self._begin_segment(time_s, omega_radps, out)
            return
        interval = time_s - self._time_s
        if interval <= 0.0:
            self._faults.note(out, time_s, "late", self.wheel)
            return
        if not self._can_follow(before, omega_radps, interval, period_s):
            self._judge_implausible(time_s, omega_radps, period_s, out)
            return
        if self._suspect is not None:
            self._drop_suspect(self._suspect, out)
        if interval > max(MIN_TIMEOUT_S, TIMEOUT_PERIODS * period_s):
            self._begin_segment(time_s, omega_radps, out)
            return
        turned = 0.5 * (before + omega_radps) * interval
        self._angle += turned
        self._turned += turned
        if omega_radps != before:
            self.still_since = None
            self._omega = omega_radps
        elif self.still_since is None:
            self.still_since = self._time_s
        self._time_s = time_s
        out.append(RotationSample(time_s, self.wheel, self._angle, 0.0, self.segment))

    def regular_readings(
        self, time_s: FloatArray, omega_radps: FloatArray, period_s: FloatArray
    ) -> RegularReadings:
        """Return the readings that `update` would make of n readings, as far as they are regular; changes
        nothing.

        `time_s` (n,): rising times; `omega_radps` (n,); `period_s` (n,): the message's period at each.
        """
        count = len(time_s)
        if self._omega is None or self.stuck or self.still_since is not None or self._suspect is not None:
            return none_regular(count)
        before = np.append(self._omega, omega_radps)[:-1]
        before_s = np.append(self._time_s, time_s)[:-1]
        interval = time_s - before_s
        change = np.abs(omega_radps - before) * self.radius_m
        irregular = np.abs(omega_radps) * self.radius_m > MAX_SPEED_MPS
        irregular |= ~(change <= MAX_ACCEL_MPS2 * (interval + 2.0 * period_s) + SLACK_MPS)
        irregular |= interval > np.maximum(MIN_TIMEOUT_S, TIMEOUT_PERIODS * period_s)
        turned = 0.5 * (before + omega_radps) * interval
        angle = np.add.accumulate(np.append(self._angle, turned))
        travelled = np.add.accumulate(np.append(self._turned, turned))
        same = omega_radps == before
        begin, since = still_runs(same, before_s)
        run = np.where(same, time_s - since, 0.0)
        last = np.arange(count) == count - 1
        too_long = same & ((run > np.where(omega_radps == 0.0, STUCK_S, SETTINGS.frozen_s)) | last)

        def commit() -> None:
            self._omega, self._time_s = float(omega_radps[-1]), float(time_s[-1])
            self._angle, self._turned = float(angle[-1]), float(travelled[-1])

        regular = min(first_true(irregular), first_run_too_long(begin, too_long))
        return RegularReadings(angle[1:], since, regular, commit)

    def restart(self) -> None:
        """Forget the reading before: the clock stepped. The next reading begins a segment."""
        self._omega = self._suspect = None

    def is_stuck(self, time_s: float, others_m: list[float], others_change_mps: list[float]) -> bool | None:
        """Return whether the value stands still while the wheel's speed cannot; None: too early to tell.

        `others_m` and `others_change_mps`: ways rolled and changes of speed of the other wheels since
        `still_since`. Two of them must speak against it (one, if there is but one).
        """
        assert self.still_since is not None
        needed = min(2, max(1, len(others_m)))
        still_s = time_s - self.still_since
        if self._omega == 0.0:
            if still_s <= STUCK_S:
                return None
            return sum(abs(distance_m) >= STUCK_ZERO_M for distance_m in others_m) >= needed
        if still_s <= SETTINGS.frozen_s:
            return None
        return sum(abs(change) >= SETTINGS.frozen_mps for change in others_change_mps) >= needed

    def shows_noise(self, step_radps: float) -> bool:
        """Return whether a signal of this resolution shows the noise that every wheel speed has."""
        return abs(step_radps) * self.radius_m <= FINE_MPS

    def mark_stuck(self) -> None:
        """Withhold samples until the value changes; that begins a new segment."""
        self.stuck = True
        self._suspect = None

    def mark_standstill(self) -> None:
        """Do nothing: the value may well be constant, and its samples were never withheld."""

    def _can_follow(self, before: float, after: float, interval: float, period_s: float) -> bool:
        """Return whether a wheel can change its speed (rad/s) so in the interval; stamps may be off by a
        period each."""
        if abs(after) * self.radius_m > MAX_SPEED_MPS:
            return False
        change = abs(after - before) * self.radius_m
        return change <= MAX_ACCEL_MPS2 * (interval + 2.0 * period_s) + SLACK_MPS

    def _begin_segment(self, time_s: float, omega_radps: float, out: list[Event]) -> None:
        """Begin a new segment with this reading as its origin."""
        self.segment += 1
        self._omega, self._time_s, self._angle = omega_radps, time_s, 0.0
        self.still_since = None
        self.stuck = False
        self._suspect = None
        out.append(RotationSample(time_s, self.wheel, 0.0, 0.0, self.segment))

    def _judge_implausible(
        self, time_s: float, omega_radps: float, period_s: float, out: list[Event]
    ) -> None:
        """Judge a reading that cannot follow the last one: it is irregular itself and held as suspect, or the
        first of a new level."""
        suspect = self._suspect
        if suspect is not None:
            interval = time_s - suspect[0]
            if interval > 0.0 and self._can_follow(suspect[1], omega_radps, interval, period_s):
                detail = f"to {suspect[1] * self.radius_m:.1f} m/s"
                self._faults.note(out, suspect[0], "jump", self.wheel, detail)
                self._begin_segment(time_s, omega_radps, out)
                return
            self._drop_suspect(suspect, out)
        self._suspect = (time_s, omega_radps)

    def _drop_suspect(self, suspect: tuple[float, float], out: list[Event]) -> None:
        """Report the suspect reading as a single jump, and forget it."""
        detail = f"single odd value {suspect[1] * self.radius_m:.1f} m/s"
        self._faults.note(out, suspect[0], "jump", self.wheel, detail)
        self._suspect = None
