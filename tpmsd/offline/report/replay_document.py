"""A replayed drive as the JSON document of `tpmsd replay --json`.

In: a `ReplayResult`. Out: a dict of plain JSON values; numbers that nobody knows are null. The public format
fixes `duration_s`, `wheels`, `alarms` and `realtime_factor`; the other keys are additions.
"""

from __future__ import annotations

from typing import Any

from tpmsd.foundation.plain import finite, millimetres
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.report.replay_result import ReplayResult, WheelOutcome
from tpmsd.onboard.sinks.alarm_entry import alarm_entry

REPLAY_SCHEMA = "tpmsd.replay/2"


def replay_document(result: ReplayResult) -> dict[str, Any]:
    """Return the document; ready for `json.dumps(..., allow_nan=False)`.

    `wheels` holds the wheels that were on the bus; those that never were are named in `unavailable`.
    """
    seen = [outcome for outcome in result.wheels if outcome.seen_s > 0]
    state = {} if result.vehicle_state is None else {"vehicle_state": result.vehicle_state.to_json()}
    return {
        "drive": result.drive,
        "start_time": finite(result.start_s),
        "duration_s": finite(result.duration_s),
        "distance_m": finite(result.distance_m),
        "realtime_factor": finite(result.realtime_factor),
        "wheels": {outcome.wheel: _wheel_entry(outcome, result) for outcome in seen},
        "unavailable": [outcome.wheel for outcome in result.wheels if outcome.seen_s <= 0],
        "alarms": [alarm_entry(alarm, result.start_s) for alarm in result.alarms],
        "active_alarms": [alarm_entry(alarm, result.start_s) for alarm in result.active],
        "learning": {
            "fraction": finite(result.learning_fraction),
            "informative_s": finite(result.informative_s),
            "moving_s": finite(result.moving_s),
        },
        "gnss": {
            "fixes": result.gnss.fixes,
            "outages": result.gnss.outages,
            "outage_s": finite(result.gnss.outage_s),
            "longest_outage_s": finite(result.gnss.longest_outage_s),
        },
        "faults": dict(result.fault_counts),
        "tick_gaps": {"count": result.tick_gaps, "total_s": finite(result.tick_gap_s)},
        "pose": _pose_entry(result),
        "resonance": {
            outcome.wheel: status.to_json()
            for outcome, status in zip(result.wheels, result.resonance, strict=False)
            if outcome.seen_s > 0
        },
        **state,
    }


def _wheel_entry(outcome: WheelOutcome, result: ReplayResult) -> dict[str, Any]:
    """Return the JSON entry of a wheel at the end of a replay."""
    nominal = float(result.nominal_m[WHEELS.index(outcome.wheel)])
    return {
        "deviation_mm": millimetres(outcome.deviation_m),
        "std_mm": millimetres(outcome.std_m),
        "state": str(outcome.state),
        "radius_m": finite(nominal + outcome.deviation_m),
        "change_mm": millimetres(outcome.change_m),
        "change_std_mm": millimetres(outcome.change_std_m),
        "deflation_probability": finite(outcome.deflation_probability),
        "monitored_s": finite(outcome.monitored_s),
        "monitored_from": finite(outcome.monitored_from_s),
    }


def _pose_entry(result: ReplayResult) -> dict[str, Any] | None:
    pose = result.pose
    if pose is None:
        return None
    return {
        "east_m": finite(pose.east_m),
        "north_m": finite(pose.north_m),
        "heading_rad": finite(pose.heading_rad),
        "position_std_m": finite(pose.position_std_m),
        "heading_std_rad": finite(pose.heading_std_rad),
    }
