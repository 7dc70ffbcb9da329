"""Torsional resonance of a wheel: its range, and how much a loss of pressure lowers it.

The tyre is a rigid ring (the belt) on the rim, held by the sidewalls' torsional stiffness c:

    I_rim  * theta_rim''  = -c * (theta_rim - theta_belt)
    I_belt * theta_belt'' =  c * (theta_rim - theta_belt) - (torque of the road)

Free of the road the two swing against each other at sqrt(c * (1/I_rim + 1/I_belt)); with the belt held by the
road the rim swings at sqrt(c / I_rim), which is what a wheel speed sensor sees at 30 to 60 Hz. Both go with
the square root of c. Sidewall stiffness is a constant of the carcass plus a part that the pressure tensions:

    c(p) = c0 * (1 - share + share * p / p0),     d ln f / d ln p = share / 2

Sources: Zegelaar, The dynamic response of tyres to brake torque variations and road unevennesses (Delft
1998); Pacejka, Tire and Vehicle Dynamics, ch. 9; Besselink, Schmeitz and Pacejka, Vehicle System Dynamics 48
(2010) S1 337 (tyre stiffness against pressure); Persson, Gustafsson and Drevoe, SAE 2002-01-1250.
"""

from __future__ import annotations

import numpy as np

from tpmsd.foundation.wheels import FloatArray

MIN_RESONANCE_HZ, MAX_RESONANCE_HZ = 25.0, 62.0
"""Range of the resonance in passenger cars, Hz."""
PRESSURE_LOSS = np.linspace(0.15, 0.5, 8)
"""Losses of pressure that count as soft; each as likely as the other."""
ELASTICITY = np.array([0.10, 0.16, 0.22, 0.30])
"""d ln f / d ln p: pressure carries some 50 to 70 per cent of the sidewall's torsional stiffness, and the
contact's stiffness, in series with it, takes up to half of the effect away."""


def soft_shifts() -> FloatArray:
    """Return the (elasticities * losses,) changes of ln f of a soft tyre, negative, all equally likely."""
    return np.outer(ELASTICITY, np.log1p(-PRESSURE_LOSS)).ravel()
