"""The p-values of null drives of vehicle dynamics."""

from __future__ import annotations

import numpy as np
from scipy.stats import kstest

from bench.campaigns.offline.dynamics import p_of_the_rest
from tpmsd.offline.dynamics.result import Certificate

MOST, LIMIT = 19, 3
"""Replicates at most, and those that reach the drive's own value after which drawing stops."""


def test_p_values_are_uniform_where_drive_and_replicates_are_equal() -> None:
    """Drawing stops early (Besag and Clifford 1991); what is counted alone has 20 values, a quarter at 1."""
    rng = np.random.default_rng(5)
    drawn_evenly, counted = [], []
    for _ in range(2000):
        reach = rng.random(MOST) < rng.random()
        n = next((k for k in range(LIMIT, MOST + 1) if reach[:k].sum() == LIMIT), MOST)
        reached = int(reach[:n].sum())
        p_value = reached / n if reached == LIMIT else (reached + 1) / (n + 1)
        drawn_evenly.append(p_of_the_rest(Certificate(MOST, 0.0, p_value, reached, n), rng))
        counted.append(p_value)

    assert kstest(drawn_evenly, "uniform").pvalue > 0.01
    assert kstest(counted, "uniform").pvalue < 1e-6
