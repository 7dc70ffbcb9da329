"""Reduction of a tyre's linear force near the friction limit, by Dugoff's law, the brush model or a sine.

Dugoff: f = (2 - lambda) lambda below lambda = 1, else 1; lambda = mu F_z / (2 D), D the linear force over
1 + sigma ([Liu 2022], eqs (9)-(12), with 1 + sigma in (10)). Brush with parabolic pressure: f = 1 - x +
x^2 / 3 below x = 1, else 1 / (3 x); x = D / (3 mu F_z) ([Pacejka 2012], section 3.2). Magic Formula:
f = sin(C arctan(b - E (b - arctan b))) / (C b), b = D / (C mu F_z), C = 1.3, E = -0.5 ([Pacejka 2012],
section 4.3.1: 1.3 is the shape factor of side force).
"""

from __future__ import annotations

import numpy as np

from tpmsd.car.physics.baselines.frame import Real, sine
from tpmsd.foundation.wheels import FloatArray

_SHAPE, _CURVATURE = 1.3, -0.5
_MAX_LONGITUDINAL = 0.95
"""Largest share of friction taken by a longitudinal force: beyond it the root has no derivative."""
_STILL_N = 1e-6
"""Linear force below which nothing slides, so that no division is by zero."""
_LEAST = 1e-9
"""Friction over twice the linear force, at least, for the same reason."""


def grip_share(linear_n: FloatArray, friction: Real, load_n: FloatArray, shape: Real = 0.0) -> FloatArray:
    """Return the share of the linear force that the tyre carries; arrays broadcast.

    `linear_n` is over 1 + sigma; `shape` is 0 for Dugoff's law, 1 for the brush model, -1 for the Magic
    Formula and a mean of neighbours between. A contact without load carries nothing.
    """
    # with two bounds NumPy clips several numbers at once, which it does not for a maximum or a minimum
    limit = 0.5 * friction * np.clip(load_n, 0.0, np.inf) / np.clip(linear_n, _STILL_N, np.inf)
    dugoff = np.clip(limit, -np.inf, 1.0)
    dugoff = np.asarray((2.0 - dugoff) * dugoff)
    towards = np.asarray(shape)
    out = dugoff
    if (towards > 0.0).any():
        x = 1.0 / (6.0 * np.clip(limit, _LEAST, np.inf))
        inside, beyond = np.clip(x, -np.inf, 1.0), np.clip(x, 1.0, np.inf)
        # x = inside and beyond = 1 up to sliding, then x = beyond and inside = 1
        brush = 1.0 - inside + inside * inside / 3.0 + (1.0 / beyond - 1.0) / 3.0
        out = out + np.maximum(towards, 0.0) * (brush - dugoff)
    if (towards < 0.0).any():
        twice = 2.0 * np.clip(limit, _LEAST, np.inf)
        b = 1.0 / (_SHAPE * twice)
        bent = np.arctan((1.0 - _CURVATURE) * b + _CURVATURE * np.arctan(b))
        magic = sine(_SHAPE * bent) * twice
        out = out + np.maximum(-towards, 0.0) * (magic - dugoff)
    return np.asarray(out)


def lateral_friction_share(longitudinal_n: FloatArray, friction: Real, load_n: FloatArray) -> FloatArray:
    """Return the share of friction that a longitudinal force leaves to the side, by the friction ellipse.

    sqrt(1 - (F_x / mu F_z)^2) ([Hindiyeh 2014]).
    """
    limit = np.maximum(friction * np.maximum(load_n, 0.0), _STILL_N)
    return np.asarray(
        np.sqrt(1.0 - np.clip(longitudinal_n / limit, -_MAX_LONGITUDINAL, _MAX_LONGITUDINAL) ** 2)
    )
