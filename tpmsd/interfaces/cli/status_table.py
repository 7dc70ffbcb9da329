"""The status document as a table that a driver understands.

In: the document of `tpmsd.onboard.sinks.status_document`; it comes from another process, so nothing in it
is taken for granted. Out: text, with colours if asked for.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Any

from tpmsd.foundation.plain import number
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.report.wording import WHEEL_NAMES, verdict_on, wheel_name
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind
from tpmsd.onboard.sinks.status_client import printable

WIDTH, NARROWEST = 80, 40
_FULL_WIDTH = 60
"""Columns that the table of wheels takes; on narrower terminals it leaves out the deviation from nominal."""
_HANG, _NARROW_HANG = " " * 10, " " * 4
_COLOURS = re.compile(r"\x1b\[[0-9;]*m")
_GOOD, _BAD, _DIM, _BOLD = "32", "31;1", "2", "1"
_SUSPECT = "33"
_SUSPICION = 0.5
"""From this probability of a deflation on a wheel without an alarm is shown as 'soft?'."""
_Paint = Callable[[str, str], str]
_SOURCE_WORDS = {
    "off": "not configured",
    "waiting": "open, nothing usable yet",
    "ok": "OK",
    "silent": "has gone silent",
    "down": "cannot be reached",
}


def render_status(document: Mapping[str, Any], *, colour: bool = False, width: int | None = None) -> str:
    """Return the whole table, ending with a line break; no line is longer than `width` characters (40 at
    least).
    """
    paint = _paint if colour else _plain
    alarms = [alarm for alarm in _list_or_empty(document, "alarms") if isinstance(alarm, dict)]
    lines = [
        paint(_heading(document), _BOLD),
        "",
        *_wheel_lines(document, alarms, paint, narrow=width is not None and width < _FULL_WIDTH),
        "",
        *_resonance_lines(document, paint),
        *_alarm_lines(document, alarms, paint),
        *_not_watched_lines(document, paint),
        "",
        _can_line(document, paint),
        _gnss_line(document, paint),
        *_obd_lines(document),
        *_vehicle_state_lines(document),
        _loop_line(document),
    ]
    if width is not None:
        lines = [
            part for line in lines for part in (_wrap_coloured(line, max(width, NARROWEST)) if line else [""])
        ]
    return "\n".join(lines) + "\n"


def _wrap_coloured(line: str, width: int) -> list[str]:
    """Return the line in lines of at most `width` visible characters, the later ones indented; colours
    continue.

    A column of blanks is kept where the line fits, a word longer than a line is broken.
    """
    if _visible_length(line) <= width:
        return [line]
    hang = _HANG if width >= _FULL_WIDTH else _NARROW_HANG
    out, now = [], ""
    for word in line.split(" "):
        longer = f"{now} {word}" if now else word
        if _visible_length(longer) <= width:
            now = longer
            continue
        out.append(now)
        now = hang + word
        while _visible_length(now) > width and "\x1b" not in now:
            out.append(now[:width])
            now = hang + now[width:]
    return [part for part in [*out, now] if part.strip()]


def _visible_length(text: str) -> int:
    return len(_COLOURS.sub("", text))


def _not_watched_lines(document: Mapping[str, Any], paint: _Paint) -> list[str]:
    """Return the wheels that are not monitored, other than those being learned, and the losses that would not
    be detected."""
    missing = {
        str(name): str(why)
        for name, why in _dict_or_empty(_dict_or_empty(document, "watch"), "not_watched").items()
        if why != "its normal radius is being learned"
    }
    lines = []
    if missing:
        said = "; ".join(f"{name} ({why})" for name, why in missing.items())
        lines.append(paint(f"not watched: {said}", _BOLD))
    asked = _dict_or_empty(document, "watch").get("questions")
    for one in asked if isinstance(asked, list) else []:
        if isinstance(one, dict):
            lines.append(paint(f"question: {one.get('question')}", _BOLD))
    unseen = _dict_or_empty(document, "watch").get("cannot_see")
    if isinstance(unseen, list) and unseen:
        lines.append(paint("cannot see now: " + "; ".join(map(str, unseen)), _DIM))
    return lines


def _heading(document: Mapping[str, Any]) -> str:
    uptime_s = _plausible_number(document, "uptime_s")
    up = "" if uptime_s is None else f", up for {_duration_text(uptime_s)}"
    return f"tpmsd {_text(document, 'tpmsd')}{up}"


def _wheel_lines(
    document: Mapping[str, Any], alarms: list[dict[str, Any]], paint: _Paint, narrow: bool
) -> list[str]:
    wheels = _dict_or_empty(document, "wheels")
    if not wheels:
        return ["No wheel has been heard of yet."]
    if narrow:
        lines = [paint(f"{'wheel':<11} {'tyre':<13} {'change in mm':>13}", _DIM)]
    else:
        lines = [paint(f"{'wheel':<13} {'tyre':<15} {'change in mm':>14} {'from nominal':>14}", _DIM)]
    for name in [w for w in WHEELS if w in wheels] + sorted(w for w in wheels if w not in WHEEL_NAMES):
        wheel = _dict_or_empty(wheels, name)
        word, style = _tyre_word(name, wheel, alarms, _plausible_number(document, "learning_fraction"))
        change, aged = _change_text(wheel)
        deviation = _plus_minus(_plausible_number(wheel, "deviation_mm"), _plausible_number(wheel, "std_mm"))
        label = printable(wheel_name(name))
        if narrow:
            lines.append(f"{label:<11} {paint(f'{word:<13}', style)} {change:>13}")
            lines += [f"{_NARROW_HANG}({aged})"] if aged else []
        else:
            row = f"{label:<13} {paint(f'{word:<15}', style)} {change:>14} {deviation:>14}"
            lines.append(row + (f"  ({aged})" if aged else ""))
    return lines


def _change_text(wheel: Mapping[str, Any]) -> tuple[str, str]:
    """Return the change of a radius and ''; where none is known now, the last one and its age in words."""
    now = _plausible_number(wheel, "change_mm")
    last, age_s = _plausible_number(wheel, "last_change_mm"), _plausible_number(wheel, "last_change_age_s")
    if now is not None or last is None or age_s is None:
        return _plus_minus(now, _plausible_number(wheel, "change_std_mm")), ""
    return _plus_minus(last, _plausible_number(wheel, "last_change_std_mm")), f"{_duration_text(age_s)} ago"


def _resonance_lines(document: Mapping[str, Any], paint: _Paint) -> list[str]:
    """Return the table of the wheels' resonances; empty where they are not evaluated."""
    wheels = _dict_or_empty(document, "resonance")
    if not wheels:
        return []
    lines = [paint(f"{'resonance':<13} {'state':<15} {'in Hz':>15}  {'when learned':>15}  soft tyre", _DIM)]
    for name in [w for w in WHEELS if w in wheels]:
        wheel = _dict_or_empty(wheels, name)
        now = _plausible_number(wheel, "frequency_hz")
        learned, ratio = _plausible_number(wheel, "baseline_hz"), _plausible_number(wheel, "log_ratio_soft")
        text = "-" if now is None else f"{now:.2f} +- {_plausible_number(wheel, 'std_hz') or 0.0:.2f}"
        before = "-" if learned is None else f"{learned:.2f}"
        # As odds, for few people think in natural logarithms.
        odds = "" if ratio is None or learned is None else f"  {math.exp(min(ratio, 50.0)):.2g} to 1"
        reason = _text(wheel, "reason")
        row = f"{wheel_name(name):<13} {_text(wheel, 'state')[:15]:<15} {text:>15}  {before:>15}{odds}"
        lines.append(row + (f"  ({reason})" if reason else ""))
    return [*lines, ""]


def _tyre_word(
    name: str, wheel: Mapping[str, Any], alarms: list[dict[str, Any]], learned: float | None
) -> tuple[str, str]:
    """Return the word for the state of a tyre, and its style."""
    kinds = {_text(alarm, "kind") for alarm in alarms if alarm.get("wheel") == name}
    state = _text(wheel, "state")
    if "deflation" in kinds:
        return "SOFT", _BAD
    if "radius_deviation" in kinds:
        return "CHANGED", _BAD
    if state == "alarm":
        return "ALARM", _BAD
    if "slow_leak" in kinds:
        return "leaks", _SUSPECT
    if state == "learning":
        return ("learning" if learned is None else f"learning {100 * learned:.0f} %"), _DIM
    if state == "unavailable":
        return "not watched", _SUSPECT if "malfunction" in kinds else _DIM
    if state != "monitoring":
        return state[:15], _SUSPECT
    if (_plausible_number(wheel, "deflation_probability") or 0.0) >= _SUSPICION:
        return "soft?", _SUSPECT
    return "OK", _GOOD


def _alarm_lines(document: Mapping[str, Any], alarms: list[dict[str, Any]], paint: _Paint) -> list[str]:
    if not alarms:
        return [paint("No alarms.", _GOOD)]
    now_s = _plausible_number(document, "time")
    lines = []
    for alarm in alarms:
        raised_s = _plausible_number(alarm, "time")
        since = ""
        if now_s is not None and raised_s is not None and now_s >= raised_s:
            since = f" (for {_duration_text(now_s - raised_s)})"
        reason = _text(alarm, "reason")
        lines.append(
            paint(f"ALARM{since}: {_alarm_clause(alarm)}" + (f" ({reason})" if reason else ""), _BAD)
        )
    return lines


def _alarm_clause(alarm: Mapping[str, Any]) -> str:
    kind, wheel = _text(alarm, "kind"), _text(alarm, "wheel") or None
    if kind not in set(AlarmKind):
        return f"{wheel_name(wheel)}: {kind.replace('_', ' ') or 'of no known kind'}"
    nan = math.nan
    return verdict_on(AlarmEvent(nan, AlarmKind(kind), wheel, "raised", nan, nan, nan, ""))


def _can_line(document: Mapping[str, Any], paint: _Paint) -> str:
    can = _dict_or_empty(document, "can")
    frames = _plausible_number(can, "frames")
    counted = "" if frames is None else f", {frames:.0f} frames"
    return _source_line("bus", can, "channel", counted, paint)


def _gnss_line(document: Mapping[str, Any], paint: _Paint) -> str:
    gnss = _dict_or_empty(document, "gnss")
    fixes, age_s = _plausible_number(gnss, "fixes"), _plausible_number(gnss, "age_s")
    counted = "" if fixes is None else f", {fixes:.0f} fixes"
    counted += "" if age_s is None else f", the last {age_s:.1f} s ago"
    return _source_line("receiver", gnss, "device", counted, paint)


def _obd_lines(document: Mapping[str, Any]) -> list[str]:
    """Return the car's own speed by OBD and what contradicts it; empty where OBD is not used."""
    obd = _dict_or_empty(document, "obd")
    if not obd:
        return []
    kmh, stopped = _plausible_number(obd, "speed_kmh"), _text(obd, "stopped")
    said = "does not answer" if kmh is None else f"{kmh:.0f} km/h"
    words = {"wheels_agree": "the wheels", "receiver_agrees": "the receiver"}
    against = [word for key, word in words.items() if obd.get(key) is False]
    said = f"not asked any more ({stopped})" if stopped else said
    return [f"{'OBD speed':<9} {said}" + (f", contradicts {' and '.join(against)}" if against else "")]


def _vehicle_state_lines(document: Mapping[str, Any]) -> list[str]:
    """Return side slip and speeds of the vehicle state; empty where `[vehicle_state] method` is not set."""
    state = _dict_or_empty(document, "vehicle_state")
    if not state:
        return []
    parts = []
    for words, key, unit in (
        ("side slip", "side_slip{}_rad", "rad"),
        ("lateral speed", "velocity_lat{}_mps", "m/s"),
        ("speed", "velocity_long{}_mps", "m/s"),
    ):
        value, std = _plausible_number(state, key.format("")), _plausible_number(state, key.format("_std"))
        if value is not None and std is not None:
            parts.append(f"{words} {value:+.3f} +- {std:.3f} {unit}")
    said = ", ".join(parts) or "not known now"
    return [f"{'state':<9} {said} ({printable(_text(state, 'method'))})"]


def _source_line(label: str, source: Mapping[str, Any], name_key: str, counted: str, paint: _Paint) -> str:
    state = _text(source, "state")
    word = _SOURCE_WORDS.get(state, state or "unknown")
    style = _GOOD if state == "ok" else _DIM if state == "off" else _SUSPECT
    faults = _dict_or_empty(source, "faults")
    recent = source.get("faults_last_minute")
    name, detail = _text(source, name_key), _text(source, "detail")
    parts = f"{label:<9} {name + ' ' if name else ''}{paint(word, style)}{counted}"
    parts += f" ({detail})" if detail else ""
    if not isinstance(recent, dict):  # of an older daemon
        total = _counts_text(faults)
        return parts + (printable(f"; faults: {total}") if total else "")
    if total := _counts_text(faults):
        parts += printable(f"; faults in the last minute: {_counts_text(recent) or 'none'}; in all: {total}")
    return parts


def _counts_text(faults: Mapping[str, Any]) -> str:
    return ", ".join(
        f"{kind} {count:.0f}" for kind in sorted(faults) if (count := _plausible_number(faults, kind))
    )


def _loop_line(document: Mapping[str, Any]) -> str:
    """Return the line about the daemon's loop: its ticks, and those that missed their deadline."""
    ticks, missed = _plausible_number(document, "ticks"), _plausible_number(document, "missed_deadlines")
    if ticks is None or missed is None:
        return f"{'loop':<9} unknown"
    return f"{'loop':<9} {ticks:.0f} ticks, {missed:.0f} late"


def _plus_minus(value: float | None, std: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:+.2f}" + ("" if std is None else f" +- {std:.2f}")


def _duration_text(seconds: float) -> str:
    if seconds < 60:
        return f"{seconds:.0f} s"
    minutes = int(seconds // 60)
    if minutes < 60:
        return f"{minutes} min"
    if minutes < 48 * 60:
        return f"{minutes // 60} h {minutes % 60:02d} min"
    return f"{minutes // 1440} days"


def _plausible_number(table: Mapping[str, Any], key: str) -> float | None:
    value = number(table.get(key))
    return value if value is not None and abs(value) < 1e15 else None


def _text(table: Mapping[str, Any], key: str) -> str:
    value = table.get(key)
    return printable(value) if isinstance(value, str) else ""


def _dict_or_empty(table: Mapping[str, Any], key: str) -> dict[str, Any]:
    value = table.get(key)
    return value if isinstance(value, dict) else {}


def _list_or_empty(table: Mapping[str, Any], key: str) -> list[Any]:
    value = table.get(key)
    return value if isinstance(value, list) else []


def _plain(text: str, style: str) -> str:
    """Return the text without colour, in the place of `_paint`."""
    return text


def _paint(text: str, style: str) -> str:
    """Return the text in the style of a terminal."""
    return f"\x1b[{style}m{text}\x1b[0m"
