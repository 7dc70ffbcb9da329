"""Small pictures as SVG text, for pages that must stand alone.

In: numbers. Out: `<svg>` elements.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

WIDTH, HEIGHT, LEFT, BOTTOM, TOP = 560, 260, 56, 40, 16
COLOURS = ("#c0392b", "#2471a3")


def lines(
    x: Sequence[float],
    series: Sequence[tuple[str, Sequence[float]]],
    x_label: str,
    y_label: str,
    band: tuple[float, float] | None = None,
) -> str:
    """Lines with points over a common x; `band` shades what is expected of noise."""
    values = [v for _, s in series for v in s] + ([*band] if band else [])
    x0, x1 = _wide(min(x), max(x))
    y0, y1 = _wide(min(values), max(values))

    def px(v: float) -> float:
        return LEFT + (v - x0) / (x1 - x0) * (WIDTH - LEFT - 12)

    def py(v: float) -> float:
        return HEIGHT - BOTTOM - (v - y0) / (y1 - y0) * (HEIGHT - BOTTOM - TOP)

    out = [_open(WIDTH, HEIGHT)]
    if band:
        top, height = py(band[1]), py(band[0]) - py(band[1])
        out.append(
            f'<rect x="{LEFT}" y="{top:.1f}" width="{WIDTH - LEFT - 12}" height="{height:.1f}" fill="#eee"/>'
        )
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        xv, yv = x0 + share * (x1 - x0), y0 + share * (y1 - y0)
        out.append(_text(px(xv), HEIGHT - BOTTOM + 14, f"{xv:.3g}", "middle"))
        out.append(_text(LEFT - 5, py(yv) + 4, f"{yv:.3g}", "end"))
        out.append(
            f'<line x1="{LEFT}" x2="{WIDTH - 12}" y1="{py(yv):.1f}" y2="{py(yv):.1f}"'
            ' stroke="#ddd" stroke-width="0.5"/>'
        )
    for k, (name, ys) in enumerate(series):
        colour = COLOURS[k % 2]
        points = " ".join(f"{px(a):.1f},{py(b):.1f}" for a, b in zip(x, ys, strict=True))
        out.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.6"/>')
        out += [
            f'<circle cx="{px(a):.1f}" cy="{py(b):.1f}" r="2.2" fill="{colour}"/>'
            for a, b in zip(x, ys, strict=True)
        ]
        out.append(_text(WIDTH - 16, TOP + 14 * (k + 1), name, "end", colour))
    out.append(_text((LEFT + WIDTH) / 2, HEIGHT - 6, x_label, "middle"))
    out.append(_text(LEFT, 11, y_label, "start"))
    return "".join([*out, "</svg>"])


def bars(values: Sequence[tuple[str, float]], label: str) -> str:
    """Horizontal bars with their names and numbers."""
    height = 22 * len(values) + 30
    largest = max((v for _, v in values), default=1.0) or 1.0
    out = [_open(WIDTH, height), _text(0, 14, label, "start")]
    for k, (name, value) in enumerate(values):
        y = 22 + 22 * k
        width = max(value, 0.0) / largest * (WIDTH - 300)
        out.append(_text(200, y + 13, name, "end"))
        out.append(f'<rect x="206" y="{y}" width="{width:.1f}" height="16" fill="{COLOURS[1]}"/>')
        out.append(_text(212 + width, y + 13, f"{value:.1f}", "start"))
    return "".join([*out, "</svg>"])


def track(east: Sequence[float], north: Sequence[float], heat: Sequence[float], label: str) -> str:
    """A way over ground, coloured from grey (0) to red (the largest)."""
    x0, x1 = _wide(min(east), max(east))
    y0, y1 = _wide(min(north), max(north))
    scale = min((WIDTH - 20) / (x1 - x0), 380 / (y1 - y0))
    height = (y1 - y0) * scale + 40
    ordered = sorted(max(h, 0.0) for h in heat)
    top = ordered[int(0.97 * (len(ordered) - 1))] or 1.0
    out = [_open(WIDTH, height), _text(0, 14, f"{label} (red: {top:.2g} and more)", "start")]
    for e, n, h in zip(east, north, heat, strict=True):
        share = min(max(h / top, 0.0), 1.0)
        colour = f"rgb({round(190 + 50 * share)},{round(190 * (1 - share))},{round(190 * (1 - share))})"
        x, y = 10 + (e - x0) * scale, height - 10 - (n - y0) * scale
        out.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{1.6 + 1.6 * share:.1f}" fill="{colour}"/>')
    return "".join([*out, "</svg>"])


def _open(width: float, height: float) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}"'
        ' font-family="sans-serif" font-size="11">'
    )


def _text(x: float, y: float, text: str, anchor: str, colour: str = "#333") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}">{escape(text)}</text>'


def _wide(low: float, high: float) -> tuple[float, float]:
    return (low, high) if high - low > 1e-12 else (low - 1.0, high + 1.0)
