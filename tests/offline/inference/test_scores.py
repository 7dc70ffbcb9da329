"""The derivatives of a whitened likelihood: compiled code and NumPy arrays give the same."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference import gains
from tpmsd.offline.inference.gains import array_gains, array_whitened, steps
from tpmsd.offline.inference.scores import (
    MAX_STATES,
    Derivatives,
    System,
    array_scores,
    compiled_scores,
    scores,
)


@pytest.fixture
def built() -> None:
    """Nothing can be compared where nothing was compiled."""
    if gains.compiled is None:
        pytest.skip("the compiled kernel is not built here (no compiler, or no headers of Python)")


def system(count: int, carry: int, others: int, kept: float, seed: int) -> System:
    """States that fade by `kept`, of which all channels see some."""
    rng = np.random.default_rng(seed)
    moved, fresh, joint = parts(count, carry, others, kept, rng)
    by = array_gains(moved, fresh, rng.uniform(0.5, 2.0, carry), True)
    return System(moved, joint, rng.permutation(carry + others)[:carry], by)


def parts(
    count: int, carry: int, others: int, kept: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """M, the covariance of what is new, and J (mostly zeros) that has nothing to do with them."""
    moved = rng.standard_normal((count, carry + 9, carry)) * (rng.random((count, carry + 9, carry)) < 0.3)
    moved[:, :carry] = kept * np.eye(carry)
    root = rng.standard_normal((count, carry + 9, carry + 9)) * 0.1
    fresh = root @ root.transpose(0, 2, 1) + 0.1 * np.eye(carry + 9)
    joint = rng.standard_normal((count, carry + 9, carry + others))
    joint *= rng.random(joint.shape) < 0.3
    return moved, fresh, joint


@pytest.mark.usefixtures("built")
@pytest.mark.parametrize(
    ("count", "carry", "others", "width"), [(0, 3, 1, 2), (1, 1, 0, 1), (60, 17, 6, 7), (5, 48, 16, 70)]
)
def test_both_give_the_same(count: int, carry: int, others: int, width: int) -> None:
    """Derivatives by all variances and fadings are the same within rounding."""
    made = system(count, carry, others, 0.7, carry)
    white = np.random.default_rng(width).standard_normal((count, 9, width))
    ours, theirs = array_scores(made, white), compiled_scores(made, white)
    for name in ("variance", "decay", "fresh", "start"):
        expected, actual = getattr(ours, name), getattr(theirs, name)
        assert expected.shape == actual.shape
        assert np.abs(expected - actual).max(initial=0.0) < 1e-11 * np.abs(expected).max(initial=1.0)


@pytest.mark.usefixtures("built")
def test_rounding_does_not_grow_where_states_do_not_fade() -> None:
    """Of a thousand windows in which states grow by a tenth but for what is measured, both give the same."""
    made = system(1000, 6, 2, 1.1, 4)
    white = np.random.default_rng(5).standard_normal((1000, 9, 3))
    ours, theirs = array_scores(made, white), compiled_scores(made, white)
    assert np.abs(ours.fresh - theirs.fresh).max() < 1e-9 * np.abs(ours.fresh).max()


@pytest.mark.parametrize("run", [array_scores, scores])
def test_the_derivative_by_a_variance_is_the_difference(
    run: Callable[[System, FloatArray], Derivatives],
) -> None:
    """A variance that comes in by a column of J changes the likelihood by the derivative times its size."""
    rng = np.random.default_rng(11)
    moved, fresh, joint = parts(12, 4, 1, 0.9, rng)
    start, data, here = (
        rng.uniform(0.5, 2.0, 4),
        rng.standard_normal((12, 9, 2)),
        np.ones((12, 9), dtype=bool),
    )

    def likelihood(more: float) -> float:
        column = joint[7, :, 2]
        changed = fresh.copy()
        changed[7] += more * np.outer(column, column)
        by = array_gains(moved, changed, start, True)
        white = array_whitened(data, here, steps(moved, by))
        return float(np.log(by.inverse[:, range(9), range(9)]).sum() - 0.5 * np.sum(white**2))

    by = array_gains(moved, fresh, start, True)
    white = array_whitened(data, here, steps(moved, by))
    found = run(System(moved, joint, np.arange(4), by), white)
    assert (likelihood(1e-5) - likelihood(-1e-5)) / 2e-5 == pytest.approx(found.fresh[7, 2], rel=1e-6)


@pytest.mark.usefixtures("built")
def test_arrays_that_do_not_belong_together_are_refused() -> None:
    """Nothing is read or written beyond an array's end; a number of a state that is not there is none."""
    made = system(4, 3, 2, 0.7, 1)
    with pytest.raises(ValueError, match="do not belong together"):
        compiled_scores(made, np.zeros((5, 9, 2)))
    odd = System(made.moved, made.joint, np.array([0, 1, 5]), made.by)
    with pytest.raises(ValueError, match="do not belong together"):
        compiled_scores(odd, np.zeros((4, 9, 2)))


@pytest.mark.usefixtures("built")
def test_more_states_than_the_compiled_code_has_room_for() -> None:
    """They are left to NumPy."""
    made = system(2, 4, MAX_STATES - 3, 0.7, 2)
    white = np.ones((2, 9, 1))
    with pytest.raises(ValueError, match="do not belong together"):
        compiled_scores(made, white)
    assert np.array_equal(array_scores(made, white).fresh, scores(made, white).fresh)
