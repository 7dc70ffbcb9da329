"""Colours and dashes of everything that is drawn.

In: nothing. Out: styles by role, alike in pictures, reports and pages. The hues are Okabe and Ito's (2008),
which colour-blind readers tell apart; on white they are darkened to a contrast of 3 : 1 and more (WCAG 2.2,
1.4.11). In grey the dashes tell the wheels apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Style:
    """Colour and dashes of one role in a drawing."""

    colour: str
    """Colour on a white ground; pages put the CSS variable of the role's name in its place."""
    dashes: tuple[float, ...] = ()
    """Dash and gap in line widths; empty: a solid line."""


STYLES: dict[str, Style] = {
    "fl": Style("#0072b2"),
    "fr": Style("#b36b00", (6.0, 2.0)),
    "rl": Style("#00795a", (1.5, 1.5)),
    "rr": Style("#a8467f", (6.0, 2.0, 1.5, 2.0)),
    "before": Style("#c2410c", (4.0, 2.0)),
    "after": Style("#0b5fa5"),
    "plain": Style("#1b1f24"),
    "soft": Style("#57606a", (3.0, 2.0)),
    "line": Style("#c9d0d8"),
    "bad": Style("#c3201b"),
    "gap": Style("#e3c300"),
    "card": Style("#ffffff"),
}
"""Style by role: the wheels, a quantity before and after, text and curves without a wheel, secondary items,
grid, alarms, spans without fixes, the ground."""


def line_style(role: str) -> dict[str, Any]:
    """Return the colour and dashes of a curve, as matplotlib takes them."""
    style = STYLES[role]
    return {"color": style.colour, "linestyle": (0, style.dashes) if style.dashes else "-"}
