"""A replayed drive as the JSON document of `tpmsd replay --json`.

In: a `ReplayResult`. Out: a dict of plain JSON values; numbers that nobody knows are null. The public format
fixes `duration_s`, `wheels`, `alarms` and `realtime_factor`; the other keys are additions.
"""

from __future__ import annotations

import math
from typing import Any

from tpmsd.monitor.records import AlarmEvent
from tpmsd.report.replay_result import ReplayResult, WheelOutcome
from tpmsd.wheels import WHEELS


def replay_document(result: ReplayResult) -> dict[str, Any]:
    """The document; ready for `json.dumps(..., allow_nan=False)`.

    `wheels` holds the wheels that were on the bus; those that never were are named in `unavailable`.
    """
    seen = [outcome for outcome in result.wheels if outcome.seen_s > 0]
    return {
        "drive": result.drive,
        "start_time": _number(result.start_s),
        "duration_s": _number(result.duration_s),
        "distance_m": _number(result.distance_m),
        "realtime_factor": _number(result.realtime_factor),
        "wheels": {outcome.wheel: _wheel(outcome, result) for outcome in seen},
        "unavailable": [outcome.wheel for outcome in result.wheels if outcome.seen_s <= 0],
        "alarms": [alarm_entry(alarm, result.start_s) for alarm in result.alarms],
        "active_alarms": [alarm_entry(alarm, result.start_s) for alarm in result.active],
        "learning": {
            "fraction": _number(result.learning_fraction),
            "informative_s": _number(result.informative_s),
            "moving_s": _number(result.moving_s),
        },
        "gnss": {
            "fixes": result.gnss.fixes,
            "outages": result.gnss.outages,
            "outage_s": _number(result.gnss.outage_s),
            "longest_outage_s": _number(result.gnss.longest_outage_s),
        },
        "faults": dict(result.fault_counts),
        "tick_gaps": {"count": result.tick_gaps, "total_s": _number(result.tick_gap_s)},
        "pose": _pose(result),
        "resonance": {
            outcome.wheel: status.to_json()
            for outcome, status in zip(result.wheels, result.resonance, strict=False)
            if outcome.seen_s > 0
        },
    }


def _number(value: float) -> float | None:
    """JSON knows neither NaN nor infinity."""
    return float(value) if math.isfinite(value) else None


def _mm(value_m: float) -> float | None:
    return _number(value_m * 1e3)


def _wheel(outcome: WheelOutcome, result: ReplayResult) -> dict[str, Any]:
    nominal = float(result.nominal_m[WHEELS.index(outcome.wheel)])
    return {
        "deviation_mm": _mm(outcome.deviation_m),
        "std_mm": _mm(outcome.std_m),
        "state": str(outcome.state),
        "radius_m": _number(nominal + outcome.deviation_m),
        "change_mm": _mm(outcome.change_m),
        "change_std_mm": _mm(outcome.change_std_m),
        "deflation_probability": _number(outcome.deflation_probability),
        "monitored_s": _number(outcome.monitored_s),
        "monitored_from": _number(outcome.monitored_from_s),
    }


def alarm_entry(alarm: AlarmEvent, start_s: float) -> dict[str, Any]:
    """One alarm raised or cleared; `start_s` is when the drive began."""
    return {
        "time": _number(alarm.time_s),
        "kind": str(alarm.kind),
        "wheel": alarm.wheel,
        "state": alarm.state,
        "deviation_mm": _mm(alarm.deviation_m),
        "std_mm": _mm(alarm.std_m),
        "probability": _number(alarm.probability),
        "pressure_loss_percent": _number(100.0 * alarm.pressure_loss),
        "pressure_loss_std_percent": _number(100.0 * alarm.pressure_loss_std),
        "drive_time_s": _number(alarm.time_s - start_s),
        "reason": alarm.reason,
        **({"since": alarm.since} if alarm.since else {}),
    }


def _pose(result: ReplayResult) -> dict[str, Any] | None:
    pose = result.pose
    if pose is None:
        return None
    return {
        "east_m": _number(pose.east_m),
        "north_m": _number(pose.north_m),
        "heading_rad": _number(pose.heading_rad),
        "position_std_m": _number(pose.position_std_m),
        "heading_std_rad": _number(pose.heading_std_rad),
    }
