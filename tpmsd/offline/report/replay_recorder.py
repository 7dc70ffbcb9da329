"""Gathers a replay, tick by tick, into a bounded record.

In: per tick a `Tick`, a `RadiusEstimate` and a `MonitorReport`. Out: a `ReplayResult`. No I/O, no clock: the
caller says how long the replay took.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from tpmsd.car.config.model import MonitorConfig, VehicleConfig
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.report.replay_result import (
    GNSS_GAP_S,
    AlarmThresholds,
    FinalPose,
    GnssHealth,
    ReplayResult,
    WheelOutcome,
)
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.monitor.records import AlarmEvent, MonitorReport, WheelReport, WheelState
from tpmsd.onboard.timeline.tick import Tick

MOVING_MPS = 1.0
"""Above this speed the car counts as moving."""
WATCHED = (WheelState.MONITORING, WheelState.ALARM)

# Columns of the table. The fault columns are cumulative, so that thinning the rows loses no fault.
_TIME, _SPEED, _INFORMATIVE, _GNSS_AGE, _CAN_FAULTS, _GNSS_FAULTS = range(6)
_DEVIATION, _STD, _CHANGE, _CHANGE_STD, _PROBABILITY = (slice(6 + 4 * k, 10 + 4 * k) for k in range(5))
_COLUMNS = 26


class ReplayRecorder:
    """Bounded memory: when the table is full, every second row goes, and from then on every second tick.

    Totals (distance, faults, alarms, outages) are kept from every tick; only the series are thinned.
    """

    def __init__(
        self, drive: str, vehicle: VehicleConfig, monitor: MonitorConfig, max_points: int = 20_000
    ) -> None:
        if max_points < 2:
            raise ValueError(f"max_points must be at least 2, not {max_points}")
        self._drive = drive
        self._nominal = np.asarray(vehicle.wheel_radius_m, dtype=np.float64)
        self._thresholds = AlarmThresholds.from_config(vehicle, monitor)
        self._learn_s = monitor.learn_s
        self._rows = np.full((max_points, _COLUMNS), np.nan)
        self._filled = 0
        self._stride = 1
        self._ticks = 0
        self._last: tuple[Tick, RadiusEstimate, MonitorReport] | None = None
        self._start_s = math.nan
        self._wheels = {wheel: _WheelTally() for wheel in WHEELS}
        self._gnss = _GnssTally()
        self._alarms: list[AlarmEvent] = []
        self._faults: Counter[str] = Counter()
        self._source_faults: Counter[str] = Counter(can=0, gnss=0)
        self._distance_m = 0.0
        self._moving_s = 0.0
        self._gaps = 0
        self._gap_s = 0.0

    def add(self, tick: Tick, estimate: RadiusEstimate, report: MonitorReport) -> None:
        """Add one tick with the estimate and the report that the core made of it."""
        if self._ticks == 0:
            self._start_s = tick.time_s - tick.dt_s
        self._count_tick(tick, estimate, report)
        self._last = (tick, estimate, report)
        if self._ticks % self._stride == 0 and self._filled == len(self._rows):
            self._drop_every_second_row()
        if self._ticks % self._stride == 0:
            self._rows[self._filled] = self._table_row(tick, estimate, report)
            self._filled += 1
        self._ticks += 1

    def result(self, elapsed_s: float) -> ReplayResult:
        """Return the record so far; `elapsed_s` is the wall-clock time of the replay, NaN if not measured."""
        table = self._rows[: self._filled].copy()
        estimate = report = None
        duration = 0.0
        if self._last is not None:
            tick, estimate, report = self._last
            duration = max(0.0, tick.time_s - self._start_s)
            # The end of the drive is always shown, if need be in place of the newest row.
            room_left = self._filled < len(self._rows) and tick.time_s != table[-1, _TIME]
            table = np.vstack([table if room_left else table[:-1], self._table_row(tick, estimate, report)])
        gnss = self._gnss
        return ReplayResult(
            drive=self._drive,
            start_s=self._start_s,
            duration_s=duration,
            realtime_factor=duration / elapsed_s if elapsed_s > 0 else math.nan,
            nominal_m=self._nominal,
            thresholds=self._thresholds,
            learn_s=self._learn_s,
            time_s=table[:, _TIME],
            speed_mps=table[:, _SPEED],
            deviation_m=table[:, _DEVIATION],
            std_m=table[:, _STD],
            change_m=table[:, _CHANGE],
            change_std_m=table[:, _CHANGE_STD],
            deflation_probability=table[:, _PROBABILITY],
            informative=table[:, _INFORMATIVE] > 0.5,
            gnss_age_s=table[:, _GNSS_AGE],
            can_faults=table[:, _CAN_FAULTS].astype(np.int64),
            gnss_faults=table[:, _GNSS_FAULTS].astype(np.int64),
            wheels=tuple(tally.outcome(wheel) for wheel, tally in self._wheels.items()),
            alarms=tuple(self._alarms),
            active=report.active if report is not None else (),
            fault_counts=dict(sorted(self._faults.items())),
            gnss=GnssHealth(gnss.fixes, gnss.outages, gnss.total_s, gnss.longest_s),
            pose=_final_pose(estimate),
            distance_m=self._distance_m,
            moving_s=self._moving_s,
            informative_s=estimate.informative_s if estimate is not None else 0.0,
            learning_fraction=report.learning_fraction if report is not None else 0.0,
            tick_gaps=self._gaps,
            tick_gap_s=self._gap_s,
        )

    def _drop_every_second_row(self) -> None:
        kept = self._rows[: self._filled : 2].copy()
        self._rows[: len(kept)] = kept
        self._filled = len(kept)
        self._stride *= 2

    def _count_tick(self, tick: Tick, estimate: RadiusEstimate, report: MonitorReport) -> None:
        for fault in tick.faults:
            self._faults[f"{fault.source} {fault.kind}"] += 1
            self._source_faults[fault.source] += 1
        if tick.gap_s > 0:
            self._gaps += 1
            self._gap_s += tick.gap_s
        speed = abs(estimate.speed_mps)
        if math.isfinite(speed):
            self._distance_m += speed * tick.dt_s
            self._moving_s += tick.dt_s if speed >= MOVING_MPS else 0.0
        self._gnss.add(len(tick.fixes), estimate.gnss_age_s, tick.time_s - self._start_s)
        self._alarms.extend(report.events)
        dt_s = tick.dt_s
        for wheel in report.wheels:
            tally = self._wheels[wheel.wheel]
            tally.state = wheel.state
            if math.isfinite(wheel.deviation_m):
                tally.last = wheel
            if wheel.state is not WheelState.UNAVAILABLE:
                tally.seen_s += dt_s
            if wheel.state in WATCHED:
                tally.monitored_s += dt_s
                if math.isnan(tally.monitored_from_s):
                    tally.monitored_from_s = tick.time_s

    def _table_row(self, tick: Tick, estimate: RadiusEstimate, report: MonitorReport) -> list[float]:
        """Return the columns of one row of the table as a list: an array, which is copied, takes as long."""
        row = [math.nan] * _COLUMNS
        row[_TIME] = tick.time_s
        row[_SPEED] = estimate.speed_mps
        row[_INFORMATIVE] = estimate.informative
        row[_GNSS_AGE] = estimate.gnss_age_s
        row[_CAN_FAULTS] = self._source_faults["can"]
        row[_GNSS_FAULTS] = self._source_faults["gnss"]
        for wheel in report.wheels:
            row[6 + WHEELS.index(wheel.wheel) :: 4] = (
                wheel.deviation_m,
                wheel.std_m,
                wheel.change_m,
                wheel.change_std_m,
                _watched_probability(wheel),
            )
        return row


@dataclass(slots=True)
class _WheelTally:
    """Running totals of one wheel."""

    state: WheelState = WheelState.UNAVAILABLE
    last: WheelReport | None = None
    """The newest report with a known radius."""
    seen_s: float = 0.0
    monitored_s: float = 0.0
    monitored_from_s: float = math.nan

    def outcome(self, wheel: str) -> WheelOutcome:
        """Return the totals as a record; unknown values are NaN."""
        last = self.last
        if last is None:
            figures = (math.nan,) * 5
        else:
            figures = (
                last.deviation_m,
                last.std_m,
                last.change_m,
                last.change_std_m,
                _watched_probability(last),
            )
        return WheelOutcome(wheel, self.state, *figures, self.seen_s, self.monitored_s, self.monitored_from_s)


@dataclass(slots=True)
class _GnssTally:
    """Running totals of the receiver."""

    fixes: int = 0
    outages: int = 0
    total_s: float = 0.0
    longest_s: float = 0.0
    current_s: float = 0.0

    def add(self, fixes: int, age_s: float, since_start_s: float) -> None:
        """Count the fixes and outage time of one tick; before the first fix an outage counts from the drive's
        start."""
        self.fixes += fixes
        silent_s = since_start_s if math.isnan(age_s) else min(age_s, since_start_s)
        if silent_s <= GNSS_GAP_S:
            self.current_s = 0.0
            return
        if self.current_s == 0.0:
            self.outages += 1
        self.total_s += max(0.0, silent_s - self.current_s)
        self.current_s = silent_s
        self.longest_s = max(self.longest_s, silent_s)


def _watched_probability(wheel: WheelReport) -> float:
    """Return the probability of a deflation; NaN while the wheel is not watched, as zero would mean none."""
    return wheel.deflation_probability if wheel.state in WATCHED else math.nan


def _final_pose(estimate: RadiusEstimate | None) -> FinalPose | None:
    """Return the pose of the last estimate; None without a finite position."""
    if estimate is None or not math.isfinite(estimate.east_m + estimate.north_m):
        return None
    return FinalPose(
        estimate.east_m,
        estimate.north_m,
        estimate.heading_rad,
        estimate.position_std_m,
        estimate.heading_std_rad,
    )
