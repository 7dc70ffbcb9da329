"""The ISO/TS 18571 rating against another implementation and by its corner cases."""

from __future__ import annotations

import numpy as np
import pytest

from tpmsd.offline.dynamics.rating import rating


@pytest.mark.parametrize("seed", range(6))
def test_the_rating_and_its_parts_are_another_package_s(seed: int) -> None:
    """Corridor, phase, magnitude, slope and the whole as objective_rating_metrics computes them."""
    theirs = pytest.importorskip("objective_rating_metrics.rating")
    rng = np.random.default_rng(seed)
    n = int(rng.integers(60, 220))
    time = np.arange(n) * 0.05
    a = np.convolve(np.cumsum(rng.standard_normal(n)), np.ones(5) / 5.0, "same")
    b = np.roll(a, int(rng.integers(-6, 7))) * rng.uniform(0.7, 1.3) + 0.3 * rng.standard_normal(n)
    other = theirs.ISO18571(np.c_[time, a], np.c_[time, b])
    mine = rating(a, b)

    assert mine.corridor == pytest.approx(other.corridor_rating(-1), abs=1e-9)
    assert mine.phase == pytest.approx(other.phase_rating(-1), abs=1e-9)
    assert mine.magnitude == pytest.approx(other.magnitude_rating(-1), abs=1e-9)
    assert mine.slope == pytest.approx(other.slope_rating(-1), abs=1e-9)
    assert mine.overall == pytest.approx(other.overall_rating(-1), abs=1e-9)


def test_equal_curves_rate_one_and_opposite_ones_near_nothing() -> None:
    """1 for the curve itself; a curve of the other sign earns no corridor beyond its zeros."""
    t = np.linspace(0.0, 10.0, 200)
    curve = np.sin(t)

    assert rating(curve, curve).overall == pytest.approx(1.0)
    assert rating(curve, -3.0 * curve).corridor < 0.1


def test_a_late_curve_loses_phase_in_proportion() -> None:
    """A shift of a tenth of the length is half of the allowed fifth."""
    t = np.linspace(0.0, 10.0, 201)
    early, late = np.exp(-((t - 4.0) ** 2)), np.exp(-((t - 5.0) ** 2))

    assert rating(early, late).phase == pytest.approx(1.0 - 20 / (0.2 * 201), abs=0.01)
