"""The receiver's view of the drive: means over cells."""

from __future__ import annotations

import numpy as np
import pytest

from tpmsd.offline.discovery.other_roles import smooth
from tpmsd.offline.discovery.reference import bin_means


@pytest.mark.parametrize("phase_s", [0.0, 0.1, 0.25, 0.4])
def test_means_over_cells_of_a_slow_receiver_are_not_shifted(phase_s: float) -> None:
    """A ramp that is sampled once a second has, over half a second, the mean at the middle of the cell."""
    time_s = np.arange(0.0, 60.0) + phase_s
    edges = np.arange(1.0, 58.0, 0.5)

    means = bin_means(time_s, 3.0 + 2.0 * time_s, edges)

    assert means == pytest.approx(3.0 + 2.0 * 0.5 * (edges[1:] + edges[:-1]), abs=1e-9)


@pytest.mark.parametrize("count", range(8))
@pytest.mark.parametrize("cells", [1, 3, 4, 5])
def test_a_running_mean_has_as_many_values_as_there_are_cells(count: int, cells: int) -> None:
    """Also of a receiver that was heard for no cell at all, or for fewer than the mean is taken over."""
    value = np.arange(1.0, count + 1.0)
    around = [range(k - cells // 2, k - cells // 2 + cells) for k in range(count)]
    expected = [sum(value[j] for j in there if 0 <= j < count) / cells for there in around]

    assert smooth(value, cells) == pytest.approx(expected, abs=1e-12)
