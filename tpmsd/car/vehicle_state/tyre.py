"""The Dugoff tyre: forces of a wheel from its slip, slip angle and load, and their derivatives.

In: arrays of any one shape. Out: arrays of that shape. [Liu 2022], eqs (9)-(12), with the divisor 1 + sigma
in (10), where alpha is printed. Signs: slip positive when driving, slip angle positive where the force points
left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import FloatArray

_STILL_N = 1e-6
"""Linear force below which nothing slides, so that no division is by zero."""


@dataclass(frozen=True, slots=True)
class TyreForces:
    """Forces in the wheel's own frame, N."""

    along_n: FloatArray
    left_n: FloatArray


@dataclass(frozen=True, slots=True)
class TyreGradients:
    """Derivatives of the forces, which an EKF needs."""

    along_by_angle: FloatArray
    """N/rad."""
    left_by_angle: FloatArray
    along_by_load: FloatArray
    """N per N of load."""
    left_by_load: FloatArray


@dataclass(frozen=True, slots=True)
class DugoffTyre:
    """Dugoff's model, with the stiffnesses of one tyre or of several, (w,)."""

    longitudinal_n: float | FloatArray
    """Force per unit of slip, N."""
    cornering_n: float | FloatArray
    """N/rad."""
    friction: float

    def forces(self, slip: FloatArray, slip_angle_rad: FloatArray, load_n: FloatArray) -> TyreForces:
        """Return longitudinal and lateral force; all arrays broadcast together.

        A wheel without load has no force. The sum of both forces never exceeds friction * load: with
        D = hypot(C_sigma sigma, C_alpha tan alpha) it is friction * load * (1 - lambda / 2) when sliding
        (lambda < 1), and D / (1 + sigma) <= friction * load / 2 when not.
        """
        along = self.longitudinal_n * slip
        left = self.cornering_n * np.tan(slip_angle_rad)
        lengthened = 1.0 + slip
        linear = np.maximum(np.hypot(along, left), _STILL_N)
        limit = np.minimum(self.friction * np.maximum(load_n, 0.0) * lengthened / (2.0 * linear), 1.0)
        share = (2.0 - limit) * limit / lengthened  # f(lambda), which is 1 at lambda = 1 and stays so
        return TyreForces(along * share, left * share)

    def gradients(self, slip: FloatArray, slip_angle_rad: FloatArray, load_n: FloatArray) -> TyreGradients:
        """Return the derivatives of `forces` by slip angle and load, at constant slip."""
        tangent = np.tan(slip_angle_rad)
        linear = np.maximum(np.hypot(self.longitudinal_n * slip, self.cornering_n * tangent), _STILL_N)
        limit_by_load = np.where(load_n > 0.0, self.friction * (1.0 + slip) / (2.0 * linear), 0.0)
        limit = limit_by_load * load_n
        share = np.where(limit < 1.0, (2.0 - limit) * limit, 1.0)
        by_limit = np.where(limit < 1.0, 2.0 - 2.0 * limit, 0.0)
        along = self.longitudinal_n * slip / (1.0 + slip)
        left = self.cornering_n * tangent / (1.0 + slip)
        limit_by_tangent = -limit * np.square(self.cornering_n) * tangent / linear**2
        by_angle = 1.0 + tangent**2
        return TyreGradients(
            along_by_angle=along * by_limit * limit_by_tangent * by_angle,
            left_by_angle=(self.cornering_n / (1.0 + slip) * share + left * by_limit * limit_by_tangent)
            * by_angle,
            along_by_load=along * by_limit * limit_by_load,
            left_by_load=left * by_limit * limit_by_load,
        )
