"""Part of each contrast in a comparison of hypotheses."""

from __future__ import annotations

import numpy as np
import pytest

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.evidence.contrasts import contrast_gains, contrast_rows


def log_density(off: FloatArray, covariance: FloatArray) -> float:
    return float(-0.5 * off @ np.linalg.solve(covariance, off))


@pytest.mark.parametrize("wheels", [[0, 1, 2, 3], [2, 3]])
def test_what_the_contrasts_add_is_the_whole_log_likelihood_ratio(wheels: list[int]) -> None:
    """The parts of all contrasts add up to the log-likelihood ratio of the change as a whole."""
    rng = np.random.default_rng(2)
    d = len(wheels)
    root = rng.normal(size=(d, d))
    covariance = root @ root.T * 1e-7
    change, expected = rng.normal(0.0, 1e-3, d), rng.normal(0.0, 1e-3, d)
    parts = contrast_gains(contrast_rows(wheels), change, covariance, expected)
    whole = log_density(change - expected, covariance) - log_density(change, covariance)
    assert -whole == pytest.approx(-sum(parts.values()))


def test_a_loss_of_all_four_rests_on_the_receiver_alone() -> None:
    """Wheels that shrink alike are no news to those that are held against each other."""
    covariance = np.ones((4, 4)) * 1e-8 + np.eye(4) * 1e-9
    loss = np.full(4, -1e-3)
    parts = contrast_gains(contrast_rows([0, 1, 2, 3]), loss, covariance, loss)
    wheels = [parts[name] for name in ("front_minus_rear", "fl_minus_fr", "rl_minus_rr")]
    assert [0.0, 0.0, 0.0] == pytest.approx(wheels, abs=1e-9)
    assert 0.5 * 1e-6 / (1e-8 + 0.25e-9) == pytest.approx(parts["receiver_all_wheels"])
