"""Words for times, wheels and alarms.

In: seconds, wheel keys, alarm events. Out: short English strings.
"""

from __future__ import annotations

import datetime
import math

from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind

EPOCH_FROM_S, EPOCH_TO_S = 6.3e8, 4.1e9
"""1990 to 2099: host times that are a date; a box without a clock starts in 1970."""
WHEEL_NAMES = {"fl": "front left", "fr": "front right", "rl": "rear left", "rr": "rear right"}


def drive_time(seconds: float) -> str:
    """Return the time since the drive's start as `m:ss`, from one hour on `h:mm:ss`; a dash if unknown."""
    if not math.isfinite(seconds):
        return "-"
    sign = "-" if seconds <= -0.5 else ""
    whole = round(abs(seconds))
    hours, rest = divmod(whole, 3600)
    minutes, secs = divmod(rest, 60)
    return f"{sign}{hours}:{minutes:02d}:{secs:02d}" if hours else f"{sign}{minutes}:{secs:02d}"


def utc_text(time_s: float) -> str:
    """Return a host time as UTC date and time; as seconds where it is no date of a clock that was set."""
    if not EPOCH_FROM_S <= time_s <= EPOCH_TO_S:
        return f"host time {time_s:.3f} s" if math.isfinite(time_s) else "an unknown time"
    return datetime.datetime.fromtimestamp(time_s, tz=datetime.UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def wheel_name(wheel: str | None) -> str:
    """Return `rear left` for `rl`; `car` for None."""
    return "car" if wheel is None else WHEEL_NAMES.get(wheel, wheel)


def signed_mm(value_m: float, digits: int = 2) -> str:
    """Return a length in millimetres with its sign; a dash where it is unknown."""
    return f"{value_m * 1e3:+.{digits}f}" if math.isfinite(value_m) else "-"


def unsigned_mm(value_m: float, digits: int = 2) -> str:
    """Return a length in millimetres without a sign; a dash where it is unknown."""
    return f"{value_m * 1e3:.{digits}f}" if math.isfinite(value_m) else "-"


def verdict_on(alarm: AlarmEvent) -> str:
    """Return the first clause of a sentence about an alarm: `Rear left tyre is losing air`."""
    if alarm.kind == AlarmKind.DEFLATION:
        return f"{wheel_name(alarm.wheel).capitalize()} tyre is losing air"
    if alarm.kind == AlarmKind.RADIUS_DEVIATION:
        return f"{wheel_name(alarm.wheel).capitalize()} tyre has changed its rolling radius"
    if alarm.kind == AlarmKind.SLOW_LEAK:
        return f"{wheel_name(alarm.wheel).capitalize()} tyre leaks slowly"
    where = "" if alarm.wheel is None else f" of the {wheel_name(alarm.wheel)} wheel"
    return f"Monitoring{where} has failed"


def alarm_label(alarm: AlarmEvent) -> str:
    """Return a label short enough for a plot: `deflation RL`."""
    short = {AlarmKind.RADIUS_DEVIATION: "deviation", AlarmKind.SLOW_LEAK: "slow leak"}
    kind = short.get(alarm.kind, str(alarm.kind))
    return kind if alarm.wheel is None else f"{kind} {alarm.wheel.upper()}"


def time_step(span_s: float, most: int = 12) -> float:
    """Return a round number of seconds between the ticks of a time axis with at most `most` + 1 ticks."""
    steps = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 43200)
    return float(next((step for step in steps if span_s / step <= most), span_s / most))


def plain_name(identifier: str) -> str:
    """Return an identifier as a heading: `gnss_latency` -> `GNSS latency`."""
    words = identifier.split("_")
    if len(words) > 1 and words[-1] in ("lateral", "longitudinal"):
        words = [words[-1], *words[:-1]]
    text = " ".join(_SPELT.get(word, word) for word in words)
    return text[:1].upper() + text[1:]


def parameter_name(identifier: str) -> str:
    """Return a parameter's name without its unit: `latency_s` -> `latency`."""
    words = identifier.split("_")
    if len(words) > 1 and words[-1] in _UNITS:
        words = words[:-1]
    return " ".join(_SPELT.get(word, word) for word in words)


def covariate_name(covariate: str) -> str:
    """Return a covariate in words: `accel_lat` -> `lateral acceleration`."""
    return _COVARIATES.get(covariate, covariate.replace("_", " "))


_COVARIATES = {
    "accel_long": "longitudinal acceleration",
    "accel_lat": "lateral acceleration",
    "steering": "steering wheel angle",
    "steering_rate": "steering wheel rate",
    "temperature": "ambient temperature",
    "torque": "drive torque",
    "distance": "distance travelled",
}
_SPELT = {
    "gnss": "GNSS",
    "doppler": "Doppler",
    "accel": "acceleration",
    "long": "longitudinal",
    "lat": "lateral",
    "gyro": "gyro",
    "std": "standard deviation",
    "rev": "revolution",
    "per": "per",
    "speed2": "speed squared",
}
_UNITS = {"s", "m", "rad", "mps", "mps2", "radps", "percent", "mm", "degc", "pa"}
