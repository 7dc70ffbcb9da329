"""Dugoff's reduction of a tyre's linear force near the friction limit.

f = (2 - lambda) lambda below lambda = 1, else 1; lambda = mu F_z (1 + sigma) / (2 D), D the linear force
([Liu 2022], eqs (9)-(12), with 1 + sigma in (10)).
"""

from __future__ import annotations

import numpy as np

from tpmsd.car.physics.baselines.frame import Real
from tpmsd.foundation.wheels import FloatArray

_STILL_N = 1e-6
"""Linear force below which nothing slides, so that no division is by zero."""


def grip_share(linear_n: FloatArray, lengthened: Real, friction: Real, load_n: FloatArray) -> FloatArray:
    """Return the share of the linear force that the tyre carries; arrays broadcast.

    `lengthened` is 1 + sigma. A contact without load carries nothing.
    """
    limit = 0.5 * friction * np.maximum(load_n, 0.0) * lengthened / np.maximum(linear_n, _STILL_N)
    limit = np.minimum(limit, 1.0)
    return np.asarray((2.0 - limit) * limit)
