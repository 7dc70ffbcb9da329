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

from tpmsd.foundation.palette import STYLES, line_style
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.report.mpl_style import GROUND, moment_style, place_labels
from tpmsd.offline.report.replay_result import ReplayResult
from tpmsd.offline.report.replay_series import ReplaySeries, settled_range
from tpmsd.offline.report.wording import alarm_label, drive_time, time_step, utc_text, verdict_on, wheel_name
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind

GREY = "#888888"
IDLE: dict[str, Any] = {"color": GREY, "alpha": 0.22, "linewidth": 0}
GAP: dict[str, Any] = {
    "facecolor": STYLES["gap"].colour,
    "edgecolor": "#7a6900",
    "hatch": "///",  # told from IDLE in grey
    "alpha": 0.55,
    "linewidth": 0,
}


def draw_panels(result: ReplayResult) -> Figure:
    """Draw all panels; a drive without a single tick gives a figure that says so."""
    with_faults = bool(result.fault_counts)
    heights = [3.0, 3.0, 0.9, 1.5, 1.0][: 5 if with_faults else 4]
    figure = Figure(figsize=(12.0, 1.4 + 0.95 * sum(heights)), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(_picture_title(result), x=0.01, ha="left", fontsize=14, fontweight="bold")
    if len(result.time_s) == 0:
        figure.text(0.5, 0.5, "no ticks: nothing to draw", ha="center", va="center", fontsize=14)
        return figure
    series = ReplaySeries.of(result)
    grid = figure.subplots(
        len(heights), 1, sharex=True, gridspec_kw={"height_ratios": heights}, squeeze=False
    )
    axes: list[Axes] = list(grid[:, 0])
    _draw_change(axes[0], result, series)
    _draw_deviation(axes[1], series)
    _draw_legend(axes[0], series)
    _draw_probability(axes[2], series)
    _draw_speed(axes[3], series)
    if with_faults:
        _draw_faults(axes[4], series)
    for panel in axes:
        panel.spines[["top", "right"]].set_visible(False)
        panel.margins(x=0.0)
    last = axes[-1]
    last.set_xlim(0.0, max(float(series.drive_s[-1]), 1.0))
    last.xaxis.set_major_locator(MultipleLocator(time_step(float(series.drive_s[-1]))))
    last.xaxis.set_major_formatter(FuncFormatter(lambda value, _: drive_time(value)))
    last.set_xlabel(f"drive time (min:s); 0:00 is {utc_text(result.start_s)}")
    _draw_alarms(axes[0], axes[1], result)  # last, as names are placed by the axes' size
    return figure


def _picture_title(result: ReplayResult) -> str:
    raised = [alarm for alarm in result.alarms if alarm.state == "raised"]
    grave = [alarm for alarm in raised if alarm.kind != AlarmKind.MALFUNCTION] or raised
    if not grave:
        watched = any(outcome.monitored_s > 0 for outcome in result.wheels)
        return f"{result.drive}: no alarm" + ("" if watched else ", but no wheel was monitored either")
    first = min(grave, key=lambda alarm: (alarm.kind != AlarmKind.DEFLATION, alarm.time_s))
    verdict = verdict_on(first)
    when = drive_time(first.time_s - result.start_s)
    return f"{result.drive}: {verdict[0].lower()}{verdict[1:]}, announced at {when}"


def _draw_wheels(
    axis: Axes, series: ReplaySeries, values: FloatArray, std: FloatArray, kind: str
) -> list[str]:
    """Draw line and +-2 sigma band of every wheel that has a value; return the names of the wheels drawn."""
    drawn = []
    for index, wheel in enumerate(WHEELS):
        mean, sigma = values[:, index], std[:, index]
        if not np.isfinite(mean).any():
            continue
        band = axis.fill_between(
            series.drive_s,
            mean - 2 * sigma,
            mean + 2 * sigma,
            color=STYLES[wheel].colour,
            alpha=0.18,
            linewidth=0,
        )
        band.set_gid(f"band {kind} {wheel}")
        axis.plot(series.drive_s, mean, linewidth=1.8, gid=f"{kind} {wheel}", **line_style(wheel))
        drawn.append(wheel)
    return drawn


def _draw_change(axis: Axes, result: ReplayResult, series: ReplaySeries) -> None:
    """Draw the radius changes from which alarms are raised, with their thresholds."""
    drawn = _draw_wheels(axis, series, series.change_mm, series.change_std_mm, "change")
    axis.axhline(0.0, color=GREY, linewidth=0.8)
    loss = -1e3 * float(np.min(result.thresholds.deflation_m))
    other = 1e3 * float(np.min(result.thresholds.deviation_m))
    lines = (
        (loss, "deflation", STYLES["bad"].colour, "-"),
        (-other, "radius deviation", "black", (0, (5, 3))),
        (other, "radius deviation", "black", (0, (5, 3))),
    )
    for level, name, colour, style in lines:
        axis.axhline(level, color=colour, linewidth=1.1, linestyle=style, gid=f"limit {level:+.3f}")
        axis.annotate(
            f"{name} {level:+.2f} mm",
            xy=(0.0, level),  # at the left, where wheels are still at their baselines
            xycoords=("axes fraction", "data"),
            xytext=(4, 3),
            textcoords="offset points",
            fontsize=10,
            color=colour,
            bbox=GROUND,
        )
    axis.set_ylim(*settled_range(series.change_mm, series.change_std_mm, [0.0, loss, -other, other]))
    axis.set_ylabel("radius minus\nbaseline (mm)")
    if not drawn:
        text = f"no baseline yet: {math.floor(100 * result.learning_fraction)}% learned"
        axis.text(0.5, 0.85, text, transform=axis.transAxes, ha="center", color=GREY, fontsize=11)


def _draw_deviation(axis: Axes, series: ReplaySeries) -> None:
    _draw_wheels(axis, series, series.deviation_mm, series.std_mm, "deviation")
    axis.axhline(0.0, color=GREY, linewidth=0.8)
    axis.set_ylim(*settled_range(series.deviation_mm, series.std_mm, [0.0]))
    axis.set_ylabel("radius minus\nnominal (mm)")


def _draw_legend(axis: Axes, series: ReplaySeries) -> None:
    handles: list[Line2D | Patch] = [
        Line2D([], [], linewidth=2, label=wheel_name(wheel), **line_style(wheel))
        for k, wheel in enumerate(WHEELS)
        if np.isfinite(series.deviation_mm[:, k]).any()
    ]
    handles.append(Patch(color=GREY, alpha=0.3, label="±2 standard deviations"))
    axis.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=5, frameon=False, fontsize=10.5
    )


def _draw_probability(axis: Axes, series: ReplaySeries) -> None:
    """Draw one strip per wheel, the darker the more probable a deflation."""
    edges = series.edges_s
    image = axis.pcolormesh(
        edges, np.arange(5) - 0.5, series.probability.T, cmap="Greys", vmin=0.0, vmax=1.0, rasterized=True
    )
    image.set_gid("probability")
    axis.set_yticks(range(4), [wheel.upper() for wheel in WHEELS])
    axis.set_ylim(3.5, -0.5)
    axis.set_facecolor("#FFF3D6")  # unknown: neither low nor high
    axis.set_ylabel("probability\nof deflation")
    if np.isnan(series.probability).any():
        axis.set_title("shaded: not monitored", loc="right", fontsize=9.5, color="#444444", pad=2)
    figure = axis.figure
    figure.colorbar(image, ax=axis, pad=0.005, aspect=6, ticks=[0.0, 1.0])


def _draw_speed(axis: Axes, series: ReplaySeries) -> None:
    axis.plot(series.drive_s, series.speed_kmh, color="black", linewidth=1.2, gid="speed")
    idle, gaps = series.uninformative_spans(), series.outage_spans()
    for spans, name, style in ((idle, "not informative", IDLE), (gaps, "gnss gap", GAP)):
        for start, end in spans:
            axis.axvspan(start, end, gid=name, **style)
    axis.set_ylim(bottom=float(np.nanmin(series.speed_kmh, initial=0.0)))
    axis.set_ylabel("speed\n(km/h)")
    handles = []
    if gaps:
        handles.append(Patch(label="no GNSS fix", **GAP))
    if idle:
        handles.append(Patch(label="not informative: no radius is learned", **IDLE))
    if handles:
        axis.legend(
            handles=handles, loc="lower left", bbox_to_anchor=(0.0, 0.97), ncol=2, frameon=False, fontsize=10
        )


def _draw_faults(axis: Axes, series: ReplaySeries) -> None:
    """Draw the cumulative number of input faults; each step is a fault."""
    for name, counts, colour, dashes in (
        ("CAN", series.can_faults, STYLES["after"].colour, "-"),
        ("GNSS", series.gnss_faults, "black", "--"),
    ):
        axis.step(
            series.drive_s,
            counts,
            where="post",
            color=colour,
            linestyle=dashes,
            linewidth=1.4,
            label=name,
            gid=f"faults {name}",
        )
    axis.set_ylim(bottom=0)
    axis.yaxis.set_major_locator(MaxNLocator(nbins=3, integer=True))
    axis.set_ylabel("faults\nso far")
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 0.95), ncol=2, frameon=False, fontsize=9)


def _draw_alarms(top: Axes, below: Axes, result: ReplayResult) -> None:
    """Draw a line through both panels where an alarm was raised (solid) or cleared (dashed), named on top."""
    moments = []
    for alarm in result.alarms:
        at_s = alarm.time_s - result.start_s
        raised = alarm.state == "raised"
        _mark_on_curve(below, alarm, at_s)
        below.axvline(at_s, gid=_alarm_gid(alarm), **moment_style("bad" if raised else "soft"))
        name = f"{alarm_label(alarm)} {'' if raised else 'cleared '}{drive_time(at_s)}"
        moments.append((at_s, name, "bad" if raised else "soft"))
    left_out = place_labels(top, moments, fontsize=10)
    if left_out:
        text = f"{left_out} more changes of alarms have no room for a name"
        below.set_title(text, loc="right", fontsize=9.5, color="#444444", pad=2)


def _alarm_gid(alarm: AlarmEvent) -> str:
    return f"alarm {alarm.kind} {alarm.wheel} {alarm.state}"


def _mark_on_curve(axis: Axes, alarm: AlarmEvent, at_s: float) -> None:
    """Draw a marker on the wheel's curve where an alarm was raised or cleared."""
    if alarm.wheel is None or not np.isfinite(alarm.deviation_m):
        return
    raised = alarm.state == "raised"
    axis.plot(
        [at_s],
        [alarm.deviation_m * 1e3],
        marker="v" if raised else "^",
        markersize=9,
        color=STYLES["bad"].colour if raised else "white",
        markeredgecolor="black",
        linestyle="none",
        zorder=5,
        gid=f"mark {alarm.kind} {alarm.wheel} {alarm.state}",
    )
