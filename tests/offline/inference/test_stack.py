"""Columns that are kept small are the same columns."""

from __future__ import annotations

import numpy as np
import pytest

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.stack import WINDOWS_AT_ONCE, ColumnStack
from tpmsd.offline.inference.windows import CHANNELS, SPEED

WINDOWS = 2 * WINDOWS_AT_ONCE + 7


def columns(seed: int = 3) -> tuple[ColumnStack, FloatArray]:
    """A stack of dense columns, of one channel's, and of a dense one behind; the same written out."""
    rng = np.random.default_rng(seed)
    dense, of_speed = rng.standard_normal((3, WINDOWS, CHANNELS)), rng.standard_normal((WINDOWS, 2))
    more = ColumnStack()
    more.add_of_channel(SPEED, of_speed)
    expected = np.zeros((WINDOWS, CHANNELS, 5))
    expected[:, :, [0, 1, 4]] = np.moveaxis(dense, 0, 2)
    expected[:, SPEED, 2:4] = of_speed
    return ColumnStack(dense[0], dense[1]) + more + ColumnStack(dense[2]), expected


def test_columns_of_one_channel_stand_in_order_among_others() -> None:
    """A stack written out holds each column at its place: those of one channel are zero in all others."""
    stack, expected = columns()
    assert expected.shape == stack.shape
    assert np.array_equal(expected, stack.whole())
    assert np.array_equal(expected[:, :, [3, 0, 3]], stack.take([3, 0, 3]))
    assert np.array_equal(expected[:, :, 4], stack[4])


@pytest.mark.parametrize("first", range(6))
def test_parts_are_all_windows_of_the_columns_from_one_on(first: int) -> None:
    """They may begin within a run of either kind, or behind all."""
    stack, expected = columns()
    parts = list(stack.parts(first))
    assert max(len(part) for part in parts) <= WINDOWS_AT_ONCE
    assert np.array_equal(expected[:, :, first:], np.concatenate(parts))


def test_a_sum_leaves_both_as_they_were() -> None:
    """Columns that are added to one stack are in no other one."""
    one, expected = columns()
    other = one + ColumnStack(np.ones((WINDOWS, CHANNELS)))
    other.add(np.zeros((WINDOWS, CHANNELS)))
    assert ((WINDOWS, CHANNELS, 5), (WINDOWS, CHANNELS, 7)) == (one.shape, other.shape)
    assert np.array_equal(expected, one.whole())
