"""How times, wheels and alarms are named for a reader.

In: seconds, wheel keys, alarm events. Out: short English strings.
"""

from __future__ import annotations

import math

from tpmsd.monitor.records import AlarmEvent, AlarmKind

WHEEL_NAMES = {"fl": "front left", "fr": "front right", "rl": "rear left", "rr": "rear right"}


def drive_time(seconds: float) -> str:
    """Time since the drive's start as `m:ss`, from one hour on `h:mm:ss`; a dash where it is unknown."""
    if not math.isfinite(seconds):
        return "-"
    sign = "-" if seconds <= -0.5 else ""
    whole = round(abs(seconds))
    hours, rest = divmod(whole, 3600)
    minutes, secs = divmod(rest, 60)
    return f"{sign}{hours}:{minutes:02d}:{secs:02d}" if hours else f"{sign}{minutes}:{secs:02d}"


def wheel_name(wheel: str | None) -> str:
    """`rl` -> `rear left`; the car as a whole where no wheel is meant."""
    return "car" if wheel is None else WHEEL_NAMES.get(wheel, wheel)


def signed_mm(value_m: float, digits: int = 2) -> str:
    """A length in millimetres with its sign; a dash where it is unknown."""
    return f"{value_m * 1e3:+.{digits}f}" if math.isfinite(value_m) else "-"


def unsigned_mm(value_m: float, digits: int = 2) -> str:
    """A length in millimetres without a sign; a dash where it is unknown."""
    return f"{value_m * 1e3:.{digits}f}" if math.isfinite(value_m) else "-"


def verdict_on(alarm: AlarmEvent) -> str:
    """The head of a sentence about one alarm: who has what."""
    if alarm.kind == AlarmKind.DEFLATION:
        return f"{wheel_name(alarm.wheel).capitalize()} tyre is losing air"
    if alarm.kind == AlarmKind.RADIUS_DEVIATION:
        return f"{wheel_name(alarm.wheel).capitalize()} tyre has changed its rolling radius"
    where = "" if alarm.wheel is None else f" of the {wheel_name(alarm.wheel)} wheel"
    return f"Monitoring{where} has failed"


def alarm_label(alarm: AlarmEvent) -> str:
    """A label short enough for a plot: `deflation RL`."""
    kind = {AlarmKind.RADIUS_DEVIATION: "deviation"}.get(alarm.kind, str(alarm.kind))
    return kind if alarm.wheel is None else f"{kind} {alarm.wheel.upper()}"
