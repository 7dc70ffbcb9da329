"""Standing tyre alarms as plain numbers for the state file, and back.

In: an `AlarmEvent`. Out: JSON types; and the event again, or ValueError for what is none.
"""

from __future__ import annotations

import math
from collections.abc import Container
from typing import Any

from tpmsd.foundation.bounds import LARGEST, number
from tpmsd.foundation.wheels import WHEELS
from tpmsd.onboard.monitor.evidence.first_start import BEFORE
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind
from tpmsd.onboard.monitor.settings import TYRE_SETS


def alarm_to_json(event: AlarmEvent) -> dict[str, Any]:
    """Return an active alarm as plain numbers for the state file, without radii, which are estimated
    again."""
    return {
        "kind": str(event.kind),
        "wheel": event.wheel,
        "time_s": event.time_s,
        "probability": event.probability,
        "reason": event.reason,
        "pressure_loss": _finite_or_none(event.pressure_loss),
        "pressure_loss_std": _finite_or_none(event.pressure_loss_std),
        "since": event.since,
    }


def alarm_from_json(entry: dict[str, Any], known: Container[tuple[AlarmKind, int]]) -> AlarmEvent:
    """Return the alarm that was saved; `known`: kinds and wheels that this car's monitor has. Raises
    ValueError, KeyError or TypeError.
    """
    event = AlarmEvent(
        time_s=number(entry["time_s"], -LARGEST, LARGEST, "time"),
        kind=AlarmKind(entry["kind"]),
        wheel=str(entry["wheel"]),
        state="raised",
        deviation_m=math.nan,
        std_m=math.nan,
        probability=number(entry["probability"], 0.0, 1.0, "probability"),
        reason=str(entry["reason"])[: TYRE_SETS.max_reason_chars],
        pressure_loss=_checked_loss(entry.get("pressure_loss")),
        pressure_loss_std=_checked_loss(entry.get("pressure_loss_std")),
        since=BEFORE if entry.get("since") else "",
    )
    if event.wheel not in WHEELS or (event.kind, WHEELS.index(event.wheel)) not in known:
        raise ValueError(f"the saved {event.kind} alarm of {event.wheel} is not one of this car")
    return event


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _checked_loss(value: float | None) -> float:
    """Return a saved loss of pressure, NaN for None; ValueError if it is out of bounds."""
    return math.nan if value is None else number(value, -10.0, 10.0, "loss of pressure")
