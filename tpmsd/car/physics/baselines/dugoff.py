"""Reduction of a tyre's linear force near the friction limit, by Dugoff's law or by the brush model.

Dugoff: f = (2 - lambda) lambda below lambda = 1, else 1; lambda = mu F_z (1 + sigma) / (2 D), D the linear
force ([Liu 2022], eqs (9)-(12), with 1 + sigma in (10)). Brush with parabolic pressure: f = 1 - x + x^2 / 3
below x = 1, else 1 / (3 x); x = D / (3 mu F_z (1 + sigma)) ([Pacejka 2012], section 3.2).
"""

from __future__ import annotations

import numpy as np

from tpmsd.car.physics.baselines.frame import Real
from tpmsd.foundation.wheels import FloatArray

_STILL_N = 1e-6
"""Linear force below which nothing slides, so that no division is by zero."""


def grip_share(
    linear_n: FloatArray, lengthened: Real, friction: Real, load_n: FloatArray, shape: Real = 0.0
) -> FloatArray:
    """Return the share of the linear force that the tyre carries; arrays broadcast.

    `lengthened` is 1 + sigma, `shape` 0 for Dugoff's law, 1 for the brush model and a mean of both between.
    A contact without load carries nothing.
    """
    limit = 0.5 * friction * np.maximum(load_n, 0.0) * lengthened / np.maximum(linear_n, _STILL_N)
    dugoff = np.minimum(limit, 1.0)
    dugoff = np.asarray((2.0 - dugoff) * dugoff)
    if isinstance(shape, float) and shape == 0.0:
        return dugoff
    x = 1.0 / (6.0 * np.maximum(limit, 1e-9))
    inside = np.minimum(x, 1.0)
    brush = np.where(x < 1.0, 1.0 - inside + inside**2 / 3.0, 1.0 / (3.0 * np.maximum(x, 1.0)))
    return np.asarray(dugoff + shape * (brush - dugoff))
