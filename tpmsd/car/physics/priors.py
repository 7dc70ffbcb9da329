"""Priors that several packages share: of what an effect, the daemon's filter and the calibration all
estimate.

In: nothing (plain records). Out: one `Prior` each, and nats against a size in a prior's tail. They stand
apart from the effects because the daemon's filter needs the numbers and not the catalogue, whose import costs
a second and 80 MB. The prior of a parameter that only one effect has stands in its file in `physics.effects`.
"""

from __future__ import annotations

import math

from tpmsd.car.physics.parameters import Prior

FIX_AGE_S = Prior(0.05, 0.1, "receivers transmit 30 to 300 ms after the epoch, by make, rate and baud")
SPEED_AGE_S = Prior(0.03, 0.05, "0.03 to 0.06 s on the recordings at hand")
ANTENNA_FORWARD_M = Prior(0.0, 0.4, "a tape measure along a roof")
TRACK_M = Prior(0.0, 0.045, "other rims or spacers: 10 to 60 mm")
GYRO_ZERO_RADPS = Prior(0.0, 1e-2, "data sheets: 0.6 degrees per second, uncalibrated")
GYRO_SCALE = Prior(1.0, 0.03, "data sheets: 1 to 3 % over temperature")
DRIVE_SLIP_S2PM = Prior(4e-3, 4e-3, "1e-3 to 8e-3 by tyre and axle: Gustafsson 1997")
DRAG_SLIP_S2PM2 = Prior(8e-7, 8e-7, "half rho c_d A / m, 2.7e-4 /m, times the slip per m/s2")
GROWTH_S2PM = Prior(1e-6, 7e-7, "Besselink, Schmeitz, Pacejka 2010: 1.1 mm from 10 to 36 m/s on a 205/60R15")
WARMTH_M = Prior(5e-4, 5e-4, "20 K is 0.56 mm on a 205/60R15")
MAX_LOAD_LONGITUDINAL_S2 = 3e-4
"""Longitudinal load transfer of a car, s2, beyond which it is something else: five standard deviations above
the usual 6e-5."""
LATERAL_LOAD_S2 = Prior(1e-4, 1e-4, "270 N per wheel and m/s2, 0.25 mm per 500 N")


def tail_nats(beyond: float, prior: Prior) -> float:
    """Return 2.5 ln(1 + (beyond / 2 std)^2), nats against a size that far from a prior's mean.

    It is Student's distribution with four degrees of freedom: 0.6 at one standard deviation, 1.7 at two, 5 at
    five. Sizes of cars have longer tails than a normal distribution.
    """
    return 2.5 * math.log1p((beyond / (2.0 * prior.std)) ** 2)
