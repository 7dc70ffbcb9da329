"""The factor graph of GTSAM finds the radii of a simulated drive."""

from __future__ import annotations

import numpy as np
import pytest

from bench.campaigns.onboard.estimators.factor_graph import SECOND, averaged, smooth
from bench.campaigns.onboard.estimators.tasks import driven
from bench.worlds.paper_drive import RL


def test_a_mean_over_a_second_of_white_readings_has_the_trapezoids_variance() -> None:
    """Weights of 0.2 s, the ends half: 0.04 (4 + 1/2) = 0.18."""
    std, keep = averaged(2.0, 0.0)
    assert pytest.approx(2.0 * 0.18**0.5) == std
    assert pytest.approx(0.02 / 0.38) == keep


def test_the_graph_finds_the_radii() -> None:
    """After 90 s the graph's left-right difference is within 0.3 mm of the truth."""
    pytest.importorskip("gtsam", reason="GTSAM is in the extra `bench`")
    drive = driven("unbalanced", "correlated", 3)
    found = smooth(drive, seconds=90)
    truth = drive.offsets_m[SECOND * 90 - 1, RL:]
    for rear in (found.causal_m[-1], found.batch_m[-1]):
        assert abs(np.subtract(*rear) - np.subtract(*truth)) < 0.3e-3
