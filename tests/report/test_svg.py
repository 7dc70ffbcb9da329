"""Pictures that stand alone."""

from __future__ import annotations

import math
import re
from xml.etree import ElementTree

import pytest

from tpmsd.report.svg import AFTER, BEFORE, Mark, Series, bars, chart, number, ticks, track


@pytest.mark.parametrize(
    ("low", "high", "wanted", "expected"),
    [
        (0.0, 10.0, 5, [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]),
        (-0.31, 0.42, 5, [-0.2, 0.0, 0.2, 0.4]),
        (9.7, 33.1, 6, [10.0, 15.0, 20.0, 25.0, 30.0]),
    ],
)
def test_ticks_are_round_numbers(low: float, high: float, wanted: int, expected: list[float]) -> None:
    """Steps of 1, 2 or 5 times a power of ten, within the range."""
    assert pytest.approx(expected, abs=1e-12) == ticks(low, high, wanted)


@pytest.mark.parametrize(
    ("value", "step", "text"),
    [
        (0.1 + 0.2, 0.1, "0.3"),
        (-1.5, 0.5, "-1.5"),
        (1200.0, 200.0, "1200"),
        (1e-17, 0.1, "0"),
        (2e-5, 1e-5, "2e-05"),
    ],
)
def test_labels_have_the_decimals_of_their_step(value: float, step: float, text: str) -> None:
    """No digits that the step does not need."""
    assert text == number(value, step)


def test_a_chart_has_its_labels_and_stays_inside() -> None:
    """Axes, legend, band and marks are written; points lie inside; a gap breaks a line."""
    x = [0.0, 1.0, 2.0, 3.0, 4.0]
    picture = chart(
        [
            Series("before", x, [0.0, 5.0, math.nan, 7.0, 9.0], BEFORE),
            Series("<after>", x, x, AFTER, [1.0] * 5),
        ],
        "speed (m/s)",
        "mismatch",
        (-2.0, 2.0, "noise"),
        [Mark(2.0, "alarm", BEFORE)],
        [(4.0, "threshold")],
    )
    root = ElementTree.fromstring(picture)
    _, _, width, height = map(float, root.attrib["viewBox"].split())
    words = {element.text for element in root.iter() if element.tag.endswith("text")}
    dots = [element for element in root.iter() if element.tag.endswith("circle")]

    assert {"before", "<after>", "noise", "alarm", "threshold", "speed (m/s)", "mismatch"} <= words
    assert 9 == len(dots)
    assert all(0 < float(d.attrib["cx"]) < width and 0 < float(d.attrib["cy"]) < height for d in dots)
    assert 3 == sum(element.tag.endswith("polyline") for element in root.iter())


def test_a_chart_of_nothing_is_no_picture() -> None:
    """Without a finite point there is nothing to draw."""
    assert "" == chart([Series("", [1.0], [math.nan], AFTER)], "x", "y")


def test_bars_grow_with_the_logarithm() -> None:
    """A thousand times the evidence is about three decades of length; a found effect stands out."""
    picture = bars([("slip", 99_999.0), ("growth", 99.0)], "nats", frozenset({"slip"}))
    widths = [float(w) for w in re.findall(r'width="([\d.]+)" height="15"', picture)]

    assert widths[0] / widths[1] == pytest.approx(2.5, rel=0.01)
    assert 1 == picture.count(f'fill="{BEFORE}"')


def test_a_map_has_scales_and_the_worst_place_on_top() -> None:
    """The last point drawn is the one with the largest mismatch; the scale of length is a round number."""
    picture = track([0.0, 500.0, 1000.0], [0.0, 10.0, 0.0], [1.0, 9.0, 2.0], "nats")
    root = ElementTree.fromstring(picture)
    dots = [element for element in root.iter() if element.tag.endswith("circle")]
    words = [element.text for element in root.iter() if element.tag.endswith("text")]

    assert 0.5 == pytest.approx((float(dots[-1].attrib["cx"]) - 20) / 620, abs=0.01)
    assert "200 m" in words
