"""The other process-noise levels: what is stated of all hypotheses is what the filter states."""

from __future__ import annotations

import pytest

from bench.campaigns.onboard.drift_levels import variances
from bench.campaigns.onboard.estimators.methods import DEFAULT, build
from bench.campaigns.onboard.estimators.tasks import driven
from tpmsd.onboard.estimators.bank.mixture import MixtureBelief
from tpmsd.onboard.estimators.radius_filter import RadiusFilter


def test_the_stated_variance_is_the_filters() -> None:
    """Of left against right, of all hypotheses together."""
    estimator = build(DEFAULT, None, 1)
    assert isinstance(estimator, RadiusFilter)
    assert isinstance(estimator.belief, MixtureBelief)
    for tick in driven("lively", "correlated", 300).ticks[:1500]:
        said = estimator.step(tick)
    stated, trimmed, best = variances(estimator.belief.bank)
    rear = said.covariance_m2[2:, 2:]
    assert stated == pytest.approx(rear[0, 0] + rear[1, 1] - 2 * rear[0, 1], rel=1e-6)
    assert 0.0 < trimmed < 1.5 * stated
    assert 0.0 < best
