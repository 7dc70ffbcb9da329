"""A replayed drive as a table with a row per tick.

In: the `Step`s of a replay, and the fixes as the receiver sent them. Out: `TickTable`. Pure.

A row holds one fix at most. A second fix of one tick stands in the next row that has none: its own times are
in its columns. A receiver that is faster than the ticks for long loses the oldest of more than `MAX_WAITING`
fixes.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np

from tpmsd.car.vehicle_state.record import VehicleState
from tpmsd.foundation.plain import brief
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.tables.columns import INERTIAL, NUMBERS, TEXTS, columns_of
from tpmsd.onboard.monitor.records import AlarmEvent, WheelReport
from tpmsd.onboard.sources.events import GnssFix

if TYPE_CHECKING:
    import pandas as pd

    from tpmsd.onboard.pipeline import Step

MAX_WAITING = 100
"""Fixes that wait for a row of their own: ten seconds of a 10 Hz receiver."""
CHUNK_ROWS = 4096

Texts = tuple[str, ...]
_POSITION = {wheel: k for k, wheel in enumerate(WHEELS)}
_NO_FIX = (math.nan,) * 10
_inertial = attrgetter(*(column.name for column in INERTIAL))


@brief
@dataclass(frozen=True)
class TickTable:
    """n rows; the columns of `tpmsd.offline.tables.columns`."""

    numbers: dict[str, FloatArray]
    """(n,) each, NaN where nobody knows."""
    texts: dict[str, Texts]
    """n each."""
    events: tuple[AlarmEvent, ...] = ()
    """Alarms raised and cleared, in order."""
    fixes_left_out: int = 0
    """Fixes of a receiver that is faster than the ticks."""

    def __len__(self) -> int:
        return len(self.numbers["time_s"])

    def __getitem__(self, name: str) -> FloatArray:
        """Return a column of numbers; KeyError if there is none."""
        return self.numbers[name]

    def to_pandas(self) -> pd.DataFrame:
        """Return the table as a data frame, columns in their documented order; ConfigError without pandas."""
        from tpmsd.offline.tables.extras import import_pandas

        columns = {
            column.name: list(self.texts[column.name]) if column.text else self.numbers[column.name]
            for column in columns_of(self.numbers)
        }
        frame: pd.DataFrame = import_pandas().DataFrame(columns)
        return frame


class TickTableRecorder:
    """Gathers a `TickTable`; 0.6 kB per tick."""

    def __init__(self, vehicle_state: bool = False) -> None:
        self._names = (*NUMBERS, *VehicleState._fields) if vehicle_state else NUMBERS
        self._chunks: list[FloatArray] = []
        self._chunk = np.full((CHUNK_ROWS, len(self._names)), np.nan)
        self._filled = 0
        self._texts: dict[str, list[str]] = {name: [] for name in TEXTS}
        self._waiting: deque[GnssFix] = deque()
        self._left_out = 0
        self._angle = [0.0] * 4
        self._rotation = [0.0] * 4
        self._start_s = math.nan
        self._events: list[AlarmEvent] = []

    def observe_fix(self, fix: GnssFix) -> None:
        """Record a fix as the receiver sent it; before the step of its tick."""
        if len(self._waiting) == MAX_WAITING:
            self._waiting.popleft()
            self._left_out += 1
        self._waiting.append(fix)

    def add(self, step: Step) -> None:
        """Append the row of a step."""
        tick, estimate, report = step.tick, step.estimate, step.report
        if math.isnan(self._start_s):
            self._start_s = tick.time_s - tick.dt_s
        rotation = tick.rotation_rad.tolist()
        others = sorted(filter(math.isfinite, rotation))
        angles = []
        for k, turned in enumerate(rotation):
            known = math.isfinite(turned)
            # A wheel that was not read went on with the others: its angle stays plausible behind the gap.
            self._rotation[k] = turned if known else others[len(others) // 2] if others else self._rotation[k]
            self._angle[k] += self._rotation[k]
            angles.append(self._angle[k] if known else math.nan)
        fix = self._waiting.popleft() if self._waiting else None
        wheels = report.wheels
        row = [
            *(tick.host_time_s, tick.time_s - self._start_s, tick.gap_s),
            *angles,
            *tick.rotation_std_rad.tolist(),
            *_inertial(tick),
            *_fix_columns(fix),
            *(estimate.speed_mps, estimate.yaw_rate_radps, estimate.east_m, estimate.north_m),
            *(estimate.heading_rad, estimate.position_std_m, estimate.heading_std_rad),
            *(estimate.gnss_age_s, float(estimate.informative), report.learning_fraction),
            *_wheel_columns(wheels),
            float(len(tick.faults)),
            *_state_columns(step.vehicle_state, len(self._names) - len(NUMBERS)),
        ]
        if self._filled == CHUNK_ROWS:
            self._chunks.append(self._chunk)
            self._chunk = np.full((CHUNK_ROWS, len(self._names)), np.nan)
            self._filled = 0
        self._chunk[self._filled] = row
        self._filled += 1
        states = {wheel.wheel: wheel.state.value for wheel in wheels}
        for wheel in WHEELS:
            self._texts[f"state_{wheel}"].append(states.get(wheel, "unavailable"))
        active = " ".join(f"{alarm.kind}:{alarm.wheel or 'car'}" for alarm in report.active)
        self._texts["alarms"].append(active)
        self._events += report.events

    def table(self) -> TickTable:
        """Return the table so far."""
        rows = np.concatenate([*self._chunks, self._chunk[: self._filled]])
        return TickTable(
            {name: rows[:, k].copy() for k, name in enumerate(self._names)},
            {name: tuple(values) for name, values in self._texts.items()},
            tuple(self._events),
            self._left_out,
        )


def _wheel_columns(wheels: tuple[WheelReport, ...]) -> list[float]:
    """Return five figures of each wheel, those of one kind side by side; NaN for a wheel not reported."""
    values = [math.nan] * (5 * len(WHEELS))
    for wheel in wheels:
        at = _POSITION[wheel.wheel]
        values[at :: len(WHEELS)] = (
            wheel.deviation_m,
            wheel.std_m,
            wheel.change_m,
            wheel.change_std_m,
            wheel.deflation_probability,
        )
    return values


def _fix_columns(fix: GnssFix | None) -> tuple[float, ...]:
    if fix is None:
        return _NO_FIX
    return (
        *(fix.arrival_s, fix.utc_s, fix.latitude_deg, fix.longitude_deg, fix.altitude_m),
        *(fix.position_std_m, fix.speed_mps, fix.course_rad, float(fix.quality), fix.hdop),
    )


def _state_columns(state: VehicleState | None, count: int) -> tuple[float, ...]:
    return (math.nan,) * count if state is None else state
