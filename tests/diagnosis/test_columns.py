"""Columns kept by channel are the same columns."""

from __future__ import annotations

import numpy as np

from tpmsd.diagnosis.hypotheses.response import Columns
from tpmsd.inference.windows import CHANNELS, SPEED


def test_columns_of_one_channel_stand_in_order_among_others() -> None:
    """A stack holds each column at its place: those of one channel are zero in all others."""
    rng = np.random.default_rng(3)
    windows = 71  # more than are stacked at once, and no multiple
    before = rng.standard_normal((windows, CHANNELS))
    dense = [rng.standard_normal((windows, CHANNELS)) for _ in range(3)]
    of_channel = rng.standard_normal((windows, 2))
    columns, more = Columns(), Columns()
    columns.add(("a",), dense[0])
    columns.add(("b",), dense[1])
    more.add_of_channel([("c", "0"), ("c", "1")], SPEED, of_channel)
    columns.extend(more)
    columns.add(("d",), dense[2])

    expected = np.zeros((windows, CHANNELS, 6))
    expected[:, :, 0], expected[:, :, 1], expected[:, :, 2] = before, dense[0], dense[1]
    expected[:, SPEED, 3:5] = of_channel
    expected[:, :, 5] = dense[2]

    assert columns.names == [("a",), ("b",), ("c", "0"), ("c", "1"), ("d",)]
    np.testing.assert_array_equal(expected, columns.stack(before))
    np.testing.assert_array_equal(expected[:, :, 1:], columns.stack())
    assert len(more.names) == 2


def test_what_is_not_measured_counts_as_no_response() -> None:
    """A column is zero where its response is not finite, in one channel or in all; the data stay NaN."""
    columns = Columns()
    hole = np.full((4, CHANNELS), 2.0)
    hole[1, 0] = np.nan
    columns.add(("a",), hole)
    columns.add_of_channel([("b",)], 3, np.array([[1.0], [np.nan], [3.0], [4.0]]))

    stacked = columns.stack(hole)

    assert np.isnan(stacked[1, 0, 0])
    assert stacked[1, 0, 1] == 0.0
    np.testing.assert_array_equal([1.0, 0.0, 3.0, 4.0], stacked[:, 3, 2])
