"""The panels of a replay's picture. Imported only where matplotlib is installed.

In: a `ReplayResult`. Out: a matplotlib `Figure` whose panels share the drive's time. Artists carry a gid
('deviation rl', 'band rl', 'gnss gap', ...) by which a reader of the SVG, or a test, finds them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, MaxNLocator, MultipleLocator
from numpy.typing import NDArray

from tpmsd.monitor.records import AlarmEvent, AlarmKind
from tpmsd.report.replay_result import GNSS_GAP_S, ReplayResult
from tpmsd.report.wording import alarm_label, drive_time, verdict_on, wheel_name
from tpmsd.wheels import WHEELS, FloatArray

# Okabe and Ito's palette: told apart by colour-blind readers, and in print by its lightness.
COLOURS = {"fl": "#0072B2", "fr": "#E69F00", "rl": "#009E73", "rr": "#CC79A7"}
ALARM_COLOUR = "#D55E00"
GREY = "#888888"
GAP_COLOUR = "#F0E442"
MAX_POINTS = 4000
"""More columns than a picture has pixels; keeps vector files small."""
BREAK_S = 5.0
"""A line is interrupted where the series itself has a hole longer than this (and than three steps)."""


def draw(result: ReplayResult) -> Figure:
    """Draw all panels; a drive without a single tick gives a figure that says so."""
    with_faults = bool(result.fault_counts)
    heights = [3.0, 3.0, 0.9, 1.5, 1.0][: 5 if with_faults else 4]
    figure = Figure(figsize=(12.0, 1.4 + 0.95 * sum(heights)), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(_title(result), x=0.01, ha="left", fontsize=14, fontweight="bold")
    if len(result.time_s) == 0:
        figure.text(0.5, 0.5, "no ticks: nothing to draw", ha="center", va="center", fontsize=14)
        return figure
    series = _Series(result)
    grid = figure.subplots(
        len(heights), 1, sharex=True, gridspec_kw={"height_ratios": heights}, squeeze=False
    )
    axes: list[Axes] = list(grid[:, 0])
    _draw_deviation(axes[0], result, series)
    _draw_change(axes[1], result, series)
    _draw_probability(axes[2], series)
    _draw_speed(axes[3], series)
    if with_faults:
        _draw_faults(axes[4], series)
    _draw_alarms(axes[0], axes[1], result)
    for panel in axes:
        panel.spines[["top", "right"]].set_visible(False)
        panel.margins(x=0.0)
    last = axes[-1]
    last.set_xlim(0.0, max(float(series.drive_s[-1]), 1.0))
    last.xaxis.set_major_locator(MultipleLocator(_tick_step(float(series.drive_s[-1]))))
    last.xaxis.set_major_formatter(FuncFormatter(lambda value, _: drive_time(value)))
    last.set_xlabel(f"drive time (min:s); 0:00 is host time {result.start_s:.3f} s")
    return figure


def _tick_step(span_s: float) -> float:
    """Seconds between ticks of the time axis: a round number of seconds or minutes; at most 13 ticks."""
    steps = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 43200)
    return float(next((step for step in steps if span_s / step <= 12), span_s / 12))


class _Series:
    """The series as they are drawn: in drive time, thinned, with a row of NaN where the recording pauses."""

    def __init__(self, result: ReplayResult) -> None:
        count = len(result.time_s)
        stride = max(1, -(-count // MAX_POINTS))
        pick = np.unique(np.append(np.arange(0, count, stride), count - 1))
        time_s = result.time_s[pick] - result.start_s
        steps = np.diff(time_s)
        step_s = float(np.median(steps)) if len(steps) else 0.0
        breaks = np.flatnonzero(steps > max(BREAK_S, 3.0 * step_s)) + 1

        def broken(values: NDArray[Any]) -> FloatArray:
            return np.insert(np.asarray(values[pick], dtype=np.float64), breaks, np.nan, axis=0)

        self.drive_s: FloatArray = np.insert(time_s, breaks, time_s[breaks] - step_s)
        self.speed_kmh = broken(result.speed_mps) * 3.6
        self.informative = broken(result.informative)
        self.gnss_age_s = broken(result.gnss_age_s)
        self.probability = broken(result.deflation_probability)
        self.faults = {"CAN": broken(result.can_faults), "GNSS": broken(result.gnss_faults)}
        self.deviation_mm = broken(result.deviation_m) * 1e3
        self.std_mm = broken(result.std_m) * 1e3
        self.change_mm = broken(result.change_m) * 1e3
        self.change_std_mm = broken(result.change_std_m) * 1e3


def _title(result: ReplayResult) -> str:
    raised = [alarm for alarm in result.alarms if alarm.state == "raised"]
    grave = [alarm for alarm in raised if alarm.kind != AlarmKind.MALFUNCTION] or raised
    if not grave:
        watched = any(outcome.monitored_s > 0 for outcome in result.wheels)
        return f"{result.drive}: no alarm" + ("" if watched else ", but no wheel was monitored either")
    first = min(grave, key=lambda alarm: (alarm.kind != AlarmKind.DEFLATION, alarm.time_s))
    verdict = verdict_on(first)
    when = drive_time(first.time_s - result.start_s)
    return f"{result.drive}: {verdict[0].lower()}{verdict[1:]}, announced at {when}"


def _draw_wheels(axis: Axes, series: _Series, values: FloatArray, std: FloatArray, kind: str) -> list[str]:
    """Line and +-2 sigma band of every wheel that has a value; gives the wheels drawn."""
    drawn = []
    for index, wheel in enumerate(WHEELS):
        mean, sigma = values[:, index], std[:, index]
        if not np.isfinite(mean).any():
            continue
        band = axis.fill_between(
            series.drive_s, mean - 2 * sigma, mean + 2 * sigma, color=COLOURS[wheel], alpha=0.18, linewidth=0
        )
        band.set_gid(f"band {kind} {wheel}")
        axis.plot(series.drive_s, mean, color=COLOURS[wheel], linewidth=1.6, gid=f"{kind} {wheel}")
        drawn.append(wheel)
    return drawn


def _limits(values: FloatArray, std: FloatArray, marks: list[float]) -> tuple[float, float]:
    """An axis range that holds the settled part of the curves and the marks.

    The first seconds of a filter, when it knows nothing yet, have bands of centimetres that would flatten all
    that follows; rows with a standard deviation above four times the median are therefore left out.
    """
    known = np.isfinite(values) & np.isfinite(std)
    low, high = min(marks), max(marks)
    if known.any():
        settled = known & (std <= 4.0 * np.median(std[known]))
        low = min(low, float(np.min(values[settled] - 2 * std[settled])))
        high = max(high, float(np.max(values[settled] + 2 * std[settled])))
    pad = 0.06 * max(high - low, 0.5)
    # Room at the top for the legend and the labels of alarms.
    return low - pad, high + 4.0 * pad


def _draw_deviation(axis: Axes, result: ReplayResult, series: _Series) -> None:
    drawn = _draw_wheels(axis, series, series.deviation_mm, series.std_mm, "deviation")
    axis.axhline(0.0, color=GREY, linewidth=0.8)
    marks = [0.0]
    for index, wheel in enumerate(WHEELS):
        baseline_m = result.deviation_m[:, index] - result.change_m[:, index]
        known = np.isfinite(baseline_m)
        if not known.any():
            continue
        level = float(np.median(baseline_m[known]) - result.thresholds.deflation_m[index]) * 1e3
        axis.axhline(
            level, color=COLOURS[wheel], linewidth=1.0, linestyle=(0, (4, 3)), gid=f"threshold {wheel}"
        )
        marks.append(level)
    axis.set_ylim(*_limits(series.deviation_mm, series.std_mm, marks))
    axis.set_ylabel("radius minus\nnominal (mm)")
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=COLOURS[wheel], linewidth=2, label=wheel_name(wheel)) for wheel in drawn
    ]
    handles.append(Patch(color=GREY, alpha=0.3, label="±2 standard deviations"))
    if len(marks) > 1:
        handles.append(Line2D([], [], color=GREY, linestyle=(0, (4, 3)), label="deflation threshold"))
    axis.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=6, frameon=False, fontsize=10
    )


def _draw_change(axis: Axes, result: ReplayResult, series: _Series) -> None:
    drawn = _draw_wheels(axis, series, series.change_mm, series.change_std_mm, "change")
    axis.axhline(0.0, color=GREY, linewidth=0.8)
    loss = -1e3 * float(np.min(result.thresholds.deflation_m))
    other = 1e3 * float(np.min(result.thresholds.deviation_m))
    lines = (
        (loss, "deflation", ALARM_COLOUR, "-"),
        (-other, "radius deviation", "black", ":"),
        (other, "", "black", ":"),
    )
    for level, name, colour, style in lines:
        axis.axhline(level, color=colour, linewidth=1.1, linestyle=style, gid=f"limit {level:+.3f}")
        if name:
            axis.annotate(
                f"{name} {level:+.2f} mm",
                xy=(0.0, level),  # at the left, where wheels are still at their baselines
                xycoords=("axes fraction", "data"),
                xytext=(4, 3),
                textcoords="offset points",
                fontsize=9,
                color=colour,
            )
    axis.set_ylim(*_limits(series.change_mm, series.change_std_mm, [0.0, loss, -other, other]))
    axis.set_ylabel("radius minus\nbaseline (mm)")
    if not drawn:
        text = f"no baseline yet: {math.floor(100 * result.learning_fraction)}% learned"
        axis.text(0.5, 0.85, text, transform=axis.transAxes, ha="center", color=GREY, fontsize=11)


def _draw_probability(axis: Axes, series: _Series) -> None:
    """One strip per wheel, the darker the more probable a deflation."""
    edges = _edges(series.drive_s)
    image = axis.pcolormesh(
        edges, np.arange(5) - 0.5, series.probability.T, cmap="OrRd", vmin=0.0, vmax=1.0, rasterized=True
    )
    image.set_gid("probability")
    axis.set_yticks(range(4), [wheel.upper() for wheel in WHEELS])
    axis.set_ylim(3.5, -0.5)
    axis.set_facecolor("#EEEEEE")  # unknown: neither low nor high
    axis.set_ylabel("probability\nof deflation")
    figure = axis.figure
    figure.colorbar(image, ax=axis, pad=0.005, aspect=6, ticks=[0.0, 1.0])


def _edges(centres: FloatArray) -> FloatArray:
    """Edges between samples: n + 1 for n centres, never decreasing (a host clock may step back)."""
    previous = np.concatenate([[0.0], centres])
    return np.asarray(np.maximum.accumulate(previous), dtype=np.float64)


def _spans(mask: NDArray[np.bool_], edges: FloatArray) -> list[tuple[float, float]]:
    """The intervals of the edges in which the mask holds."""
    padded = np.concatenate([[False], mask, [False]])
    flips = np.flatnonzero(padded[1:] != padded[:-1])
    return [(float(edges[a]), float(edges[b])) for a, b in zip(flips[::2], flips[1::2], strict=True)]


def _draw_speed(axis: Axes, series: _Series) -> None:
    edges = _edges(series.drive_s)
    axis.plot(series.drive_s, series.speed_kmh, color="black", linewidth=1.2, gid="speed")
    idle = _spans(series.informative == 0.0, edges)
    for start, end in idle:
        axis.axvspan(start, end, color=GREY, alpha=0.22, linewidth=0, gid="not informative")
    silent_s = np.minimum(series.gnss_age_s, series.drive_s)  # before the first fix the wait counts
    lost = silent_s > GNSS_GAP_S
    gaps = _spans(lost, edges)
    for start, end in gaps:
        # The gap began with the last fix, which is as old as the first row beyond the limit says.
        first = np.flatnonzero(lost & (series.drive_s > start))[0]
        begin = max(0.0, float(series.drive_s[first] - silent_s[first]))
        axis.axvspan(begin, end, color=GAP_COLOUR, alpha=0.55, linewidth=0, gid="gnss gap")
    axis.set_ylim(bottom=float(np.nanmin(series.speed_kmh, initial=0.0)))
    axis.set_ylabel("speed\n(km/h)")
    handles = []
    if gaps:
        handles.append(Patch(color=GAP_COLOUR, alpha=0.55, label="no GNSS"))
    if idle:
        handles.append(Patch(color=GREY, alpha=0.22, label="not informative"))
    if handles:
        axis.legend(
            handles=handles, loc="lower left", bbox_to_anchor=(0.0, 0.97), ncol=2, frameon=False, fontsize=9
        )


def _draw_faults(axis: Axes, series: _Series) -> None:
    """Faults of the inputs so far: where the steps are, something was wrong."""
    for (name, counts), colour in zip(series.faults.items(), ("#56B4E9", "black"), strict=True):
        axis.step(
            series.drive_s,
            counts,
            where="post",
            color=colour,
            linewidth=1.4,
            label=name,
            gid=f"faults {name}",
        )
    axis.set_ylim(bottom=0)
    axis.yaxis.set_major_locator(MaxNLocator(nbins=3, integer=True))
    axis.set_ylabel("faults\nso far")
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 0.95), ncol=2, frameon=False, fontsize=9)


def _draw_alarms(top: Axes, below: Axes, result: ReplayResult) -> None:
    """A line through both panels where an alarm was raised (solid) or cleared (dashed), labelled on top.

    A label that would cover another is left out and counted.
    """
    end_s = max(float(result.time_s[-1] - result.start_s), 1.0)
    free_from = [-np.inf] * 3
    unlabelled = 0
    for alarm in result.alarms:
        at_s = alarm.time_s - result.start_s
        raised = alarm.state == "raised"
        colour = ALARM_COLOUR if raised else GREY
        for axis in (top, below):
            axis.axvline(
                at_s,
                color=colour,
                linewidth=1.4 if raised else 1.1,
                linestyle="-" if raised else "--",
                gid=f"alarm {alarm.kind} {alarm.wheel} {alarm.state}",
            )
        _mark_on_curve(top, alarm, at_s)
        unlabelled += not _label(top, alarm, at_s, end_s, free_from)
    if unlabelled:
        text = f"{unlabelled} more changes of alarms have no room for a label"
        below.set_title(text, loc="right", fontsize=9, color="#444444", pad=2)


def _mark_on_curve(axis: Axes, alarm: AlarmEvent, at_s: float) -> None:
    if alarm.wheel is None or not np.isfinite(alarm.deviation_m):
        return
    raised = alarm.state == "raised"
    axis.plot(
        [at_s],
        [alarm.deviation_m * 1e3],
        marker="v" if raised else "^",
        markersize=9,
        color=ALARM_COLOUR if raised else "white",
        markeredgecolor="black",
        linestyle="none",
        zorder=5,
        gid=f"mark {alarm.kind} {alarm.wheel} {alarm.state}",
    )


def _label(axis: Axes, alarm: AlarmEvent, at_s: float, end_s: float, free_from: list[float]) -> bool:
    """Put the label on the first of three rows that is free; left of its line near the right edge."""
    raised = alarm.state == "raised"
    text = f"{alarm_label(alarm)} {'' if raised else 'cleared '}{drive_time(at_s)}"
    width = (0.01 + 0.0085 * len(text)) * end_s
    left = at_s + width > end_s
    begin = at_s - width if left else at_s
    row = next((row for row, free in enumerate(free_from) if begin >= free), None)
    if row is None:
        return False
    free_from[row] = begin + width
    axis.annotate(
        text,
        xy=(at_s, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(-4 if left else 4, -4 - 14 * row),
        textcoords="offset points",
        ha="right" if left else "left",
        va="top",
        fontsize=10,
        fontweight="bold" if raised else "normal",
        color=ALARM_COLOUR if raised else "#444444",
        bbox={"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
        zorder=6,
    )
    return True
