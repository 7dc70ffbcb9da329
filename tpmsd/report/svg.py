"""Pictures as SVG text, for pages that must stand alone.

In: numbers. Out: `<svg>` elements with axes, units and legends; nothing is loaded from elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

WIDTH, HEIGHT = 660.0, 300.0
LEFT, RIGHT, TOP, BOTTOM = 66.0, 16.0, 46.0, 44.0
INK, FAINT, BAND = "#333333", "#dddddd", "#eef1ee"
BEFORE, AFTER = "#c0392b", "#1f6fb2"

_Scale = Callable[[float], float]
"""From a number to a place."""


@dataclass(frozen=True)
class Series:
    """A named line; `stds` draws error bars, `dots` marks the points, NaN interrupts it."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    colour: str
    stds: Sequence[float] = ()
    dots: bool = True
    width: float = 1.8


@dataclass(frozen=True)
class Mark:
    """A vertical line with a word at its top."""

    x: float
    name: str
    colour: str


def ticks(low: float, high: float, wanted: int = 6) -> list[float]:
    """Round numbers from `low` to `high`, about so many: steps of 1, 2 or 5 times a power of ten."""
    span = max(high - low, 1e-300)
    raw = span / wanted
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * m for m in (1.0, 2.0, 5.0, 10.0) if power * m >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    return [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]


def number(value: float, step: float = 0.0) -> str:
    """A tick's label: as many decimals as the step needs, and no more."""
    if value == 0.0 or abs(value) < 1e-9 * abs(step):
        return "0"
    if abs(value) >= 1e5 or abs(value) < 1e-3:
        return f"{value:.3g}"
    decimals = max(0, -math.floor(math.log10(step) + 1e-9)) if step > 0.0 else 3
    return f"{value:.{decimals}f}"


def chart(
    series: Sequence[Series],
    x_label: str,
    y_label: str,
    band: tuple[float, float, str] | None = None,
    marks: Sequence[Mark] = (),
    levels: Sequence[tuple[float, str]] = (),
    height: float = HEIGHT,
) -> str:
    """Lines over a common pair of axes.

    `band` shades (low, high, what it is); `levels` are horizontal lines with a word.
    """
    points = [(a, b) for s in series for a, b in zip(s.x, s.y, strict=True) if math.isfinite(b)]
    bars = [(b - e, b + e) for s in series for b, e in zip(s.y, s.stds, strict=False) if math.isfinite(b + e)]
    ys = [b for _, b in points] + [v for pair in bars for v in pair] + [level for level, _ in levels]
    if band:
        ys += [band[0], band[1]]
    if not points:
        return ""
    x0, x1 = _wide(min(a for a, _ in points), max(a for a, _ in points), 0.02)
    y0, y1 = _wide(min(ys), max(ys), 0.06)

    def px(v: float) -> float:
        return LEFT + (v - x0) / (x1 - x0) * (WIDTH - LEFT - RIGHT)

    def py(v: float) -> float:
        return height - BOTTOM - (v - y0) / (y1 - y0) * (height - BOTTOM - TOP)

    out = [_open(WIDTH, height)]
    if band:
        top, tall = py(min(band[1], y1)), py(max(band[0], y0)) - py(min(band[1], y1))
        out.append(
            f'<rect x="{LEFT:.1f}" y="{top:.1f}" width="{WIDTH - LEFT - RIGHT:.1f}" height="{tall:.1f}"'
            f' fill="{BAND}"/>'
        )
    out += _axes(x0, x1, y0, y1, px, py, height)
    for level, name in levels:
        out.append(_line(LEFT, WIDTH - RIGHT, py(level), py(level), "#888888", 0.8, "5 4"))
        out.append(_text(WIDTH - RIGHT - 4, py(level) - 4, name, "end", "#666666", halo=True))
    for mark in marks:
        out.append(_line(px(mark.x), px(mark.x), TOP, height - BOTTOM, mark.colour, 1.2, "3 3"))
        out.append(_text(px(mark.x) + 4, TOP + 12, mark.name, "start", mark.colour, halo=True))
    for one in series:
        out += _drawn(one, px, py)
    out += _legend([(s.name, s.colour) for s in series], (band[2], BAND) if band else None)
    out.append(_text((LEFT + WIDTH - RIGHT) / 2, height - 8, x_label, "middle"))
    middle = (TOP + height - BOTTOM) / 2
    out.append(
        f'<text transform="translate(14 {middle:.1f}) rotate(-90)" text-anchor="middle" fill="{INK}">'
        f"{escape(y_label)}</text>"
    )
    return "".join([*out, "</svg>"])


def _axes(x0: float, x1: float, y0: float, y1: float, px: _Scale, py: _Scale, height: float) -> list[str]:
    out = []
    across, up = ticks(x0, x1, 8), ticks(y0, y1, 5)
    for values, is_x in ((across, True), (up, False)):
        step = values[1] - values[0] if len(values) > 1 else 0.0
        for v in values:
            if is_x:
                out.append(_line(px(v), px(v), TOP, height - BOTTOM, FAINT, 0.5))
                out.append(_text(px(v), height - BOTTOM + 15, number(v, step), "middle"))
            else:
                out.append(_line(LEFT, WIDTH - RIGHT, py(v), py(v), FAINT, 0.5))
                out.append(_text(LEFT - 6, py(v) + 4, number(v, step), "end"))
    if y0 < 0.0 < y1:
        out.append(_line(LEFT, WIDTH - RIGHT, py(0.0), py(0.0), "#999999", 0.8))
    out.append(_line(LEFT, WIDTH - RIGHT, height - BOTTOM, height - BOTTOM, INK, 0.8))
    out.append(_line(LEFT, LEFT, TOP, height - BOTTOM, INK, 0.8))
    return out


def _drawn(one: Series, px: _Scale, py: _Scale) -> list[str]:
    out = []
    piece: list[str] = []
    pieces = [piece]
    for a, b in zip(one.x, one.y, strict=True):
        if math.isfinite(b):
            piece.append(f"{px(a):.1f},{py(b):.1f}")
        elif piece:
            piece = []
            pieces.append(piece)
    for a, b, std in zip(one.x, one.y, one.stds, strict=False):
        out.append(_line(px(a), px(a), py(b - std), py(b + std), one.colour, 1.2))
    out += [
        f'<polyline points="{" ".join(points)}" fill="none" stroke="{one.colour}"'
        f' stroke-width="{one.width}" stroke-linejoin="round"/>'
        for points in pieces
        if len(points) > 1
    ]
    if one.dots:
        out += [
            f'<circle cx="{px(a):.1f}" cy="{py(b):.1f}" r="2.6" fill="{one.colour}"/>'
            for a, b in zip(one.x, one.y, strict=True)
            if math.isfinite(b)
        ]
    return out


def _legend(entries: Sequence[tuple[str, str]], band: tuple[str, str] | None) -> list[str]:
    """Above the picture, where no line can be under it."""
    out, x, y = [], LEFT, 20.0
    for name, colour in entries:
        if not name:
            continue
        out.append(_line(x, x + 18, y - 4, y - 4, colour, 2.4))
        out.append(_text(x + 23, y, name, "start"))
        x += 40 + 6.3 * len(name)
    if band:
        out.append(f'<rect x="{x:.1f}" y="{y - 10:.1f}" width="18" height="11" fill="{band[1]}"/>')
        out.append(_text(x + 23, y, band[0], "start"))
    return out


def bars(values: Sequence[tuple[str, float]], unit: str, marked: frozenset[str] = frozenset()) -> str:
    """Horizontal bars with names and numbers; lengths go with the logarithm. `marked` ones stand out."""
    if not values:
        return ""
    name_width, bar_width = 210.0, WIDTH - 210.0 - 96.0
    top = math.log10(1.0 + max(max(v, 0.0) for _, v in values)) or 1.0
    bottom = 26 + 22 * len(values)
    out = [_open(WIDTH, bottom + 34)]
    decades = range(math.floor(top) + 1)
    for decade in decades:
        x = name_width + 6 + math.log10(1.0 + 10.0**decade) / top * bar_width
        if x > name_width + 6 + bar_width:
            continue
        out.append(_line(x, x, 18, bottom, FAINT, 0.6))
        out.append(_text(x, bottom + 14, f"{10**decade:,}".replace(",", " "), "middle"))
    for k, (name, value) in enumerate(values):
        y = 24 + 22 * k
        width = math.log10(1.0 + max(value, 0.0)) / top * bar_width
        colour = BEFORE if name in marked else "#9fb4c7"
        out.append(_text(name_width, y + 12, name, "end"))
        out.append(
            f'<rect x="{name_width + 6:.1f}" y="{y}" width="{max(width, 0.5):.1f}" height="15"'
            f' fill="{colour}"/>'
        )
        text = f"{value:,.0f}".replace(",", " ") if abs(value) >= 10 else f"{value:.1f}"
        out.append(_text(name_width + 12 + width, y + 12, text, "start"))
    out.append(_text(name_width + 6 + bar_width / 2, bottom + 30, f"{unit}, logarithmic", "middle"))
    return "".join([*out, "</svg>"])


def track(east: Sequence[float], north: Sequence[float], heat: Sequence[float], label: str) -> str:
    """A way over ground, coloured from grey (0) to red (the largest), with scales of length and colour."""
    x0, x1 = _wide(min(east), max(east), 0.0)
    y0, y1 = _wide(min(north), max(north), 0.0)
    scale = min((WIDTH - 40) / (x1 - x0), 420 / (y1 - y0))
    height = (y1 - y0) * scale + 104
    side = (WIDTH - (x1 - x0) * scale) / 2
    ordered = sorted(max(h, 0.0) for h in heat)
    top = ordered[int(0.97 * (len(ordered) - 1))] or 1.0
    out = [_open(WIDTH, height), _text(20, 18, label, "start")]
    for k in range(60):
        out.append(f'<rect x="{20 + 3 * k}" y="28" width="3.2" height="10" fill="{_heat(k / 59)}"/>')
    out += [_text(20, 52, "0", "start"), _text(200, 52, f"{top:.3g} and more", "middle")]
    # The reddest on top: where the car drove twice, the mismatch must not be hidden.
    order = sorted(range(len(heat)), key=lambda k: heat[k])
    for k in order:
        share = min(max(heat[k] / top, 0.0), 1.0)
        x, y = side + (east[k] - x0) * scale, height - 36 - (north[k] - y0) * scale
        out.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{1.7 + 1.5 * share:.1f}" fill="{_heat(share)}"/>')
    length = ticks(0.0, max(0.3 * (x1 - x0), 1.0), 2)[-1]
    unit = f"{length / 1000:g} km" if length >= 1000 else f"{length:g} m"
    y = height - 12
    out += [
        _line(20, 20 + length * scale, y, y, INK, 2.0),
        _text(26 + length * scale, y + 4, unit, "start"),
        _text(WIDTH - 20, y + 4, "north is up", "end", "#666666"),
    ]
    return "".join([*out, "</svg>"])


def _heat(share: float) -> str:
    return f"rgb({round(200 - 8 * share)},{round(200 - 160 * share)},{round(200 - 165 * share)})"


def _open(width: float, height: float) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}"'
        ' font-family="sans-serif" font-size="12" role="img">'
    )


def _line(x0: float, x1: float, y0: float, y1: float, colour: str, width: float, dashes: str = "") -> str:
    dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
    return (
        f'<line x1="{x0:.1f}" x2="{x1:.1f}" y1="{y0:.1f}" y2="{y1:.1f}" stroke="{colour}"'
        f' stroke-width="{width}"{dashed}/>'
    )


def _text(x: float, y: float, text: str, anchor: str, colour: str = INK, halo: bool = False) -> str:
    behind = ' stroke="white" stroke-width="3" paint-order="stroke"' if halo else ""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}"{behind}>{escape(text)}</text>'
    )


def _wide(low: float, high: float, margin: float) -> tuple[float, float]:
    if high - low <= 1e-12 * max(abs(low), abs(high), 1e-6):
        return low - 1.0, high + 1.0
    more = margin * (high - low)
    return low - more, high + more
