"""Regular readings of one wheel, taken as arrays: the result, and what counters and speeds share.

A run of readings is regular as long as nothing has to be reported or decided: each is possible, in time and
follows from the one before. `WheelCounter.regular_readings` and `WheelSpeedIntegrator.regular_readings`
compute such runs with the formulas of their `update`, in the same order of operations, so that the numbers
are the same to the last bit (`tests/onboard/sources_can/test_regular_readings.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class RegularReadings:
    """Angles of n readings, of which the first `regular` are valid."""

    angle_rad: FloatArray
    """(n,) since the segment began."""
    still_since_s: FloatArray
    """(n,) when the value stopped changing; NaN while it changes."""
    regular: int
    """Number of regular readings; n if all are. The values of those behind are meaningless."""
    commit: Callable[[], None]
    """Makes the tracker one that has taken all n; nothing is changed before."""


def _commit_nothing() -> None:
    """Commit nothing."""


def none_regular(count: int) -> RegularReadings:
    """Return the result for `count` readings of which the first is irregular."""
    return RegularReadings(np.zeros(count), np.full(count, np.nan), 0, _commit_nothing)


def first_true(irregular: BoolArray) -> int:
    """Return the index of the first True; the length if there is none."""
    return int(np.argmax(irregular)) if irregular.any() else len(irregular)


def still_runs(same: BoolArray, before_s: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the index of the reading at which each run of unchanged values begins, and the time since when
    the value is still.

    `same` (n,): the value is that of the reading before; `before_s` (n,): time of the reading before. Returns
    the index of the run's first reading (n,), its own index where the value changed, and the time of the
    reading before that run (n,), NaN where the value changed.
    """
    index = np.arange(len(same))
    begin = np.maximum.accumulate(np.where(same, -1, index)) + 1
    begin = np.where(same, begin, index)
    return begin, np.where(same, before_s[begin], np.nan)


def first_run_too_long(begin: IntArray, too_long: BoolArray) -> int:
    """Return the index at which the first run of unchanged values begins that contains a True; n if there is
    none."""
    return int(begin[too_long].min()) if too_long.any() else len(too_long)
