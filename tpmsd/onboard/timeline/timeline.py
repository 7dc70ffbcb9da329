"""One merge of both streams into fixed-rate ticks.

In: events in the order of their host time stamps (`add`), and the passing of time (`advance`). Out: `Tick`s.

Time comes from the stamps alone. A tick that ends at t is made once the stamps have passed t + holdback; it
sees just what was stamped by then, whether that came from a socket or a file, so live and replay make the
same ticks. The holdback covers the receiver's epoch (sentences gathered up to a quarter second), transport
jitter and known latency.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.sources.ahead.decoded_block import DecodedBlock
from tpmsd.onboard.sources.events import (
    Event,
    GnssFix,
    InertialSample,
    RotationRun,
    RotationSample,
    SourceFault,
)
from tpmsd.onboard.timeline.host_clock import BACKWARD_STEP_S, HostClock
from tpmsd.onboard.timeline.local_plane import LocalPlane
from tpmsd.onboard.timeline.plausible import implausible_wheels
from tpmsd.onboard.timeline.reading_track import ReadingTrack
from tpmsd.onboard.timeline.rotation_track import RotationTrack, rotation_between
from tpmsd.onboard.timeline.speed_accuracy import SpeedAccuracy
from tpmsd.onboard.timeline.tick import Fix, Tick
from tpmsd.onboard.timeline.tick_plan import TickPlan, TickReadings, plan_ticks
from tpmsd.onboard.timeline.utc_offset import UtcOffsetTracker

HOLDBACK_S = 0.45
HOLDBACK_MARGIN_S = 0.1
MAX_HOLDBACK_S = 2.5
MAX_PAUSE_S = 5.0
"""Silence of all sources longer than this is skipped as a gap instead of being filled with empty ticks."""
MAX_AHEAD_S = 1.0
"""Time by which a fix may arrive before it is valid, at most, s; the error of the clocks' offset is far
less."""
MAX_MOVE_S = 0.03
"""A fix that missed its tick by no more than this is taken at the start of the next: 1 m on a motorway."""
HOLD_S = {"ambient_temp": 120.0}
HOLD_DEFAULT_S = 1.0

FIELDS = {
    "yaw_rate": "yaw_rate_radps",
    "accel_long": "accel_long_mps2",
    "accel_lat": "accel_lat_mps2",
    "steering_wheel_angle": "steering_wheel_angle_rad",
    "brake_pressure": "brake_pressure_pa",
    "drive_torque": "drive_torque_nm",
    "ambient_temp": "ambient_temp_k",
    "abs_active": "abs_active",
    "esc_active": "esc_active",
    "brake_active": "brake_active",
    "tyre_set": "tyre_set",
}


class _Timed(NamedTuple):
    """A fix that waits for its tick."""

    time_s: float
    """Time of validity, s."""
    lag_s: float
    """Arrival minus validity."""
    east_m: float
    north_m: float
    heading_rad: float
    speed_noise: float
    fix: GnssFix


class TickPlanner(Protocol):
    """Computes ticks ahead of the samples that they are made of."""

    def planned_tick(self, index: int, end_s: float) -> TickReadings | None:
        """Return rotations and readings of the tick that is about to be made; None if it is not planned, and
        then the timeline has been given all samples up to there (`Timeline.add_samples`)."""
        ...


class RotationObserver(Protocol):
    """Receives every rotation sample at its own stamp, for quantities that ticks are too slow for."""

    def add(self, sample: RotationSample) -> None:
        """Process one sample."""
        ...

    def extend(self, run: RotationRun) -> bool:
        """Process many samples of one wheel at once and return True; return False to get them one by
        one."""
        ...


class Timeline:
    """Merges events into ticks."""

    def __init__(self, rate_hz: float, latency_s: float = 0.0, host_on_utc: bool = False) -> None:
        self._dt_s = 1.0 / rate_hz
        self._holdback_s = HOLDBACK_S + latency_s
        self._clock = HostClock()
        self._offset = UtcOffsetTracker(latency_s, host_on_utc)
        self._plane = LocalPlane()
        self._accuracy = SpeedAccuracy()
        self._tracks = [RotationTrack() for _ in range(4)]
        self._inertial: dict[str, ReadingTrack] = {}
        self._fixes: list[_Timed] = []
        self._faults: list[SourceFault] = []
        self._origin_s = 0.0
        self._index = 0
        self._due_s = -math.inf
        """Time at which the next tick is made; before the first event there is none."""
        self._gap_s = 0.0
        self._planner: TickPlanner | None = None
        self._planned_ends_s: list[float] = []
        """Ends of ticks that the tracks know nothing of yet."""
        self._observer: RotationObserver | None = None
        self._observer_delay_s = 0.0
        self._on_fix: Callable[[GnssFix], None] | None = None
        self.counts: dict[str, int] = {
            "ticks": 0,
            "late_fixes": 0,
            "early_fixes": 0,
            "off_utc": 0,
            "clock_steps": 0,
            "gaps": 0,
            "implausible": 0,
        }

    def set_planner(self, planner: TickPlanner) -> None:
        """Set the planner that is asked for each tick before it is interpolated from samples."""
        self._planner = planner

    def observe_rotations(self, observer: RotationObserver, delay_s: float = 0.0) -> None:
        """Show every rotation sample to `observer`, at most `delay_s` after the tick that it belongs to."""
        self._observer, self._observer_delay_s = observer, delay_s

    def observe_fixes(self, on_fix: Callable[[GnssFix], None]) -> None:
        """Call `on_fix` with every fix as the receiver sent it, before it is put into the plane."""
        self._on_fix = on_fix

    def observer_needs(self, end_s: float, shown_s: float) -> bool:
        """Return whether the observer must be shown the samples before a tick's end, having been shown those
        before `shown_s`."""
        return self._observer is not None and end_s >= shown_s + self._observer_delay_s

    def add(self, event: Event) -> list[Tick]:
        """Add one event; return the ticks that its stamp completes."""
        if isinstance(event, GnssFix):
            return self._add_fix(event)
        clock = self._clock
        now = clock.to_logical(event.time_s)
        ticks: list[Tick] = []
        if now != clock.latest_s:  # as a rule the frame that brought the event let time pass already
            ticks = self.advance(event.time_s)
            now = clock.to_logical(event.time_s)
        if isinstance(event, RotationSample):
            if now != event.time_s:
                event = RotationSample(now, event.wheel, event.angle_rad, event.quantum_rad, event.segment)
            self._tracks[event.wheel].add(event)
            if self._observer is not None:
                self._observer.add(event)
        elif isinstance(event, InertialSample):
            if math.isfinite(event.value) and event.role in FIELDS:
                self._reading_track(event.role).add(now, event.value)
        else:
            self._faults.append(event)
        return ticks

    def _add_fix(self, fix: GnssFix) -> list[Tick]:
        """Add a fix, which bears the arrival of its epoch's first sentence and comes when the last is in;
        return the ticks that it completes.

        At 9600 baud with all the sentences that a receiver is able to say, that is most of a second: the
        stamp is no step of the clock, and the holdback grows to what the receiver needs (and stays there).
        """
        if self._on_fix is not None:
            self._on_fix(fix)
        arrival = self._clock.to_logical(fix.arrival_s)
        ticks = self.advance(fix.arrival_s) if arrival > self._clock.latest_s else []
        arrival = self._clock.to_logical(fix.arrival_s)
        valid = self._queue_fix(fix, arrival)
        needed = self._clock.latest_s - valid + HOLDBACK_MARGIN_S
        if self._holdback_s < needed < MAX_HOLDBACK_S:
            self._holdback_s = needed
            self._due_s = self._tick_end_s(self._index + 1) + needed
        return ticks

    def advance(self, host_time_s: float) -> list[Tick]:
        """Advance to a host stamp; return the ticks that are complete by then."""
        clock = self._clock
        before, steps = clock.latest_s, clock.steps
        now = clock.advance(host_time_s)
        if clock.steps != steps:
            self.counts["clock_steps"] += 1
            self._faults.append(SourceFault(host_time_s, "clock", "step_back", "the host clock stepped back"))
        if before == -math.inf:
            self._start_ticks(now)
        elif now - before > MAX_PAUSE_S:
            ticks = self._make_due_ticks(before + self._holdback_s)
            self._restart_after_gap(now)
            return ticks
        return self._make_due_ticks(clock.latest_s) if clock.latest_s >= self._due_s else []

    def advance_if_nothing_due(self, host_time_s: float) -> bool:
        """Advance to a host stamp and return True; return False and change nothing where a tick is due, the
        clock steps or there was a pause, which is for `advance`."""
        clock = self._clock
        now = clock.to_logical(host_time_s)
        if not clock.latest_s <= now < self._due_s:
            return False
        clock.latest_s = now
        return True

    # -- many samples at once --------------------------------------------------------------------------------

    @property
    def due_s(self) -> float:
        """Time at which the next tick is made; minus infinity before the first event."""
        return self._due_s

    @property
    def shift_s(self) -> float:
        """Logical time minus the host's."""
        return self._clock.to_logical(0.0)

    def follows_without_pause(self, host_time_s: float) -> bool:
        """Return whether a host stamp is not before the latest one and no pause behind it."""
        return 0.0 <= self._clock.to_logical(host_time_s) - self._clock.latest_s <= MAX_PAUSE_S

    def is_continuous(self, time_s: FloatArray) -> bool:
        """Return whether host stamps (n,) follow the latest one with no step of the clock and no pause."""
        before = self._clock.latest_s
        now = np.append(before, time_s + self.shift_s)
        latest = np.maximum.accumulate(now)
        return bool(
            math.isfinite(before)
            and np.all(now >= latest - BACKWARD_STEP_S)
            and np.all(np.diff(latest) <= MAX_PAUSE_S)
        )

    def advance_clock(self, host_time_s: float) -> None:
        """Advance the latest stamp to one at which no tick is due; never backward."""
        clock = self._clock
        clock.latest_s = max(clock.latest_s, clock.to_logical(host_time_s))

    def plan(self, decoded: DecodedBlock) -> TickPlan | None:
        """Return rotations and readings of the ticks that a decoded block covers; None if it covers none."""
        groups, shift_s, begin_s = decoded.groups, self.shift_s, self._tick_end_s(self._index)
        last_s = max((float(group.time_s[-1]) for group in groups), default=-math.inf) + shift_s
        ticks = math.floor((last_s - begin_s) / self._dt_s) if last_s > begin_s else 0
        edges_s = self._origin_s + (np.arange(ticks + 1) + (self._index - self._index_base)) * self._dt_s
        roles = {*self._inertial, *(one.role for one in decoded.readings)} & FIELDS.keys()
        readings = {FIELDS[role]: (role, self._reading_track(role)) for role in sorted(roles)}
        return plan_ticks(decoded, shift_s, self._tracks, readings, self._index + 1, np.asarray(edges_s))

    def add_samples(
        self,
        rotations: Sequence[RotationRun],
        readings: Sequence[tuple[str, list[float], list[float]]],
        shift_s: float,
    ) -> None:
        """Add samples, as `add` of each, at stamps to which time has advanced; of each wheel and each role
        (with times and values, all finite) one at least. `shift_s`: logical time minus the host's then."""
        if shift_s:
            rotations = [run._replace(time_s=[at_s + shift_s for at_s in run.time_s]) for run in rotations]
        for run in rotations:
            self._tracks[run.wheel].extend(run)
        for role, times_s, values in readings:
            if role in FIELDS:
                logical_s = [time_s + shift_s for time_s in times_s] if shift_s else times_s
                self._reading_track(role).extend(logical_s, values)
        self._show_observer(rotations)
        if ends_s := self._planned_ends_s:
            for track in self._tracks:
                track.forget_before(ends_s[-1])
            for inertial in self._inertial.values():
                inertial.drop_used(ends_s)
            ends_s.clear()

    def _show_observer(self, rotations: Sequence[RotationRun]) -> None:
        """Give rotation samples to the observer: whole runs where it takes them, else one by one in the order
        of the frames."""
        observer = self._observer
        if observer is None:
            return
        runs = [run for run in rotations if not observer.extend(run)]
        # In the order of the frames, and within one in the order of its wheels.
        shown = [(frame, k, row) for k, run in enumerate(runs) for row, frame in enumerate(run.frame_indices)]
        for _, k, row in sorted(shown):
            run = runs[k]
            sample = run.time_s[row], run.wheel, run.angle_rad[row], run.quantum_rad, run.segment
            observer.add(RotationSample(*sample))

    def _reading_track(self, role: str) -> ReadingTrack:
        """Return the track of a role's readings, made on first use."""
        if role not in self._inertial:
            self._inertial[role] = ReadingTrack(HOLD_S.get(role, HOLD_DEFAULT_S))
        return self._inertial[role]

    def finish(self) -> list[Tick]:
        """Return the ticks that the end of a recording completes."""
        latest_s = self._clock.latest_s
        return [] if latest_s == -math.inf else self._make_due_ticks(latest_s + self._holdback_s)

    def _start_ticks(self, now: float) -> None:
        """Begin the grid of ticks at a logical time, rounded down to the tick length."""
        self._origin_s = math.floor(now / self._dt_s) * self._dt_s
        self._index_base = self._index
        self._due_s = self._tick_end_s(self._index + 1) + self._holdback_s

    def _restart_after_gap(self, now: float) -> None:
        """Drop all samples and begin the ticks again behind a pause of all sources, or a forward step of the
        clock."""
        end = self._tick_end_s(self._index)
        self.counts["gaps"] += 1
        self._gap_s += max(now - end, 0.0)
        for track in self._tracks:
            track.clear()
        for readings in self._inertial.values():
            readings.clear()
        self._fixes.clear()
        self._start_ticks(now)

    def _tick_end_s(self, index: int) -> float:
        """Return the logical time at which a tick ends."""
        return self._origin_s + (index - self._index_base) * self._dt_s

    def _make_due_ticks(self, now: float) -> list[Tick]:
        """Return all ticks that are due at a logical time, made now."""
        ticks: list[Tick] = []
        while self._due_s <= now:
            self._index += 1
            self._due_s = self._tick_end_s(self._index + 1) + self._holdback_s
            # The very number at which the tick before ended: rotations then add up without a seam.
            ticks.append(self._make_tick(self._tick_end_s(self._index - 1), self._tick_end_s(self._index)))
        return ticks

    def _make_tick(self, begin: float, end: float) -> Tick:
        """Return the tick of a span; its fixes and faults leave their buffers."""
        plan = None if self._planner is None else self._planner.planned_tick(self._index, end)
        if plan is None:
            plan = self._interpolate_tick(begin, end)
        else:
            self._planned_ends_s.append(end)
        rotation, std, means = plan
        for wheel in implausible_wheels(rotation.tolist(), self._dt_s):
            rotation[wheel] = std[wheel] = math.nan
            self.counts["implausible"] += 1
            at_s = self._clock.to_host(end)
            self._faults.append(SourceFault(at_s, "can", "implausible", "turns unlike the others", wheel))
        fixes = tuple(self._take_fixes(begin, end))
        faults, self._faults = tuple(self._faults), []
        gap, self._gap_s = self._gap_s, 0.0
        self.counts["ticks"] += 1
        return Tick(
            index=self._index,
            time_s=end,
            dt_s=self._dt_s,
            rotation_rad=rotation,
            rotation_std_rad=std,
            fixes=fixes,
            host_time_s=self._clock.to_host(end),
            gap_s=gap,
            faults=faults,
            **means,
        )

    def _interpolate_tick(self, begin: float, end: float) -> TickReadings:
        """Return the rotations and mean readings between two times by the tracks; drop the readings used."""
        found = [rotation_between(track, begin, end) for track in self._tracks]
        for track in self._tracks:
            track.forget_before(end)
        rotation, std = np.array(found).T.copy()
        means = {FIELDS[role]: track.take_mean(end) for role, track in self._inertial.items()}
        return TickReadings(rotation, std, means)

    def _queue_fix(self, fix: GnssFix, arrival: float) -> float:
        """Return a fix's logical time of validity; queue it, in the plane, for the tick of that time unless
        it is unusable, too early or too late."""
        valid = self._offset.update(arrival, fix.utc_s)
        self.counts["off_utc"] += self._offset.off_utc
        if not (math.isfinite(fix.latitude_deg) and math.isfinite(fix.longitude_deg)):
            return valid
        if not (math.isfinite(fix.position_std_m) and math.isfinite(valid)):
            return valid  # without its uncertainty a position cannot be weighed
        if valid > arrival + MAX_AHEAD_S:
            # A receiver whose time leaps: kept until then, such fixes would pile up, and be false when due.
            self.counts["early_fixes"] += 1
            ahead_s = valid - arrival
            self._faults.append(SourceFault(fix.arrival_s, "gnss", "early", f"fix is {ahead_s:.2f} s ahead"))
            return arrival
        last_end = self._tick_end_s(self._index)
        if valid <= last_end:
            if valid < last_end - MAX_MOVE_S:
                self.counts["late_fixes"] += 1
                self._faults.append(
                    SourceFault(fix.arrival_s, "gnss", "late", f"fix is {last_end - valid:.2f} s too late")
                )
                return valid
            valid = last_end + 1e-6
        altitude = fix.altitude_m
        east, north = self._plane.to_plane(fix.latitude_deg, fix.longitude_deg, altitude)
        heading = (
            self._plane.heading_from_course(fix.course_rad) if math.isfinite(fix.course_rad) else math.nan
        )
        noise = self._accuracy.factor(fix.speed_std_mps)
        self._fixes.append(_Timed(valid, arrival - valid, east, north, heading, noise, fix))
        return valid

    def _take_fixes(self, begin: float, end: float) -> list[Fix]:
        """Return the fixes valid in the tick, oldest first, with their position in it."""
        due = [one for one in self._fixes if one.time_s <= end]
        if not due:
            return []
        if len(self._fixes) == 1:
            self._fixes = []
        else:
            self._fixes = [one for one in self._fixes if one.time_s > end]
            due.sort(key=lambda one: one.time_s)
        return [
            Fix(
                time_s=one.time_s,
                fraction=min(max((one.time_s - begin) / self._dt_s, 0.0), 1.0),
                east_m=one.east_m,
                north_m=one.north_m,
                position_std_m=one.fix.position_std_m,
                up_m=one.fix.altitude_m,
                speed_mps=one.fix.speed_mps,
                speed_noise=one.speed_noise,
                heading_rad=one.heading_rad,
                quality=one.fix.quality,
                arrival_lag_s=one.lag_s,
                utc_s=one.fix.utc_s,
            )
            for one in due
        ]
