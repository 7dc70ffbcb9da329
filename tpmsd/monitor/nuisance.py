"""Harmless changes of radii: what wheels have in common, axles, sides, and each wheel alone.

In: standard deviations. Out: a covariance over wheels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.wheels import IS_FRONT, IS_LEFT, FloatArray


@dataclass(frozen=True, slots=True)
class Nuisance:
    """Standard deviations of harmless changes since the baseline, relative to the radius."""

    common: float
    axle: float
    side: float
    own: float

    def covariance(self, wheels: list[int], radius_m: FloatArray) -> FloatArray:
        """(d, d) covariance over the given wheels, m2."""
        d = len(wheels)
        out = np.ones((d, d)) * self.common**2 + np.eye(d) * self.own**2
        for contrast, std in ((IS_FRONT[wheels], self.axle), (IS_LEFT[wheels], self.side)):
            sign = np.where(contrast, 1.0, -1.0)
            out += np.outer(sign, sign) * std**2
        return out * np.outer(radius_m, radius_m)
