"""Medians without NumPy's own function, which imports masked arrays: 2 MB of memory, 40 ms of a command.

In: rows. Out: their median. Not-a-number is not looked for.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def median(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the medians over the first axis of (n, ...), n >= 1: what `np.median` returns."""
    ordered, middle = np.sort(rows, axis=0), len(rows) // 2
    return np.asarray(ordered[middle] if len(rows) % 2 else (ordered[middle - 1] + ordered[middle]) / 2)
