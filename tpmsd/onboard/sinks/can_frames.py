"""Puts what the monitor says on CAN, as `dbc/tpmsd.dbc` describes it.

In: one `MonitorReport` per tick and the logical time. Out: the frames that are due, `OutFrame`s.
Pure: neither bus nor clock.

TPMSD_STATUS is cyclic: three pages (front, rear, change) every `status_period_s`. TPMSD_ALARM is sent at once
for every alarm raised or cleared, then repeated every `alarm_period_s` while the alarm is active, and
`CLEARED_REPEATS` times after it was cleared, so that a receiver that lost frames still learns of it.
A repetition carries the sequence number of its event: a receiver counts events by it, frames by the counter.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import NamedTuple

from tpmsd.car.config.model import AlarmsConfig
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import WHEELS
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind, MonitorReport, WheelReport
from tpmsd.onboard.sinks import can_layout as layout

CLEARED_REPEATS = 5
_SLACK_S = 1e-3
"""Tolerance of the due time, s: ticks fall on multiples of a period only to within rounding; far below the
shortest tick (10 ms)."""
_NAN = math.nan


class OutFrame(NamedTuple):
    """One CAN frame to be sent."""

    arbitration_id: int
    extended: bool
    data: bytes


class Cycle:
    """Schedule of a periodic frame, without drift, bursts after a pause, or trust in a clock that never steps
    back."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._next_s = -math.inf

    def restart(self, now_s: float) -> None:
        """Make the frame due a whole period from now."""
        self._next_s = now_s + self._period_s

    def due(self, now_s: float) -> bool:
        """Return whether the frame has to be sent now; if so the next period begins."""
        stepped_back = now_s < self._next_s - self._period_s - _SLACK_S
        if not stepped_back and now_s < self._next_s - _SLACK_S:
            return False
        on_schedule = not stepped_back and now_s < self._next_s + self._period_s
        self._next_s = (self._next_s if on_schedule else now_s) + self._period_s
        return True


@dataclass(slots=True)
class _Announced:
    """Alarm that was sent on the bus."""

    event: AlarmEvent
    sequence: int
    cycle: Cycle
    repeats_left: int
    """Repetitions left, counted once it is cleared."""

    @property
    def raised(self) -> bool:
        return self.event.state == "raised"


_Key = tuple[AlarmKind, str | None]


class CanReporter:
    """Decides which frames are due and fills them."""

    def __init__(self, alarms: AlarmsConfig) -> None:
        """Raises ConfigError if an identifier does not fit its format or both are the same."""
        limit = 0x1FFFFFFF if alarms.extended_ids else 0x7FF
        for key, value in (("status_id", alarms.status_id), ("alarm_id", alarms.alarm_id)):
            if not 0 <= value <= limit:
                bits = 29 if alarms.extended_ids else 11
                raise ConfigError(f"alarms.{key} 0x{value:X} does not fit {bits} bits (at most 0x{limit:X})")
        if alarms.status_id == alarms.alarm_id:
            raise ConfigError(f"alarms.status_id and alarms.alarm_id are both 0x{alarms.status_id:X}")
        self._alarms = alarms
        self._status_cycle = Cycle(alarms.status_period_s)
        self._status_counter = 0
        self._alarm_counter = 0
        self._sequence = 0
        self._announced: dict[_Key, _Announced] = {}

    def frames(self, now_s: float, report: MonitorReport) -> list[OutFrame]:
        """Return the frames due at `now_s`, alarms first; call once per tick. Empty if alarms.can is off."""
        if not self._alarms.can:
            return []
        out = self._alarm_frames(now_s, report)
        if self._status_cycle.due(now_s):
            out += [self._status_frame(page, report) for page in layout.STATUS_PAGES]
        return out

    def _status_frame(self, page: int, report: MonitorReport) -> OutFrame:
        """Return one page of the status frame."""
        wheels = {wheel.wheel: wheel for wheel in report.wheels}
        values: dict[str, float] = {"StatusCounter": self._status_counter, "StatusPage": page}
        if page == layout.PAGE_CHANGE:
            for name in WHEELS:
                values[f"Change_{name.upper()}"] = (
                    _finite_mm(wheels[name].change_m) if name in wheels else _NAN
                )
        else:
            for name in WHEELS[:2] if page == layout.PAGE_FRONT else WHEELS[2:]:
                values |= _wheel_values(name.upper(), wheels.get(name))
        self._status_counter = (self._status_counter + 1) % layout.COUNTER_MODULO
        fields = layout.STATUS_HEAD + layout.STATUS_FIELDS[page]
        data = layout.pack(fields, values, layout.STATUS_DATA_ID)
        return OutFrame(self._alarms.status_id, self._alarms.extended_ids, data)

    def _alarm_frames(self, now_s: float, report: MonitorReport) -> list[OutFrame]:
        """Return the frames of new alarms and of those whose repetition is due."""
        fresh = [self._announce(event, now_s) for event in self._events_to_announce(now_s, report)]
        repeated = []
        for key, alarm in list(self._announced.items()):
            if not alarm.cycle.due(now_s):
                continue
            repeated.append(alarm)
            if not alarm.raised:
                alarm.repeats_left -= 1
                if alarm.repeats_left == 0:
                    del self._announced[key]
        return [self._alarm_frame(alarm, report) for alarm in fresh + repeated]

    def _events_to_announce(self, now_s: float, report: MonitorReport) -> list[AlarmEvent]:
        """Return the events of this tick, and those that were missed, by comparison with the active alarms:
        alarms restored from an earlier run are announced, and none is repeated for ever."""
        events = list(report.events)
        announced = {key: alarm.event for key, alarm in self._announced.items() if alarm.raised}
        for event in events:
            if event.state == "raised":
                announced[_alarm_key(event)] = event
            else:
                announced.pop(_alarm_key(event), None)
        active = {_alarm_key(event): event for event in report.active}
        events += [event for key, event in active.items() if key not in announced]
        events += [
            dataclasses.replace(event, state="cleared", time_s=now_s)
            for key, event in announced.items()
            if key not in active
        ]
        return events

    def _announce(self, event: AlarmEvent, now_s: float) -> _Announced:
        """Return the alarm of an event under a new sequence number, kept for its repetition."""
        self._sequence = (self._sequence + 1) % layout.SEQUENCE_MODULO
        alarm = _Announced(event, self._sequence, Cycle(self._alarms.alarm_period_s), CLEARED_REPEATS)
        alarm.cycle.restart(now_s)
        self._announced[_alarm_key(event)] = alarm
        return alarm

    def _alarm_frame(self, alarm: _Announced, report: MonitorReport) -> OutFrame:
        """Return the frame of an alarm with the wheel's present values."""
        event = alarm.event
        values: dict[str, float] = {
            "AlarmCounter": self._alarm_counter,
            "ActiveAlarms": len(report.active),
            "AlarmRaised": float(alarm.raised),
            "AlarmKind": layout.ALARM_KIND_CODES[event.kind],
            "AlarmWheel": layout.NO_WHEEL_CODE if event.wheel is None else layout.WHEEL_CODES[event.wheel],
            "AlarmSequence": alarm.sequence,
        }
        for active in report.active:
            values |= dict.fromkeys(_summary_bits(active), 1)
        # What changed since the baseline says nothing of a tyre that was soft before it was learned.
        live = () if event.since else report.wheels
        wheel = next((w for w in live if w.wheel == event.wheel), None)
        values["AlarmChange"] = _NAN if wheel is None else _finite_mm(wheel.change_m)
        values["AlarmPressureLoss"] = 100 * _pressure_loss(event, wheel)
        values["AlarmProbability"] = 100 * _probability(event, wheel)
        self._alarm_counter = (self._alarm_counter + 1) % layout.COUNTER_MODULO
        data = layout.pack(layout.ALARM_FIELDS, values, layout.ALARM_DATA_ID)
        return OutFrame(self._alarms.alarm_id, self._alarms.extended_ids, data)


def _alarm_key(event: AlarmEvent) -> _Key:
    return event.kind, event.wheel


def _finite_mm(length_m: float) -> float:
    """Return metres as millimetres; NaN for a value that is not finite."""
    return 1e3 * length_m if math.isfinite(length_m) else _NAN


def _wheel_values(suffix: str, wheel: WheelReport | None) -> dict[str, float]:
    deviation_m = _NAN if wheel is None else wheel.deviation_m
    return {
        f"Deviation_{suffix}": _finite_mm(deviation_m),
        f"Std_{suffix}": _NAN if wheel is None else _finite_mm(wheel.std_m),
        f"State_{suffix}": layout.WHEEL_STATE_CODES["unavailable" if wheel is None else wheel.state],
        f"Valid_{suffix}": float(wheel is not None and math.isfinite(deviation_m)),
    }


def _summary_bits(alarm: AlarmEvent) -> list[str]:
    """Return the names of the lamp bits that an active alarm sets."""
    if alarm.kind == AlarmKind.MALFUNCTION:
        return ["Malfunction"]
    if alarm.kind == AlarmKind.SLOW_LEAK:
        return []  # a notice: no lamp of a tyre
    name = "Deflation" if alarm.kind == AlarmKind.DEFLATION else "RadiusDeviation"
    # An alarm that names no single wheel concerns them all.
    return [f"{name}_{wheel.upper()}" for wheel in ((alarm.wheel,) if alarm.wheel else WHEELS)]


def _pressure_loss(event: AlarmEvent, wheel: WheelReport | None) -> float:
    """Return the lost share of the pressure now, or at the event where it is not known now; a gain is 0,
    unknown NaN."""
    # A slow leak has cost what the weeks say, not what changed since the baseline.
    live = _NAN if wheel is None or event.kind == AlarmKind.SLOW_LEAK else wheel.pressure_loss
    loss = event.pressure_loss if math.isnan(live) else live
    return _NAN if math.isnan(loss) else max(loss, 0.0)


def _probability(event: AlarmEvent, wheel: WheelReport | None) -> float:
    """Return the probability as it is now, where the monitor still gives one; else as it was at the event."""
    live = _NAN
    if wheel is not None and event.kind == AlarmKind.DEFLATION:
        live = wheel.deflation_probability
    elif wheel is not None and event.kind == AlarmKind.RADIUS_DEVIATION:
        live = wheel.deviation_probability
    return event.probability if math.isnan(live) else live
