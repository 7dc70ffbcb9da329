"""Down to which speed a drive's seconds are compared.

In: the drive's speeds. Out: the least speed. A window's reading errors hardly change with speed, so what it
knows of a relative change of radius goes with the square of its distance: seconds at walking pace hold next
to nothing of a drive on the road, and everything of one in a car park.
"""

from __future__ import annotations

import numpy as np

from tpmsd.foundation.wheels import FloatArray

TYPICAL_MPS = 5.0
"""From here on every second is compared: clutches, brakes and standstill disturb slower driving more than the
little information that it holds is worth."""
MIN_MPS = 1.5
"""Below, passive wheel sensors give no edges (counts are lost below 1 to 3 m/s), and the receiver's course is
noise."""
INFORMATION = 0.95
"""Share of a drive's information on radii that is kept: what is left out widens their standard deviations by
2.5 % at most."""


def least_speed(speed_mps: FloatArray) -> float:
    """Return the speed (m/s) above which (n,) speeds at equal steps hold `INFORMATION` of their sum of
    squares."""
    fastest = np.sort(speed_mps)[::-1]
    information = np.cumsum(fastest**2)
    if not len(information) or information[-1] <= 0.0:
        return TYPICAL_MPS
    enough = int(np.searchsorted(information, INFORMATION * information[-1]))
    return float(np.clip(fastest[min(enough, len(information) - 1)], MIN_MPS, TYPICAL_MPS))
