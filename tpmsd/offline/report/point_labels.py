"""Names beside points of a picture, so that none covers another or leaves the picture.

In: points and sizes of their names, in points of type. Out: for each name the corner at which it stands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

GAP_PT = 6.0
"""Between a point and its name."""
CORNERS = ((1, 1), (1, -1), (-1, 1), (-1, -1))
"""Right above, right below, left above, left below: in this order where all are free."""


@dataclass(frozen=True, slots=True)
class Name:
    """A point and the size of what stands beside it."""

    x_pt: float
    y_pt: float
    """Upwards, from the lower left corner of the picture."""
    width_pt: float
    height_pt: float


Box = tuple[float, float, float, float]
"""Left, bottom, right, top."""


def label_box(name: Name, corner: tuple[int, int]) -> Box:
    """Return the (left, bottom, right, top) of a name at a corner of its point, in points of 1/72 inch."""
    right, up = corner
    left = name.x_pt + (GAP_PT if right > 0 else -GAP_PT - name.width_pt)
    bottom = name.y_pt + (GAP_PT if up > 0 else -GAP_PT - name.height_pt)
    return left, bottom, left + name.width_pt, bottom + name.height_pt


def choose_corners(names: Sequence[Name], width_pt: float, height_pt: float) -> list[tuple[int, int]]:
    """Return each name's corner that covers least of earlier names, of points, and of the outside."""
    taken: list[Box] = [
        (one.x_pt - GAP_PT / 2, one.y_pt - GAP_PT / 2, one.x_pt + GAP_PT / 2, one.y_pt + GAP_PT / 2)
        for one in names
    ]
    chosen = []
    for name in names:

        def cost(corner: tuple[int, int], name: Name = name) -> float:
            box = label_box(name, corner)
            inside = _overlap_area(box, (0.0, 0.0, width_pt, height_pt))
            return name.width_pt * name.height_pt - inside + sum(_overlap_area(box, other) for other in taken)

        corner = min(CORNERS, key=cost)
        taken.append(label_box(name, corner))
        chosen.append(corner)
    return chosen


def _overlap_area(one: Box, other: Box) -> float:
    """Return the area that two boxes have in common; 0 where they do not meet."""
    wide = min(one[2], other[2]) - max(one[0], other[0])
    tall = min(one[3], other[3]) - max(one[1], other[1])
    return wide * tall if wide > 0.0 and tall > 0.0 else 0.0
