"""Named columns: what is not measured, and the order of names."""

from __future__ import annotations

import numpy as np

from tpmsd.offline.diagnosis.hypotheses.response import Columns
from tpmsd.offline.inference.windows import CHANNELS


def test_what_is_not_measured_counts_as_no_response() -> None:
    """A column is zero where its response is not finite, in one channel or in all."""
    columns, more = Columns(), Columns()
    hole = np.full((4, CHANNELS), 2.0)
    hole[1, 0] = np.nan
    columns.add(("a",), hole)
    more.add_of_channel(
        [("b", "0"), ("b", "1")], 3, np.array([[1.0, 5.0], [np.nan, 6.0], [3.0, 7.0], [4.0, 8.0]])
    )
    columns.extend(more)

    assert [("a",), ("b", "0"), ("b", "1")] == columns.names
    assert {("a",): 0, ("b", "0"): 1, ("b", "1"): 2} == columns.index()
    assert 0.0 == columns.stack[0][1, 0]
    assert np.isnan(hole[1, 0])
    assert np.array_equal([1.0, 0.0, 3.0, 4.0], columns.arrays[1][:, 3])
    assert not columns.arrays[2][:, :3].any()
