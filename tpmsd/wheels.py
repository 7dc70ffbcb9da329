"""The wheels, in the one order that every array of the project uses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

WHEELS = ("fl", "fr", "rl", "rr")
"""Front left, front right, rear left, rear right."""

FL, FR, RL, RR = range(4)
IS_FRONT = np.array([True, True, False, False])
IS_LEFT = np.array([True, False, True, False])
