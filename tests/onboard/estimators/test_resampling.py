"""Systematic resampling: unbiased, and as even as it can be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.onboard.estimators.resampling import effective_number, systematic

WEIGHTS = st.lists(st.floats(0.0, 1.0), min_size=1, max_size=60).filter(lambda w: sum(w) > 1e-6)


@settings(derandomize=True, deadline=None, max_examples=200)
@given(WEIGHTS, st.integers(0, 2**32 - 1))
def test_copies_are_the_floor_or_the_ceiling(raw: list[float], seed: int) -> None:
    """Each particle gets floor or ceil of N times its weight; all together N, in order."""
    weights = np.array(raw) / sum(raw)
    chosen = systematic(weights, np.random.default_rng(seed))
    copies = np.bincount(chosen, minlength=weights.size)
    expected = weights.size * weights
    assert weights.size == copies.sum()
    assert np.all(copies >= np.floor(expected - 1e-9))
    assert np.all(copies <= np.ceil(expected + 1e-9))
    assert np.all(np.diff(chosen) >= 0)


def test_resampling_is_unbiased() -> None:
    """Over many seeds the mean number of copies is N times the weight."""
    weights = np.array([0.02, 0.31, 0.007, 0.463, 0.2])
    seeds = 4000
    copies = np.zeros(5)
    for seed in range(seeds):
        copies += np.bincount(systematic(weights, np.random.default_rng(seed)), minlength=5)
    # The number of copies varies by less than one, with variance of at most 1/4.
    assert 5 * weights == pytest.approx(copies / seeds, abs=4 * 0.5 / seeds**0.5)


def test_one_particle_with_all_the_weight_takes_every_place() -> None:
    """Degenerate weights choose their particle alone, be it the first or the last."""
    for only in (0, 7):
        weights = np.eye(8)[only]
        assert [only] * 8 == systematic(weights, np.random.default_rng(1)).tolist()


@settings(derandomize=True, deadline=None)
@given(WEIGHTS)
def test_the_effective_number_is_between_one_and_all(raw: list[float]) -> None:
    """1 / sum w^2: N for equal weights, 1 for one particle alone, and between for all others."""
    weights = np.array(raw) / sum(raw)
    assert 1.0 - 1e-9 <= effective_number(weights) <= weights.size + 1e-9
    assert weights.size == pytest.approx(effective_number(np.full(weights.size, 1.0 / weights.size)))
