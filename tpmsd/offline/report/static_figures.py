"""Figures as SVG for a page: what is shown without JavaScript, and on paper. Needs matplotlib.

In: `Chart`, `Bars`, `Track`. Out: an `<svg>` element whose colours are the page's CSS variables, so that it
follows the page into a dark theme and onto paper. Its styles are attributes: a page's content security
policy may forbid others.
"""

from __future__ import annotations

import datetime
import io
import math
import re
import textwrap
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure as Canvas
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, MaxNLocator, MultipleLocator

from tpmsd.foundation.palette import STYLES, line_style
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.report.decimation import decimated
from tpmsd.offline.report.figures import Bars, Chart, Figure, Track
from tpmsd.offline.report.mpl_style import GROUND, name_points, place_labels
from tpmsd.offline.report.wording import drive_time, time_step

WIDTH_IN, HEIGHT_IN, BAR_IN = 5.8, 2.7, 0.25
"""On a page of 180 mm (A4) letters of 10 pt come out at 12 pt, on a phone of 400 pixels at 9 pixels."""
NAME_CHARACTERS = 30
"""Longer names of bars are broken, so that the bars keep most of the width."""
POINTS = 700
DPI = 72
"""That of SVG files: one pixel is one point."""
HEAT_STEPS = 16
BAND_ALPHA = 0.2
DAY_S = 86_400.0
_DAY_STEPS = (1, 2, 3, 7, 14, 30, 61, 91, 183, 365, 1826)
_RC: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "tpmsd",
    "font.size": 10,
    "axes.edgecolor": STYLES["plain"].colour,
    "axes.labelcolor": STYLES["plain"].colour,
    "text.color": STYLES["plain"].colour,
    "xtick.color": STYLES["plain"].colour,
    "ytick.color": STYLES["plain"].colour,
    "grid.color": STYLES["line"].colour,
    "axes.spines.top": False,
    "axes.spines.right": False,
}
_VARIABLES = {style.colour: f"var(--{role})" for role, style in STYLES.items()}
_NUMBER = re.compile(r"-?\d+\.\d{2,}")


@dataclass(frozen=True)
class Picture:
    """A figure as an `<svg>` element."""

    svg: str
    points: FloatArray
    """(n, 2) of a `Track`: its points in the coordinates of the element, y downwards; (0, 2) of others."""


def draw_static(figure: Figure, key: str) -> Picture:
    """Return the picture; `key` is unique on its page."""
    points = np.empty((0, 2))
    with mpl.rc_context(_RC):
        if isinstance(figure, Chart):
            canvas = _draw_chart(figure)
        elif isinstance(figure, Bars):
            canvas = _draw_bars(figure)
        else:
            canvas = _draw_track(figure)
        buffer = io.StringIO()
        canvas.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
        if isinstance(figure, Track):
            points = canvas.axes[0].transData.transform(np.column_stack([figure.east_m, figure.north_m]))
            points[:, 1] = DPI * canvas.get_figheight() - points[:, 1]
    return Picture(_page_svg(buffer.getvalue(), key, figure.title), points)


def _new_canvas(height_in: float) -> tuple[Canvas, Axes]:
    canvas = Canvas(figsize=(WIDTH_IN, height_in), dpi=DPI, layout="constrained")
    FigureCanvasSVG(canvas)
    return canvas, canvas.subplots()


def _draw_chart(chart: Chart) -> Canvas:
    canvas, axes = _new_canvas(HEIGHT_IN)
    axes.grid(linewidth=0.5)
    handles: list[Line2D | Patch] = []
    if chart.noise is not None:
        axes.axhspan(*chart.noise, color=STYLES["line"].colour, alpha=0.45, linewidth=0)
    for span in chart.spans:
        axes.axvspan(span.start, span.end, color=STYLES[span.style].colour, alpha=0.5, linewidth=0)
    for curve in chart.curves:
        columns = {"y": curve.y}
        if curve.low is not None and curve.high is not None:
            columns |= {"low": curve.low, "high": curve.high}
        x, kept = decimated(chart.x, columns, POINTS)
        if "low" in kept:
            colour = STYLES[curve.style].colour
            axes.fill_between(x, kept["low"], kept["high"], color=colour, alpha=BAND_ALPHA, linewidth=0)
        marker = "o" if curve.dots else None
        axes.plot(x, kept["y"], linewidth=1.5, marker=marker, markersize=3.5, **line_style(curve.style))
        handles.append(Line2D([], [], linewidth=1.8, label=curve.name, **line_style(curve.style)))
    for level in chart.levels:
        axes.axhline(level.at, linewidth=1.0, **line_style(level.style))
        _draw_level_name(axes, level.at, level.name, level.style)
    handles += [
        Patch(color=STYLES[style].colour, alpha=0.5, label=name) for style, name in chart.legend_spans()
    ]
    if len(handles) > 1 or chart.legend_spans():
        axes.legend(
            handles=handles, loc="lower left", bbox_to_anchor=(0, 1), ncols=4, frameon=False, fontsize=9
        )
    axes.set(xlabel=chart.x_label, ylabel=chart.y_label)
    axes.set_ylim(*chart.extent())
    _set_x_ticks(axes, chart)
    place_labels(axes, [(one.at, one.name, one.style) for one in chart.moments], fontsize=8.5)
    return canvas


def _set_x_ticks(axes: Axes, chart: Chart) -> None:
    """Set the marks of an x axis of drive time, dates or counts to whole seconds, days or numbers."""
    known = chart.x[np.isfinite(chart.x)]
    if chart.time and len(known):
        span_s = max(float(known[-1]), 1.0)
        axes.set_xlim(0.0, span_s)
        axes.xaxis.set_major_locator(MultipleLocator(time_step(span_s, 7)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: drive_time(value)))
    if chart.counts:
        axes.xaxis.set_major_locator(MaxNLocator(nbins=10, integer=True))
    if chart.date and len(known):
        first, last = float(np.min(known)), float(np.max(known))
        if last - first < DAY_S:  # drives of one day: an empty span has no marks
            axes.set_xlim(first - DAY_S, last + DAY_S)
        axes.xaxis.set_major_locator(MultipleLocator(_days_step(last - first) * DAY_S))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: utc_day(value)))


def utc_day(time_s: float) -> str:
    """Return the date of a host time (UTC)."""
    return datetime.datetime.fromtimestamp(time_s, tz=datetime.UTC).strftime("%Y-%m-%d")


def _days_step(span_s: float) -> int:
    """Return the whole days between the marks of an axis of dates, which has five steps at most."""
    return next((step for step in _DAY_STEPS if span_s <= 5 * step * DAY_S), _DAY_STEPS[-1])


def _draw_level_name(axes: Axes, at: float, name: str, style: str) -> None:
    axes.annotate(
        name,
        xy=(0.0, at),
        xycoords=("axes fraction", "data"),
        xytext=(3, 2),
        textcoords="offset points",
        fontsize=9,
        color=STYLES[style].colour,
        bbox=GROUND,
        zorder=6,
    )


def _draw_bars(bars: Bars) -> Canvas:
    names = [textwrap.fill(name, NAME_CHARACTERS) for name, _, _ in bars.rows]
    lines = max((name.count("\n") + 1 for name in names), default=1)
    canvas, axes = _new_canvas(0.8 + BAR_IN * lines * max(len(names), 1))
    values = np.array([max(value, 0.0) for _, value, _ in bars.rows])
    axes.grid(axis="x", linewidth=0.5)
    axes.set_axisbelow(True)
    positions = np.arange(len(values))[::-1]
    colours = [STYLES["after" if marked else "soft"].colour for _, _, marked in bars.rows]
    if is_logarithmic(bars):
        axes.set_xscale("symlog", linthresh=1.0, linscale=0.5)
        axes.set_xlim(0.0, float(values.max()) * 4.0)
        decades = math.floor(math.log10(float(values.max()) * 4.0))
        every = 1 + decades**2 // 25  # longer numbers need more room each
        axes.set_xticks([0.0, *(10.0**decade for decade in range(0, decades + 1, every))])
    else:
        axes.set_xlim(0.0, max(float(values.max(initial=0.0)), 1e-9) * 1.18)
    axes.barh(positions, values, color=colours, height=0.7)
    axes.set_yticks(positions, names)
    for position, value in zip(positions, values, strict=True):
        text = _grouped_digits(value)
        axes.annotate(text, (value, position), (4, 0), textcoords="offset points", va="center", fontsize=9)
    if not is_logarithmic(bars):
        axes.locator_params(axis="x", nbins=5)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: _grouped_digits(value)))
    axes.set_xlabel(bars.x_label + (", logarithmic" if is_logarithmic(bars) else ""))
    return canvas


def _grouped_digits(value: float) -> str:
    """Return a number with its digits in groups of three."""
    return f"{value:,.0f}".replace(",", "\u202f") if value >= 10 else f"{value:.2g}"


def is_logarithmic(bars: Bars) -> bool:
    """Return whether the values span more than two decades."""
    values = [value for _, value, _ in bars.rows if value > 0.0]
    return bool(values) and max(values) > 100.0 * min(values)


def _draw_track(track: Track) -> Canvas:
    wide = max(float(np.ptp(track.east_m)), 1.0)
    tall = max(float(np.ptp(track.north_m)), 1.0)
    canvas, axes = _new_canvas(min(max(0.8 + 5.2 * tall / wide, 2.2), 5.0))
    low, high = heat_range(track.value)
    segments = np.stack(
        [
            np.column_stack([track.east_m[:-1], track.north_m[:-1]]),
            np.column_stack([track.east_m[1:], track.north_m[1:]]),
        ],
        axis=1,
    )
    share = np.clip((track.value[:-1] - low) / max(high - low, 1e-12), 0.0, 1.0)
    step = np.where(np.isfinite(share), np.floor(share * (HEAT_STEPS - 1e-9)), -1).astype(int)
    colours = mpl.colormaps["cividis"](np.linspace(0.0, 1.0, HEAT_STEPS))
    # The highest values last: where the car drove twice, they must not be hidden.
    for level in range(HEAT_STEPS):
        chosen = segments[step == level]
        if len(chosen):
            # One path per colour instead of one per segment.
            points = np.full((len(chosen), 3, 2), np.nan)
            points[:, :2] = chosen
            axes.plot(*points.reshape(-1, 2).T, color=colours[level], linewidth=3.0, solid_capstyle="round")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(linewidth=0.5)
    axes.locator_params(nbins=5)
    axes.set(xlabel="east (m)", ylabel="north (m)")
    marks = [(0, "start", "o", "plain", 5), (-1, "end", "s", "plain", 5)]
    marks += [(k, "\n".join(names), "D", "bad", 6) for k, names in _marked_rows(track)]
    at_points = [(float(track.east_m[k]), float(track.north_m[k])) for k, *_ in marks]
    for at, (_, _, marker, style, size) in zip(at_points, marks, strict=True):
        axes.plot(*at, marker, color=STYLES[style].colour, markersize=size)
    _draw_colour_scale(axes, low, high, track.colour_label)
    name_points(axes, at_points, [(text, STYLES[style].colour) for _, text, _, style, _ in marks])
    return canvas


def _marked_rows(track: Track) -> list[tuple[int, list[str]]]:
    """Return (row, names) of the track's moments; those nearer than a tenth of its width share a row."""
    near_m = 0.1 * max(float(np.ptp(track.east_m)), float(np.ptp(track.north_m)))
    out: list[tuple[int, list[str]]] = []
    if track.time_s is None:
        return out
    for moment in track.moments:
        k = min(int(np.searchsorted(track.time_s, moment.at)), len(track.east_m) - 1)
        for other, names in out:
            away_m = np.hypot(track.east_m[k] - track.east_m[other], track.north_m[k] - track.north_m[other])
            if away_m < near_m:
                names.append(moment.name)
                break
        else:
            out.append((k, [moment.name]))
    return out


def heat_range(values: FloatArray) -> tuple[float, float]:
    """Return the values at both ends of a track's colour scale: the 2 % and 98 % quantiles."""
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return 0.0, 1.0
    low, high = (float(edge) for edge in np.quantile(known, [0.02, 0.98]))
    return (low, high) if high > low else (low, low + 1.0)


def _draw_colour_scale(axes: Axes, low: float, high: float, label: str) -> None:
    """Draw a bar beside the axes, of vector patches: an image would be a file of its own."""
    inset = axes.inset_axes((1.02, 0.0, 0.025, 1.0))
    edges = np.linspace(low, high, HEAT_STEPS + 1)
    colours = mpl.colormaps["cividis"](np.linspace(0.0, 1.0, HEAT_STEPS))
    inset.bar(0, np.diff(edges), bottom=edges[:-1], color=colours, width=1.0)
    inset.set(xlim=(-0.5, 0.5), ylim=(low, high), xticks=[])
    inset.yaxis.tick_right()
    inset.yaxis.set_label_position("right")
    inset.set_ylabel(label)
    inset.spines["right"].set_visible(True)


def _page_svg(text: str, key: str, title: str) -> str:
    """Return matplotlib's SVG as an element of a page: styles as attributes, the page's colours, unique
    ids."""
    root = ElementTree.fromstring(text)
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag.endswith(("}metadata", "}style")):
                parent.remove(child)
    used = set(re.findall(r"#([\w.-]+)", " ".join(" ".join(one.attrib.values()) for one in root.iter())))
    for element in root.iter():
        element.tag = element.tag.partition("}")[2] or element.tag
        _strip_namespaces(element, key, used)
        _round_numbers(element)
    for name in ("width", "height", "version"):
        root.attrib.pop(name, None)
    root.set("role", "img")
    root.set("aria-label", title)
    root.set("class", "static")
    return ElementTree.tostring(root, encoding="unicode")


def _strip_namespaces(element: ElementTree.Element, key: str, used: set[str]) -> None:
    """Remove the namespaces of an element's attributes, turn its style into attributes, and prefix its
    ids."""
    attributes = {name.partition("}")[2] or name: value for name, value in element.attrib.items()}
    element.attrib.clear()
    for name, value in attributes.items():
        if name == "style":
            for attribute, setting in _style_attributes(value):
                element.set(attribute, _VARIABLES.get(setting, setting))
        elif name != "id":
            element.set(name, value)
        elif value in used:
            element.set("id", f"{key}-{value}")
    for name in ("href", "clip-path"):
        if name in element.attrib:
            element.set(name, element.attrib[name].replace("#", f"#{key}-"))


def _round_numbers(element: ElementTree.Element) -> None:
    """Round positions and sizes to a tenth of a point."""
    for name in ("d", "transform", "x", "y", "width", "height", "points"):
        if name in element.attrib:
            element.set(name, _NUMBER.sub(lambda found: f"{float(found[0]):.1f}", element.attrib[name]))
    if "d" in element.attrib:
        element.set("d", " ".join(element.attrib["d"].split()))


def _style_attributes(style: str) -> list[tuple[str, str]]:
    """Return a style, `fill: none; font: 10px 'DejaVu Sans'`, as (attribute, value) pairs of SVG."""
    out = []
    for part in style.split(";"):
        name, _, value = (piece.strip() for piece in part.partition(":"))
        if name == "font":
            size = re.search(r"([\d.]+)px", value)
            if size is not None:
                out.append(("font-size", size[1]))
            if "bold" in value:
                out.append(("font-weight", "bold"))
        elif name:
            out.append((name, value))
    return out
