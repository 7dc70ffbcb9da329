"""Pictures of a page without scripts: what is written on them can be read."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import numpy as np
import pytest

from tpmsd.offline.report import static_figures
from tpmsd.offline.report.explanation_text import _contrast_text
from tpmsd.offline.report.figures import Bars, Chart, Curve
from tpmsd.offline.report.static_figures import _draw_bars, _draw_chart


@pytest.mark.parametrize("largest", [3.0, 40.0, 5e3, 2e5, 1.2e6, 3e9])
def test_the_numbers_below_bars_do_not_overlap(largest: float) -> None:
    """Gains from a few nats to billions: each label of the axis ends before the next begins."""
    canvas = _draw_bars(
        Bars("gain", "held-out gain (nats)", (("first", largest, True), ("second", 2.0, False)))
    )
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


@pytest.mark.parametrize("span_s", [0.0, 3_600.0, 86_400.0, 30 * 86_400.0])
def test_an_axis_of_dates_has_few_marks(span_s: float) -> None:
    """Drives of one instant, one hour, a day or a month: one to eight marks of whole days."""
    start_s = np.linspace(1.7198e9, 1.7198e9 + span_s, 3)
    curve = Curve("front left", np.zeros(3), "fl", dots=True)
    axes = _draw_chart(Chart("Radii", "start", "mm", start_s, (curve,), date=True)).axes[0]
    low, high = axes.get_xlim()

    assert 1 <= sum(low <= mark <= high for mark in axes.get_xticks()) <= 8


def test_an_explanation_writes_one_sign_for_plus_or_minus() -> None:
    """The text of a terminal has `+-` in every line."""
    assert "-1.55 +- 0.18 (+16.5 nats)" == _contrast_text(
        {"change_mm": -1.55, "std_mm": 0.18, "gain_nats": 16.5}
    )


def test_no_colon_hangs_behind_a_name_of_a_legend() -> None:
    """uPlot's style sets one behind every name; that of the reports takes it away with the same precision."""
    assets = Path(static_figures.__file__).parent / "assets"
    rule = re.search(r"(\S+\.u-live th::after) \{ content: \"\"; \}", (assets / "report.css").read_text())

    assert rule is not None
    assert '.u-inline.u-live th::after {content: ":"' in (assets / "uPlot.min.css").read_text()
    assert rule[1] == ".u-legend.u-inline.u-live th::after"
