"""One alarm as every JSON document shows it: status, replay, the fleet's tables."""

from __future__ import annotations

from typing import Any

from tpmsd.foundation.plain import finite, millimetres
from tpmsd.onboard.monitor.records import AlarmEvent


def alarm_entry(alarm: AlarmEvent, start_s: float | None = None) -> dict[str, Any]:
    """Return an alarm raised or cleared with the keys of the public formats, some of them only where they are
    known.

    `start_s`: when the drive began (host clock, s); with it the entry also holds `drive_time_s`.
    """
    return {
        "time": finite(alarm.time_s),
        "kind": str(alarm.kind),
        "wheel": alarm.wheel,
        "state": alarm.state,
        "deviation_mm": millimetres(alarm.deviation_m),
        "std_mm": millimetres(alarm.std_m),
        "probability": finite(alarm.probability),
        "pressure_loss_percent": finite(100.0 * alarm.pressure_loss),
        "pressure_loss_std_percent": finite(100.0 * alarm.pressure_loss_std),
        **({} if start_s is None else {"drive_time_s": finite(alarm.time_s - start_s)}),
        "reason": alarm.reason,
        **alarm.additional_keys(),
    }
