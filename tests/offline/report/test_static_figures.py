"""Pictures of a page without scripts: what is written on them can be read."""

from __future__ import annotations

import itertools

import pytest

from tpmsd.offline.report.figures import Bars
from tpmsd.offline.report.static_figures import _bars


@pytest.mark.parametrize("largest", [3.0, 40.0, 5e3, 2e5, 1.2e6, 3e9])
def test_the_numbers_below_bars_do_not_overlap(largest: float) -> None:
    """Gains from a few nats to billions: each label of the axis ends before the next begins."""
    canvas = _bars(Bars("gain", "held-out gain (nats)", (("first", largest, True), ("second", 2.0, False))))
    axes = canvas.axes[0]
    canvas.draw_without_rendering()
    low, high = axes.get_xlim()
    boxes = [
        tick.label1.get_window_extent()
        for tick in axes.xaxis.get_major_ticks()
        if low <= tick.get_loc() <= high
    ]

    assert 3 <= len(boxes)
    assert all(left.x1 < right.x0 for left, right in itertools.pairwise(boxes))
