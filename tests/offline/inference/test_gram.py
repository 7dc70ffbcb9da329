"""Gram matrices that are made when they are asked for, against products of the rows."""

from __future__ import annotations

import numpy as np

from tpmsd.offline.inference.gram import Grams
from tpmsd.offline.inference.least_squares import DriveGrams, Evidence, part

BLOCKS = np.repeat(np.arange(7), 20)


def drawn(columns: int, seed: int = 1) -> np.ndarray:
    """140 windows of 9 channels."""
    return np.random.default_rng(seed).standard_normal((len(BLOCKS), 9, columns))


def test_blocks_and_folds_add_up_to_the_total() -> None:
    """Columns by block, asked for in any order and again, and folds are sums of products of the rows."""
    white = drawn(6)
    grams = Grams(white, BLOCKS)
    expected = np.einsum("bri,brj->bij", white.reshape(7, -1, 6), white.reshape(7, -1, 6))

    for columns in (np.array([4, 1]), np.array([1, 0, 4, 5]), np.array([2])):
        assert np.allclose(expected[:, columns[:, None], columns[None, :]], grams.by_block(columns))
    assert np.allclose(expected.sum(axis=0), grams.total)
    assert np.allclose(expected[1::3].sum(axis=0), grams.by_fold(3)[1])
    assert np.allclose(grams.total, grams.by_fold(3).sum(axis=0))


def test_further_columns_leave_the_others_what_they_were() -> None:
    """Gram matrices of columns that were added are those of all columns at once."""
    white = drawn(8)
    first = Grams(white[:, :, :5], BLOCKS)
    first.by_block(np.array([3, 0]))
    both, whole = first.extended(white[:, :, 5:]), Grams(white, BLOCKS)
    columns = np.array([0, 7, 3])

    assert np.allclose(whole.total, both.total)
    assert np.allclose(whole.by_block(columns), both.by_block(columns))
    assert 5 == first.width


def test_what_is_taken_from_the_data_is_gone_from_all_that_is_asked() -> None:
    """Evidence less a combination of columns is that of data from which it was taken before, also twice."""
    white = drawn(4)
    weights, more = np.array([0.0, 0.5, -1.0, 0.0]), np.array([0.0, 0.0, 0.25, 2.0])
    taken = white.copy()
    taken[:, :, 0] -= white @ (weights + more)
    expected = Evidence([part(taken, BLOCKS)], 4)
    evidence = Evidence([part(white, BLOCKS)], 4).less(weights).less(more)
    design = expected.unit(1, 3)

    assert np.allclose(expected.total, evidence.total)
    assert np.allclose(expected.heldout(design), evidence.heldout(design))
    assert isinstance(evidence.parts[0], DriveGrams)


def test_folds_beyond_the_last_block_are_zero() -> None:
    """Three blocks in five folds: each has one of them or none."""
    white = drawn(4)[:60]
    folds = Grams(white, BLOCKS[:60]).by_fold(5)

    for fold in range(5):
        rows = white[BLOCKS[:60] == fold].reshape(-1, 4)
        assert np.allclose(rows.T @ rows, folds[fold])
