"""Where names stand beside points."""

from __future__ import annotations

import itertools

from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.offline.report.point_labels import CORNERS, Name, choose_corners, label_box

WIDE, TALL = 300.0, 120.0


def apart(names: list[Name]) -> bool:
    """Whether no two names share a spot, and all are inside."""
    boxes = [
        label_box(name, corner) for name, corner in zip(names, choose_corners(names, WIDE, TALL), strict=True)
    ]
    inside = all(b[0] >= 0.0 and b[1] >= 0.0 and b[2] <= WIDE and b[3] <= TALL for b in boxes)
    return inside and not any(
        a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
        for a, b in itertools.combinations(boxes, 2)
    )


def test_a_name_at_the_right_edge_stands_to_the_left() -> None:
    """And one in the upper corner below its point; one that has room to the right above."""
    names = [Name(290.0, 60.0, 20.0, 10.0), Name(290.0, 115.0, 20.0, 10.0), Name(20.0, 60.0, 20.0, 10.0)]

    assert [(-1, 1), (-1, -1), (1, 1)] == choose_corners(names, WIDE, TALL)


def test_a_name_gives_way_to_the_one_before_it() -> None:
    """An alarm just above the start of a drive: both are to be read."""
    names = [Name(60.0, 50.0, 22.0, 11.0), Name(55.0, 75.0, 60.0, 24.0)]

    assert apart(names)
    assert choose_corners(names, WIDE, TALL)[0] == CORNERS[0]


@settings(derandomize=True, deadline=None, max_examples=200)
@given(st.floats(0.0, WIDE), st.floats(0.0, TALL), st.floats(1.0, 100.0), st.floats(1.0, 40.0))
def test_a_single_name_stays_inside(x_pt: float, y_pt: float, width_pt: float, height_pt: float) -> None:
    """Wherever its point is: each side has room for a third of the picture."""
    assert apart([Name(x_pt, y_pt, width_pt, height_pt)])
