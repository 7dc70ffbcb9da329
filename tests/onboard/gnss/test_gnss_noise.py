from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tpmsd.onboard.sources.gnss.noise import position_std


@pytest.mark.parametrize(
    ("quality", "hdop", "expected"),
    [
        (1, 1.0, 1.5),
        (1, 2.0, 3.0),
        (2, 1.0, 0.8),
        (4, 0.5, 0.012),
        (5, 1.0, 0.3),
        (6, 1.0, 10.0),
        (1, math.nan, 1.5),
        (4, 0.1, 0.012),
        (1, 99.99, 100.0),
        (7, 1.0, 10.0),
    ],
)
def test_quality_times_hdop(quality: int, hdop: float, expected: float):
    """Without GST the quality's base is scaled by HDOP, at least 0.6, and bounded."""
    assert pytest.approx(expected) == position_std(quality, hdop)


@pytest.mark.parametrize(
    ("gst", "expected"),
    [(0.7, 0.7), (0.001, 0.01), (1e6, 100.0), (0.0, 1.5), (math.inf, 1.5), (math.nan, 1.5)],
)
def test_gst_goes_first(gst: float, expected: float):
    """GST's own estimate is taken within bounds; zero or none falls back on the quality."""
    assert pytest.approx(expected) == position_std(1, 1.0, gst)


@given(st.integers(-5, 99), st.floats(), st.floats())
def test_always_sane(quality: int, hdop: float, gst: float):
    """Whatever the receiver says, the result is between a centimetre and a hundred metres."""
    assert 0.01 <= position_std(quality, hdop, gst) <= 100.0
