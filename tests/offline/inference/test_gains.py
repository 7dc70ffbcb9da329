"""The recursions of the whitening filter: compiled code and NumPy arrays give the same."""

from __future__ import annotations

import numpy as np
import pytest

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference import gains
from tpmsd.offline.inference.gains import (
    Gains,
    array_chained,
    array_gains,
    array_whitened,
    compiled_chained,
    compiled_gains,
    compiled_whitened,
    steps,
)

SAME = 1e-11
"""Relative to the greatest number of its kind: both round alike but for the order of sums."""


@pytest.fixture(autouse=True)
def built() -> None:
    """Nothing can be compared where nothing was compiled."""
    if gains.compiled is None:
        pytest.skip("the compiled kernel is not built here (no compiler, or no headers of Python)")


def system(count: int, carry: int, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Matrices M (mostly zeros), covariances and starting variances of a stable filter."""
    rng = np.random.default_rng(seed)
    moved = rng.standard_normal((count, carry + 9, carry)) * (rng.random((count, carry + 9, carry)) < 0.1)
    moved[:, :carry] *= 0.3 / np.sqrt(carry)
    moved[:, np.arange(carry), np.arange(carry)] = rng.uniform(0.2, 0.8, (count, carry))
    root = rng.standard_normal((count, carry + 9, carry + 9)) * 0.3
    fresh = root @ root.transpose(0, 2, 1) + 0.01 * np.eye(carry + 9)
    return moved, fresh, rng.uniform(0.1, 10.0, carry)


def assert_alike(one: Gains, other: Gains) -> None:
    """Equal but for rounding."""
    for ours, theirs in zip(one, other, strict=True):
        assert ours.shape == theirs.shape
        assert np.abs(ours - theirs).max() < SAME * np.abs(ours).max()


@pytest.mark.parametrize("carry", [1, 4, 17, 48])
def test_both_give_the_same(carry: int) -> None:
    """Gains and covariances of a hundred windows are the same, kept or not."""
    given = system(100, carry, carry)
    assert_alike(array_gains(*given, True), compiled_gains(*given, True))
    assert_alike(array_gains(*given, False), compiled_gains(*given, False))


def test_gains_of_one_window() -> None:
    """One state, measured by one of nine channels: the Kalman gain is P h / (h P h + r)."""
    moved = np.zeros((1, 10, 1))
    moved[0, 0, 0], moved[0, 3, 0] = 0.5, 2.0
    fresh = np.diag([0.0, *([1.0] * 9)])[None]
    found = compiled_gains(moved, fresh, np.array([4.0]), False)
    gain = found.gain[0].T @ found.inverse[0]
    # Covariance of state and channel 0.5 * 4 * 2, variance of the channel 2 * 4 * 2 + 1.
    assert np.allclose([0.0, 0.0, 4.0 / 17.0, *([0.0] * 6)], gain[0], atol=1e-15)


def test_what_is_not_positive_definite_is_refused() -> None:
    """As by NumPy, a covariance that is none is a ValueError; so are NaNs."""
    moved, fresh, start = system(3, 4, 1)
    fresh[2] *= -100.0
    for run in (array_gains, compiled_gains):
        with pytest.raises(ValueError, match="not positive definite"):
            run(moved, fresh, start, True)
    fresh[2] = np.nan
    with pytest.raises(ValueError, match="not positive definite"):
        compiled_gains(moved, fresh, start, True)


@pytest.mark.parametrize("width", [0, 1, 6, 64, 150])
def test_both_whiten_equally(width: int) -> None:
    """Columns of any number are whitened to the same; what was not measured (NaN) counts as zero."""
    moved, fresh, start = system(100, 17, 5)
    by = array_gains(moved, fresh, start, False)
    rng = np.random.default_rng(width)
    here = rng.random((100, 9)) < 0.8
    columns = np.where(here[:, :, None], rng.standard_normal((100, 9, width)), np.nan)
    ours, theirs = (
        array_whitened(columns, here, steps(moved, by)),
        compiled_whitened(columns, here, moved, by),
    )
    assert (100, 9, width) == ours.shape == theirs.shape
    assert np.allclose(ours, theirs, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("count", [0, 1, 80])
def test_both_recursions_are_equal(count: int) -> None:
    """States of a linear recursion, from zero on, are the same, and so is the last one."""
    rng = np.random.default_rng(count)
    step, added = 0.2 * rng.standard_normal((count, 7, 7)), rng.standard_normal((count, 7, 5))
    for ours, theirs in zip(array_chained(step, added), compiled_chained(step, added), strict=True):
        assert ours.shape == theirs.shape
        assert np.allclose(ours, theirs, rtol=0.0, atol=1e-12)
    if count > 1:
        assert np.array_equal(np.zeros((7, 5)), compiled_chained(step, added)[0][0])
        assert np.allclose(added[0], compiled_chained(step, added)[0][1])


def test_arrays_that_do_not_belong_together_are_refused() -> None:
    """Nothing is read or written beyond an array's end."""
    moved, fresh, start = system(4, 3, 1)
    by = array_gains(moved, fresh, start, False)
    with pytest.raises(ValueError, match="do not belong together"):
        compiled_whitened(np.zeros((5, 9, 2)), np.ones((5, 9), dtype=bool), moved, by)
    with pytest.raises(ValueError, match="do not belong together"):
        compiled_chained(np.zeros((3, 4, 4)), np.zeros((3, 5, 2)))


def test_more_states_than_the_compiled_code_has_room_for() -> None:
    """They are left to NumPy."""
    given = system(2, gains.MAX_COMPILED + 1, 2)
    with pytest.raises(ValueError, match="do not belong together"):
        compiled_gains(*given, True)
    assert_alike(array_gains(*given, True), gains.gains(*given, True))


def test_arrays_that_share_memory_are_refused() -> None:
    """A sum that would be written over what it adds is refused before it is begun."""
    assert gains.compiled is not None
    step, added = np.full((3, 4, 4), 0.1), np.ones((3, 4, 2))
    with pytest.raises(ValueError, match="shares memory"):
        gains.compiled.chain(added, np.empty((4, 2)), step, added)
    assert (added == 1.0).all()
