"""A car that drives all wheels slips more on one axle than on the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import IMPOSSIBLE_SIGN, Effect, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.physics.priors import MAX_LOAD_LONGITUDINAL_S2, tail_nats
from tpmsd.foundation.wheels import IS_FRONT, FloatArray

TYPICAL_RADIUS_M = 0.31
TYPICAL = Prior(0.0, 2e-3, "half of a slip of 4e-3 s2/m")


@dataclass(frozen=True)
class DriveSplit(Effect):
    """omega * r = v * (1 +- d/2 * a_x) on a car that drives all wheels, plus in front and minus at the rear.

    a_x is the specific force. An axle slips by c = (its share of the force) / (its share of the load) times
    that of both: 40 to 60 of the force on axles that carry 55 to 45 of the load make 0.73 and 1.33 of it, and
    of 4e-3 s2/m in the mean d is -2.4e-3. What both axles slip alike is `longitudinal_slip`. Over the same
    acceleration load shifts between the axles: the two read the same, and no drive tells them apart. Beyond
    3e-4 s2, d = -1.9e-3 s2/m, load transfer is the less likely one by its size. Source: linear slip stiffness
    (Gustafsson, Automatica 33(6), 1997), stiffness in proportion to load (Pacejka, Tyre and Vehicle Dynamics,
    ch. 4).
    """

    name = "drive_split"
    wording = Wording(
        formula="omega * r = v * (1 +- d/2 * a_x), + front, - rear, on a car that drives all wheels",
        sentence="one axle of a car that drives all wheels slips more than the other",
        noun="unequal slip of the axles",
        answers=("the {difference:front|rear} axle slips more under drive force, by {difference:size}",),
        distinguished_by="accelerate firmly and coast at the same speeds on a straight, ten times",
    )
    identification = Identification(shows_in=("wheel_ratio", "accel_long"), contrast=True)
    confounding = Confounding(limit="load_transfer_longitudinal")
    parameters = (
        Parameter(
            "difference",
            "s2/m",
            -2e-3,
            -0.1,
            0.1,
            "d, slip per m/s2 of the front wheels minus that of the rear ones",
            probe=1e-5,
            prior=TYPICAL,
        ),
    )
    difference: float

    @classmethod
    def observable(cls, motion: Motion, car: Car) -> bool:
        """Return whether all wheels are driven."""
        return bool(car.driven.all())

    @classmethod
    def penalty(cls, value: float) -> float:
        """Return nats against a value that load transfer may explain, and against its size (Student)."""
        load = -2.0 * MAX_LOAD_LONGITUDINAL_S2 / TYPICAL_RADIUS_M < value < 0.0
        return tail_nats(value, TYPICAL) + (IMPOSSIBLE_SIGN if load else 0.0)

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) half of d * a_x, with the sign of the axle."""
        half = 0.5 * self.difference * motion.specific_force_long_mps2
        return np.asarray(half[:, None] * np.where(IS_FRONT, 1.0, -1.0))
