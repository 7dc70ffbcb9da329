"""Gate of fixes: outliers are rejected, but a receiver that insists is trusted again.

In: how far a fix is from where it is expected, and how sure both are. Out: use it, reject it, or the pose is
lost; and, for fixes that are used, what their parts weigh.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from tpmsd.car.vehicle_state.robust import igg3
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.bank.batched_kalman import Weights, square_weights
from tpmsd.onboard.estimators.settings import SETTINGS


def igg3_weights(size: FloatArray) -> FloatArray:
    """Return the (n,) equivalent weights [Liu 2022, eq. 19] of standardised residuals: `igg3_floor` beyond
    the second zone."""
    return np.maximum(igg3(size, *SETTINGS.igg3_zones), SETTINGS.igg3_floor)


FIX_WEIGHTS: dict[str, Weights] = {"square": square_weights, "igg3": igg3_weights}
"""[filter] fix_weights -> weights of positions, courses and Doppler speeds by how they fit."""


class FixGate:
    """Memory of rejections."""

    def __init__(self) -> None:
        self.rejected = 0
        self._since_s: float | None = None

    @property
    def rejecting(self) -> bool:
        """True if the last fix was rejected."""
        return self._since_s is not None

    def reset(self) -> None:
        """Forget the rejections (the pose was given up)."""
        self._since_s = None

    def judge(self, off_m: float, variance_m2: float, time_s: float) -> Literal["use", "reject", "lost"]:
        """Judge a fix `off_m` from its expectation, the difference having `variance_m2`; 'lost' means to
        search the pose again."""
        if off_m <= SETTINGS.refuse_slack_m + SETTINGS.refuse_distance * math.sqrt(variance_m2):
            self._since_s = None
            return "use"
        self.rejected += 1
        if self._since_s is None:
            self._since_s = time_s
        return "lost" if time_s - self._since_s > SETTINGS.lost_after_s else "reject"
