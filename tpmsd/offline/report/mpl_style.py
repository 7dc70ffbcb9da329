"""Names on a matplotlib plot that do not cover each other.

In: axes whose limits are set; moments (x, name, role), or points with their texts. Out: vertical lines, and
names in a strip above the curves, where one that would cover another is left out and counted; texts beside
points.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.font_manager import FontProperties

from tpmsd.foundation.palette import STYLES
from tpmsd.offline.report.point_labels import GAP_PT, Name, choose_corners

ROWS = 3
GAP_PX = 8.0
"""Between two names of a row."""
GROUND = {"boxstyle": "square,pad=0.1", "facecolor": STYLES["card"].colour, "edgecolor": "none", "alpha": 0.8}
"""Behind text that stands on curves."""


def place_labels(axes: Axes, moments: Sequence[tuple[float, str, str]], fontsize: float = 9.0) -> int:
    """Draw a named vertical line at each moment; return how many names had no room.

    The upper limit of the y axis rises so that the names stand above what is drawn.
    """
    if not moments:
        return 0
    figure = axes.figure.get_figure(root=True)
    assert figure is not None
    figure.draw_without_rendering()  # the layout decides how wide the axes are
    renderer = figure.canvas.get_renderer() if hasattr(figure.canvas, "get_renderer") else None
    box = axes.get_window_extent()
    left, right = axes.get_xlim()
    row_px = 1.35 * fontsize * figure.dpi / 72.0
    free_from = [-float("inf")] * ROWS
    placed = []
    for at, name, style in moments:
        colour = STYLES[style].colour
        axes.axvline(at, gid=f"moment {name}", **moment_style(style))
        width = _width_px(name, fontsize, renderer, figure.dpi)
        x_px = (at - left) / (right - left) * box.width
        to_left = x_px + width + GAP_PX > box.width
        begin = x_px - width - GAP_PX if to_left else x_px
        row = next((row for row, free in enumerate(free_from) if begin >= free), None)
        if row is not None and begin >= -GAP_PX:
            free_from[row] = begin + width + GAP_PX
            placed.append((at, name, colour, row, to_left))
    rows = 1 + max((row for *_, row, _ in placed), default=0)
    low, high = axes.get_ylim()
    share = min((rows + 0.3) * row_px / max(box.height, 1.0), 0.5)
    axes.set_ylim(low, low + (high - low) / (1.0 - share))
    for at, name, colour, row, to_left in placed:
        axes.annotate(
            name,
            xy=(at, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(-3 if to_left else 3, -2 - row * row_px * 72.0 / figure.dpi),
            textcoords="offset points",
            ha="right" if to_left else "left",
            va="top",
            fontsize=fontsize,
            color=colour,
            bbox=GROUND,
            zorder=6,
        )
    return len(moments) - len(placed)


def moment_style(role: str) -> dict[str, Any]:
    """Return matplotlib's options for a moment's line: solid for the role `bad`, dashed for others."""
    return {"color": STYLES[role].colour, "linewidth": 1.2, "linestyle": "-" if role == "bad" else "--"}


def _width_px(text: str, fontsize: float, renderer: RendererBase | None, dpi: float) -> float:
    if renderer is None:
        return 0.62 * fontsize * dpi / 72.0 * len(text)
    width, _, _ = renderer.get_text_width_height_descent(text, FontProperties(size=fontsize), False)
    return float(width)


def name_points(
    axes: Axes, points: Sequence[tuple[float, float]], texts: Sequence[tuple[str, str]], fontsize: float = 9.0
) -> None:
    """Write texts, each with its colour, next to points given in data coordinates of the axes."""
    canvas = axes.figure.get_figure(root=True)
    assert canvas is not None
    canvas.draw_without_rendering()  # the layout decides how large the axes are
    box = axes.get_window_extent()
    names = []
    for point, (text, _) in zip(points, texts, strict=True):
        x, y = axes.transData.transform(point) * 72.0 / canvas.dpi
        lines = text.split("\n")
        width = 0.6 * fontsize * max(map(len, lines))
        at = (x - box.x0 * 72.0 / canvas.dpi, y - box.y0 * 72.0 / canvas.dpi)
        names.append(Name(*at, width, 1.25 * fontsize * len(lines)))
    chosen = choose_corners(names, box.width * 72.0 / canvas.dpi, box.height * 72.0 / canvas.dpi)
    for point, (text, colour), (right, up) in zip(points, texts, chosen, strict=True):
        axes.annotate(
            text,
            point,
            (GAP_PT * right, GAP_PT * up),
            textcoords="offset points",
            ha="left" if right > 0 else "right",
            va="bottom" if up > 0 else "top",
            fontsize=fontsize,
            color=colour,
            bbox=GROUND,
            zorder=6,
        )
