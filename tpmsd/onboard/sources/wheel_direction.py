"""Counters that count up whichever way the wheel turns, beside a bit that says which.

In: raw values and the direction bit. Out: values as if the counter counted down while turning backward. Pure.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


class DirectionKeeper:
    """Gives counters that count up in either direction the sign of their direction bit.

    The values that come out are congruent to a signed count, so that a `WheelCounter` unwraps them.
    """

    __slots__ = ("_last",)

    def __init__(self) -> None:
        self._last: dict[str, tuple[int, int]] = {}

    def signed(self, role: str, raw: int, modulus: int, backward: bool) -> int:
        """Return the counter's value as if it counted down while turning backward."""
        before, total = self._last.get(role, (raw, raw))
        step = (raw - before) % modulus
        total = (total - step if backward else total + step) % modulus
        self._last[role] = raw, total
        return total

    def signed_all(self, role: str, raw: IntArray, modulus: int, backward: BoolArray) -> IntArray:
        """Return the (n,) `signed` values of these in turn, without a change of state; see `put`."""
        before, total = self._last.get(role, (int(raw[0]), int(raw[0]))) if len(raw) else (0, 0)
        step = np.diff(raw, prepend=before) % modulus
        return np.asarray((total + np.cumsum(np.where(backward, -step, step))) % modulus)

    def put(self, role: str, raw: int, total: int) -> None:
        """Set the last raw value and the signed one that it came out as."""
        self._last[role] = raw, total
