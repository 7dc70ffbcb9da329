"""Distributions of plain numbers against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from tpmsd.onboard.monitor.evidence.probability import chi_square_cdf, chi_square_quantile, normal_cdf


def test_the_normal_distribution_is_scipys() -> None:
    """Also far out, where a difference from 1 would have no digits left."""
    for z in np.linspace(-30.0, 9.0, 79):
        assert stats.norm.cdf(z) == pytest.approx(normal_cdf(float(z)), rel=1e-10, abs=1e-300)


@pytest.mark.parametrize("freedom", [1, 2, 3, 4, 9])
def test_the_chi_square_distribution_is_scipys(freedom: int) -> None:
    """Probabilities and quantiles, from the median to one in a million."""
    for x in (0.0, 1e-3, 0.5, 3.0, 20.0, 60.0):
        assert stats.chi2.cdf(x, freedom) == pytest.approx(chi_square_cdf(x, freedom), rel=1e-13)
    for probability in (0.5, 0.7, 0.95, 0.999, 1.0 - 1e-6):
        expected = stats.chi2.ppf(probability, freedom)
        assert expected == pytest.approx(chi_square_quantile(probability, freedom), rel=1e-9)
