"""Evidence from Gram matrices against least squares on the rows themselves."""

from __future__ import annotations

import numpy as np
import pytest

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.least_squares import Evidence, part

BLOCKS = np.repeat(np.arange(10), 30)


@pytest.fixture
def white() -> FloatArray:
    """300 windows, 9 channels, the data and three columns; the data hold the first two."""
    rng = np.random.default_rng(1)
    out = rng.standard_normal((300, 9, 4))
    out[:, :, 0] += 0.5 * out[:, :, 1] - 0.2 * out[:, :, 2]
    return out


def test_a_fit_is_least_squares_on_the_rows(white: FloatArray) -> None:
    """Values, covariance and gain are those of ordinary least squares."""
    evidence = Evidence([part(white, BLOCKS)], white.shape[2])
    fit = evidence.fit(evidence.unit(1, 3))
    X, y = white.reshape(-1, 4)[:, [1, 3]], white.reshape(-1, 4)[:, 0]
    values, residual, _, _ = np.linalg.lstsq(X, y, rcond=None)

    assert fit.values == pytest.approx(values, rel=1e-6)
    assert fit.covariance == pytest.approx(np.linalg.inv(X.T @ X), rel=1e-6, abs=1e-12)
    assert fit.gain == pytest.approx(0.5 * (y @ y - residual[0]), rel=1e-6)


def test_a_combination_of_columns_counts_as_one(white: FloatArray) -> None:
    """A design's column is the sum of what it combines."""
    evidence = Evidence([part(white, BLOCKS)], white.shape[2])
    design = np.array([[0.0], [0.5], [-0.2], [0.0]])
    X, y = white.reshape(-1, 4) @ design[:, 0], white.reshape(-1, 4)[:, 0]

    assert evidence.fit(design).values[0] == pytest.approx(X @ y / (X @ X), rel=1e-6)


def test_held_out_blocks_are_scored_by_the_others_alone(white: FloatArray) -> None:
    """The score of a fold is minus half the squared residual under values fitted without it."""
    evidence = Evidence([part(white, BLOCKS)], white.shape[2])
    scores = evidence.heldout(evidence.unit(1))
    out = np.isin(BLOCKS, evidence.folds[0])
    X, y = white[~out][:, :, 1].ravel(), white[~out][:, :, 0].ravel()
    left = white[out][:, :, 0] - white[out][:, :, 1] * (X @ y / (X @ X))

    assert scores[evidence.folds[0]].sum() == pytest.approx(-0.5 * (left**2).sum(), rel=1e-6)


def test_projection_leaves_what_the_design_does_not_explain(white: FloatArray) -> None:
    """The gain of a further column after projection is the growth of the joint fit's gain."""
    evidence = Evidence([part(white, BLOCKS)], white.shape[2])
    gram, b = evidence.projected(evidence.unit(1))
    grown = evidence.fit(evidence.unit(1, 2)).gain - evidence.fit(evidence.unit(1)).gain

    assert 0.5 * b[1] ** 2 / gram[1, 1] == pytest.approx(grown, rel=1e-6)


def test_the_block_wise_variance_of_white_noise_is_the_assumed_one() -> None:
    """The ratio is one for white noise, and far larger where blocks share an error."""
    rng = np.random.default_rng(2)
    blocks = np.repeat(np.arange(60), 20)
    white = rng.standard_normal((1200, 9, 2))
    honest = Evidence([part(white, blocks)], 2)
    shared = white.copy()
    shared[:, :, 1] = 1.0
    shared[:, :, 0] += 0.5 * rng.standard_normal(60)[blocks][:, None]
    slow = Evidence([part(shared, blocks)], 2)

    assert honest.sandwich(honest.fit(honest.unit(1)))[0] == pytest.approx(1.0, abs=0.5)
    assert slow.sandwich(slow.fit(slow.unit(1)))[0] == pytest.approx(1 + 0.25 * 180, rel=0.4)
