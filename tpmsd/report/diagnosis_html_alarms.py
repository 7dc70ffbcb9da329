"""The part of the diagnosis' page that says what was found means for the tyres.

In: `AlarmsCompared`. Out: pieces of HTML.
"""

from __future__ import annotations

from html import escape

import numpy as np

from tpmsd.monitor.records import AlarmEvent
from tpmsd.report.alarms_compared import AlarmsCompared
from tpmsd.report.replay_result import ReplayResult
from tpmsd.report.svg import AFTER, BEFORE, Mark, Series, chart
from tpmsd.report.wording import alarm_label, drive_time, wheel_name
from tpmsd.wheels import WHEELS, FloatArray

_POINTS = 300
_UNSURE = 3.0
"""Times the median standard deviation: what is less sure is not drawn."""


def alarms_section(compared: AlarmsCompared) -> list[str]:
    """Alarms and radii of one drive without and with the model."""
    same = compared.after is compared.before
    out = [f"<h2>What it means for the tyres: {escape(compared.drive)}</h2>"]
    if same:
        out.append("<p>The model holds nothing to compensate: alarms and radii stay as they are.</p>")
    out += [f"<p>{escape(change)}</p>" for change in compared.changes]
    out.append(_alarm_table(compared))
    rows = "".join(
        f'<tr><td>{wheel_name(b.wheel)}</td><td class="n">{1e3 * b.before_m:.2f}</td>'
        f'<td class="n">{1e3 * b.after_m:.2f}</td><td class="n">{1e3 * b.std_m:.2f}</td></tr>'
        for b in compared.wheels
    )
    out.append(
        '<table><tr><th>wheel</th><th class="n">without the model, mm</th><th class="n">with it, mm</th>'
        f'<th class="n">estimate\'s own std, mm</th></tr>{rows}</table>'
        '<p class="note">How far each estimated radius strays from its own median over the drive (root mean'
        " square), a change of radius that was found taken out. The receiver's own wander makes some of it,"
        " alike on all wheels.</p>"
    )
    out += [f'<p class="note">{escape(note)}.</p>' for note in compared.notes]
    out += [_tracks(compared, k) for k in range(len(WHEELS))]
    return out


def _alarm_table(compared: AlarmsCompared) -> str:
    rows = ""
    for name, result in (("without the model", compared.before), ("with it", compared.after)):
        raised = [alarm for alarm in result.alarms if alarm.state == "raised"]
        listed = "<br>".join(escape(_told(alarm, result)) for alarm in raised) or "none"
        rows += f"<tr><td>{name}</td><td>{listed}</td></tr>"
    return f"<table><tr><th>replay</th><th>alarms raised</th></tr>{rows}</table>"


def _told(alarm: AlarmEvent, result: ReplayResult) -> str:
    return f"{alarm_label(alarm)} at {drive_time(alarm.time_s - result.start_s)}"


def _tracks(compared: AlarmsCompared, wheel: int) -> str:
    """Radius of one wheel over the drive, in both replays; empty where it was never known."""
    series, marks = [], []
    for name, result, colour in (
        ("without the model", compared.before, BEFORE),
        ("with it", compared.after, AFTER),
    ):
        if result is compared.before and colour == AFTER:
            continue
        time_s, deviation = _thinned(result, wheel)
        if not np.isfinite(deviation).any():
            return ""
        title = f"{wheel_name(WHEELS[wheel])}, {name}"
        series.append(Series(title, time_s.tolist(), (1e3 * deviation).tolist(), colour, dots=False))
        for alarm in result.alarms:
            if alarm.wheel == WHEELS[wheel] and alarm.state == "raised":
                marks.append(Mark(alarm.time_s - result.start_s, alarm_label(alarm), colour))
    fault = compared.fault_m(compared.before, wheel)
    if np.any(fault != 0.0):
        start = (
            float(np.nanmedian(compared.after.deviation_m[fault == 0.0, wheel])) if np.any(fault == 0) else 0
        )
        since = compared.before.time_s - compared.before.start_s
        every = slice(None, None, max(1, len(since) // _POINTS))
        level = (1e3 * (fault + start))[every].tolist()
        series.append(
            Series("the fault as found", since[every].tolist(), level, "#555555", dots=False, width=1.0)
        )
    return chart(
        series, "time since the drive's start (s)", "radius minus nominal (mm)", marks=marks, height=230
    )


def _thinned(result: ReplayResult, wheel: int) -> tuple[FloatArray, FloatArray]:
    """Times and deviations at few points, without the first swings of an estimate that knows nothing yet."""
    every = max(1, len(result.time_s) // _POINTS)
    std = result.std_m[::every, wheel]
    known = np.isfinite(std) & (std < _UNSURE * np.nanmedian(std)) if np.isfinite(std).any() else std > 0
    time_s, deviation = (result.time_s - result.start_s)[::every], result.deviation_m[::every, wheel]
    return time_s[known], deviation[known]
