"""Types of arrays of indices and of truth values.

In: nothing. Out: `IntArray`, `BoolArray`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]
