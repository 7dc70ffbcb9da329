"""Which losses would be seen: held against what the comparison of hypotheses then says."""

from __future__ import annotations

import numpy as np
import pytest

from tpmsd.config.model import TyreConfig
from tpmsd.monitor.hypotheses import Comparison
from tpmsd.monitor.sight import sight
from tpmsd.physics.tyre import tyre_model

RADIUS = np.full(4, 0.316)
THRESHOLD, ASKED = 0.0025, 0.99
TYRES = [tyre_model(TyreConfig(), 0.316)] * 4


@pytest.mark.parametrize("common", [1e-4, 5e-4, 1.2e-3])
@pytest.mark.parametrize("own", [1e-4, 4e-4])
def test_the_smallest_losses_are_those_that_are_raised_nine_times_in_ten(common: float, own: float) -> None:
    """Of 400 changes by a tenth more than such a loss (losses are compared on a grid), of one tyre and of all
    alike, as the covariance scatters them; of a quarter less three in four at most."""
    covariance = (np.full((4, 4), common**2) + np.eye(4) * own**2) * 0.316**2
    scatter = np.random.default_rng(1).multivariate_normal(np.zeros(4), covariance, 400)
    found = sight(covariance, covariance, RADIUS, TYRES, THRESHOLD, ASKED)
    for share, lost in ((found.one_tyre, np.array([1.0, 0.0, 0.0, 0.0])), (found.all_tyres, np.ones(4))):
        least_m = -TYRES[0].radius_change_m(share)
        raised = []
        for times in (1.1, 0.75):
            verdicts = Comparison(RADIUS, THRESHOLD).of_each(
                scatter - times * least_m * lost, np.broadcast_to(covariance, (400, 4, 4))
            )
            raised.append(np.mean([bool(verdict.deflated[0] >= ASKED) for verdict in verdicts]))
        assert (raised[0] >= 0.85, raised[1] <= 0.75) == (True, True), raised


def test_where_all_are_not_judged_no_loss_of_theirs_is_seen() -> None:
    """Not even that of all their air."""
    found = sight(np.eye(4) * 1e-8, None, RADIUS, TYRES, THRESHOLD, ASKED)
    assert (1.0, True) == (found.all_tyres, found.one_tyre < 0.15)
