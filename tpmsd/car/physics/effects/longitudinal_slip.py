"""Driven wheels slip under drive force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.drive_slip import SLIP_BY_DRAG, DriveSlip
from tpmsd.car.physics.effect import Parameter
from tpmsd.car.physics.effect_records import Confounding, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.physics.priors import DRIVE_SLIP_S2PM
from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True)
class LongitudinalSlip(DriveSlip):
    """A driven wheel that pushes turns faster than it rolls: omega * r = v * (1 + c * a_x + d * v^2).

    a_x is the specific force (kinematic acceleration plus g*sin(grade)), that is, the drive force per mass
    less drag; the drag itself is the term in v^2. Both signs of a_x act: under engine braking the wheel turns
    slower. Source: linear slip stiffness, F_x = C * s (Gustafsson, Automatica 33(6), 1997). F_x/F_z =
    0.05 is a slip of 0.23 %: c from 1e-3 to 8e-3 s2/m by tyre and axle; half a rho c_d A over m makes d about
    c * 2.7e-4 /m.
    """

    name = "longitudinal_slip"
    wording = Wording(
        formula="omega * r = v * (1 + c * a_x + d * v^2) on driven wheels",
        sentence="driven wheels slip under drive force",
        noun="slip under drive force",
        answers=(
            "driven wheels slip under drive force, by {slip_per_accel}",
            "driven wheels slip against the drag, by {slip_per_speed2} times speed squared",
        ),
        distinguished_by="accelerate firmly and coast at the same speeds on a straight, ten times",
    )
    confounding = Confounding(common=True, widened_by=("load_transfer_longitudinal",))
    in_calibration = (("slip_long", "slip_per_accel", "s2/m"),)
    parameters = (
        Parameter(
            "slip_per_accel",
            "s2/m",
            2e-3,
            -0.1,
            0.1,
            "c, slip per m/s2",
            probe=1e-5,
            prior=DRIVE_SLIP_S2PM,
        ),
        SLIP_BY_DRAG,
    )
    slip_per_accel: float
    slip_per_speed2: float = 0.0

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) c*a_x + d*v^2 on the driven wheels, zero on the others."""
        slip = (
            self.slip_per_accel * motion.specific_force_long_mps2 + self.slip_per_speed2 * motion.speed_mps**2
        )
        return slip[:, None] * car.driven.astype(np.float64)
