"""A tyre under load, speed and pressure, by the Magic Formula 6.1; written apart from the program's own tyre.

In: vertical force, gauge pressure relative to nominal, speed. Out: effective rolling radius. And the gas law
that makes a pressure of a temperature.

Source: Besselink, Schmeitz, Pacejka, "An improved Magic Formula/Swift tyre model that can handle inflation
pressure changes", Vehicle System Dynamics 48, 2010; numbers of the 205/60R15 of Pacejka, "Tire and Vehicle
Dynamics", 3rd ed., 2012, appendix 3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

R0_M, CZ0_NPM, FZ0_N, V0_MPS = 0.313, 209_651.0, 4000.0, 16.7
B_REFF, D_REFF, F_REFF = 8.386, 0.25826, 0.07394
Q_RE0, Q_V1, P_FZ1 = 0.9974, 7.742e-4, 0.7098
NOMINAL_PA, ATMOSPHERE_PA = 220e3, 101.3e3
SLIP_STIFFNESS = 21.4
"""Longitudinal slip stiffness over vertical force, dry: slip at Fx/Fz = 0.05 is 0.23 %, 0.71 mm of 304."""


@dataclass(frozen=True)
class Tyre:
    """One make of tyre; factors say how it differs from the 205/60R15."""

    size: float = 1.0
    """Of the unloaded radius."""
    load: float = 1.0
    """Of the nominal load; the stiffness goes with it."""
    softness: float = 1.0
    """Of the deflection under load, and so of what a loss of pressure makes."""
    growth: float = 1.0
    """Of the growth with speed."""

    def effective_radius_m(self, force_n: Array, gauge: Array, speed_mps: Array) -> Array:
        """Effective rolling radius; `gauge` is gauge pressure over nominal. Arrays that broadcast."""
        share = np.maximum(force_n, 100.0) / (FZ0_N * self.load)
        stiffness = CZ0_NPM * (1.0 + P_FZ1 * (np.maximum(gauge, 0.0) - 1.0))
        sunk = FZ0_N / stiffness * (D_REFF * np.arctan(B_REFF * share) + F_REFF * share)
        free = R0_M * (Q_RE0 + Q_V1 * self.growth * (speed_mps / V0_MPS) ** 2)
        return np.asarray(self.size * (free - self.softness * sunk))


def gauge_at(temperature_k: Array, filled_k: float, filled_gauge: float = 1.0) -> Array:
    """Gauge pressure over nominal at a temperature, of a tyre filled at another one; constant volume."""
    absolute = filled_gauge * NOMINAL_PA + ATMOSPHERE_PA
    return np.asarray((absolute * temperature_k / filled_k - ATMOSPHERE_PA) / NOMINAL_PA)
