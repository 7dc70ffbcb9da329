"""The other levels of drift: with the program's own they are the program's filter."""

from __future__ import annotations

import numpy as np
import pytest

from bench.campaigns.estimators.methods import DEFAULT, Setting, build, config_of
from bench.campaigns.estimators.tasks import driven
from bench.campaigns.levels_of_drift import VARIANTS, ByWheel


@pytest.mark.parametrize("front", [False, True])
def test_with_the_programs_levels_it_is_the_programs_filter(front: bool) -> None:
    """Radii and covariances of the first five minutes are the same to rounding."""
    ticks = driven("lively", "correlated", 300).ticks[:3000]
    ours = build(DEFAULT, Setting(), None, 1, front)
    other = ByWheel(config_of(DEFAULT, Setting(), None, front), front, VARIANTS[0])
    for tick in ticks:
        a, b = ours.step(tick), other.step(tick)
    assert np.allclose(a.deviation_m, b.deviation_m, rtol=0.0, atol=1e-9, equal_nan=True)
    assert np.allclose(a.covariance_m2, b.covariance_m2, rtol=1e-6, atol=0.0, equal_nan=True)
    stated, _, best = other.variances()
    rear = b.covariance_m2[2:, 2:]
    assert stated == pytest.approx(rear[0, 0] + rear[1, 1] - 2 * rear[0, 1], rel=1e-6)
    assert 0.0 < best


def test_a_wheel_that_drifts_alone_grows_alone() -> None:
    """Growth of the difference by a wheel at level 4 beside one at 0.15, own drift of 0.01 mm per sqrt(s):
    (4^2 + 0.15^2) 0.01^2 mm2/s."""
    other = ByWheel(config_of(DEFAULT, Setting(), None), False, VARIANTS[3])
    grown = other._grown()[2]
    apart = grown[0, 0] + grown[1, 1] - 2 * grown[0, 1]
    assert apart == pytest.approx((4.0**2 + 0.15**2) * (0.01e-3) ** 2, rel=1e-9)
