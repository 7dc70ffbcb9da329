"""Which fixes are believed: outliers are refused, but a receiver that insists is believed again.

In: how far a fix is from where it is expected, and how sure both are. Out: use it, refuse it, or the pose is
lost; and, for fixes that are used, what their parts weigh.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from tpmsd.estimators.batched_kalman import Weights, square_weights
from tpmsd.vehicle_state.robust import igg3
from tpmsd.wheels import FloatArray

REFUSE_DISTANCE = 6.0
"""Fixes further off than this many standard deviations (plus `REFUSE_SLACK_M`) are refused."""
REFUSE_SLACK_M = 5.0
LOST_AFTER_S = 8.0
"""Fixes refused for this long: it is the pose that is wrong."""
IGG3_BELIEVE, IGG3_REFUSE = 2.5, 5.0
"""Zones of the IGG-III weights, standard deviations."""
MIN_WEIGHT = 1e-6


def igg3_weights(size: FloatArray) -> FloatArray:
    """Paper 004's equivalent weights (19): a part of a fix beyond `IGG3_REFUSE` sigma counts for nothing."""
    return np.maximum(igg3(size, IGG3_BELIEVE, IGG3_REFUSE), MIN_WEIGHT)


FIX_WEIGHTS: dict[str, Weights] = {"square": square_weights, "igg3": igg3_weights}
"""[filter] fix_weights -> weights of positions, courses and Doppler speeds by how they fit."""


class FixGate:
    """Memory of refusals."""

    def __init__(self) -> None:
        self.refused = 0
        self._since_s: float | None = None

    @property
    def refusing(self) -> bool:
        """Whether the last fix was refused."""
        return self._since_s is not None

    def reset(self) -> None:
        """Forget the refusals (the pose was given up)."""
        self._since_s = None

    def judge(self, off_m: float, variance_m2: float, time_s: float) -> Literal["use", "refuse", "lost"]:
        """Judge a fix `off_m` from its expectation; `variance_m2` is that of the difference."""
        if off_m <= REFUSE_SLACK_M + REFUSE_DISTANCE * math.sqrt(variance_m2):
            self._since_s = None
            return "use"
        self.refused += 1
        if self._since_s is None:
            self._since_s = time_s
        return "lost" if time_s - self._since_s > LOST_AFTER_S else "refuse"
