"""The figures of a replayed drive's report.

In: a `ReplayResult`, the ticks' track where it was kept. Out: `Chart`s with a common time axis, and the
`Track`.
"""

from __future__ import annotations

import numpy as np

from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.report.decimation import decimated
from tpmsd.offline.report.figures import Chart, Curve, Level, MarkedInstant, ShadedSpan, Track
from tpmsd.offline.report.replay_result import ReplayResult
from tpmsd.offline.report.replay_series import ReplaySeries, settled_range
from tpmsd.offline.report.vehicle_state_summary import StateSummary
from tpmsd.offline.report.wording import alarm_label, wheel_name

POINTS = 1600
"""Per curve: two per column of a report's plot."""
TRACK_POINTS = 1500
GROUP = "drive"
TIME_LABEL = "time since the start (h:min:s)"


def replay_charts(result: ReplayResult) -> tuple[Chart, ...]:
    """Return the charts of change, deviation, probability, speed, vehicle state and faults that have data;
    none without a tick."""
    if len(result.time_s) == 0:
        return ()
    series = ReplaySeries.of(result)
    charts = [
        _radius_chart(result, series),
        _deviation_chart(result, series),
        _probability_chart(result, series),
    ]
    charts.append(_speed_chart(result, series))
    if result.vehicle_state is not None:
        charts += state_charts(result.vehicle_state, result.start_s)
    if result.fault_counts:
        charts.append(_faults_chart(result, series))
    return tuple(chart for chart in charts if chart.curves)


def replay_track(
    result: ReplayResult, east_m: FloatArray, north_m: FloatArray, speed_mps: FloatArray, time_s: FloatArray
) -> Track | None:
    """Return the track coloured by speed; `time_s` is drive time. None where no position is known."""
    known = np.flatnonzero(np.isfinite(east_m) & np.isfinite(north_m))
    if len(known) < 2:
        return None
    pick = known[:: max(1, -(-len(known) // TRACK_POINTS))]
    return Track(
        title="Track",
        colour_label="speed (km/h)",
        east_m=east_m[pick],
        north_m=north_m[pick],
        value=3.6 * speed_mps[pick],
        time_s=time_s[pick],
        moments=tuple(moment for moment in _alarm_instants(result) if moment.style == "bad"),
        group=GROUP,
    )


def _radius_chart(result: ReplayResult, series: ReplaySeries) -> Chart:
    loss = 1e3 * float(np.min(result.thresholds.deflation_m))
    other = 1e3 * float(np.min(result.thresholds.deviation_m))
    levels = (
        Level(-loss, f"deflation {-loss:+.2f} mm", "bad"),
        Level(-other, f"radius deviation {-other:+.2f} mm"),
        Level(other, f"radius deviation {other:+.2f} mm"),
    )
    marks = [0.0, *(level.at for level in levels)]
    return _wheel_chart(
        result,
        series,
        "Radius minus learned baseline",
        "change of radius (mm)",
        series.change_mm,
        series.change_std_mm,
        levels,
        marks,
    )


def _deviation_chart(result: ReplayResult, series: ReplaySeries) -> Chart:
    title, label = "Radius minus nominal", "deviation of radius (mm)"
    return _wheel_chart(result, series, title, label, series.deviation_mm, series.std_mm, (), [0.0])


def _wheel_chart(
    result: ReplayResult,
    series: ReplaySeries,
    title: str,
    label: str,
    values: FloatArray,
    std: FloatArray,
    levels: tuple[Level, ...],
    marks: list[float],
) -> Chart:
    columns = {}
    for k, wheel in enumerate(WHEELS):
        if np.isfinite(values[:, k]).any():
            columns[wheel] = values[:, k]
            columns[f"{wheel} low"] = values[:, k] - 2.0 * std[:, k]
            columns[f"{wheel} high"] = values[:, k] + 2.0 * std[:, k]
    x, kept = decimated(series.drive_s, columns, POINTS)
    curves = [
        Curve(wheel_name(wheel), kept[wheel], wheel, kept[f"{wheel} low"], kept[f"{wheel} high"])
        for wheel in WHEELS
        if wheel in kept
    ]
    return Chart(
        title,
        TIME_LABEL,
        label,
        x,
        tuple(curves),
        levels=levels,
        moments=_alarm_instants(result),
        y_range=settled_range(values, std, marks),
        group=GROUP,
        time=True,
    )


def _probability_chart(result: ReplayResult, series: ReplaySeries) -> Chart:
    columns = {
        wheel: series.probability[:, k]
        for k, wheel in enumerate(WHEELS)
        if np.isfinite(series.probability[:, k]).any()
    }
    x, kept = decimated(series.drive_s, columns, POINTS)
    curves = tuple(Curve(wheel_name(wheel), kept[wheel], wheel) for wheel in columns)
    return Chart(
        "Probability of a deflation",
        TIME_LABEL,
        "probability",
        x,
        curves,
        moments=_alarm_instants(result),
        y_range=(-0.03, 1.03),
        group=GROUP,
        time=True,
    )


def _speed_chart(result: ReplayResult, series: ReplaySeries) -> Chart:
    x, kept = decimated(series.drive_s, {"speed": series.speed_kmh}, POINTS)
    idle, lost = series.uninformative_spans(), series.outage_spans()
    names = []
    if lost:
        names.append(("gap", "no GNSS fix"))
    if idle:
        names.append(("line", "not informative"))
    return Chart(
        "Speed",
        TIME_LABEL,
        "speed (km/h)",
        x,
        (Curve("speed", kept["speed"], "plain"),),
        spans=(
            *(ShadedSpan(start, end, "line") for start, end in idle),
            *(ShadedSpan(start, end, "gap") for start, end in lost),
        ),
        span_names=tuple(names),
        group=GROUP,
        time=True,
    )


def state_charts(state: StateSummary, start_s: float) -> list[Chart]:
    """Return side slip and lateral speed of the centre of gravity with two standard deviations."""
    rows = state.series()
    if not np.isfinite(rows[:, 1:]).any():
        return []
    charts = []
    for title, label, values, std in (
        (f"Side slip ({state.method})", "side slip (rad)", rows[:, 3], rows[:, 4]),
        (f"Lateral speed ({state.method})", "lateral speed (m/s)", rows[:, 1], rows[:, 2]),
    ):
        columns = {"value": values, "low": values - 2.0 * std, "high": values + 2.0 * std}
        x, kept = decimated(rows[:, 0] - start_s, columns, POINTS)
        curve = Curve(label.split(" (")[0], kept["value"], "plain", kept["low"], kept["high"])
        charts.append(Chart(title, TIME_LABEL, label, x, (curve,), group=GROUP, time=True))
    return charts


def _faults_chart(result: ReplayResult, series: ReplaySeries) -> Chart:
    x, kept = decimated(series.drive_s, {"can": series.can_faults, "gnss": series.gnss_faults}, POINTS)
    return Chart(
        "Faults of the inputs so far",
        TIME_LABEL,
        "faults",
        x,
        (Curve("CAN", kept["can"], "after"), Curve("GNSS", kept["gnss"], "before")),
        group=GROUP,
        time=True,
    )


def _alarm_instants(result: ReplayResult) -> tuple[MarkedInstant, ...]:
    """Return the instants at which alarms were raised and cleared, in drive time."""
    return tuple(
        MarkedInstant(
            alarm.time_s - result.start_s,
            alarm_label(alarm) + ("" if alarm.state == "raised" else " cleared"),
            "bad" if alarm.state == "raised" else "soft",
        )
        for alarm in result.alarms
    )
