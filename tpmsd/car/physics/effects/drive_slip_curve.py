"""Driven wheels slip under drive force, more than in proportion to it where the grip nears its end."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tpmsd.car.physics.drive_slip import SLIP_BY_DRAG, DriveSlip
from tpmsd.car.physics.effect import Grid, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.physics.priors import DRIVE_SLIP_S2PM
from tpmsd.foundation.wheels import FloatArray

MOST = 0.9
"""Share of the grip beyond which the slip stays: there the inverse of the tyre's curve runs away."""
MOVING_MPS = 3.0
"""Below, nothing is compared."""
LIVELY_MPS2 = 1.0
"""Specific force that 1 % of the driving must exceed, m/s2: below it a tyre's curve on ice is straight."""


@dataclass(frozen=True)
class DriveSlipCurve(DriveSlip):
    """omega * r = v * (1 + s + d * v^2) on driven wheels; with u = a_x / A, s = c * a_x up to |u| = 1/2, and
    beyond s = sign(u) * c * A / (4 * (1 - |u|)): the slip that Dugoff's tyre needs for a force. d is the
    drag's share, small enough to be linear.

    a_x is the specific force, A the greatest that the driven wheels' grip gives: mu * g * their share of the
    load, 5 m/s2 on a dry road, 2.6 on a wet one, 1.3 on snow. Source: Dugoff, Fancher and Segel, SAE 700377,
    1970: F = C * s for F < mu * F_z / 2, else F = mu * F_z * (1 - mu * F_z / (4 * C * s)), solved for s.
    """

    name = "drive_slip_curve"
    wording = Wording(
        formula="omega * r = v * (1 + s + d * v^2) on driven wheels, s = c * a_x for |a_x| < A/2,"
        " else sign(a_x) * c * A^2 / (4 * (A - |a_x|))",
        sentence="driven wheels slip more than in proportion to the drive force",
        noun="slip that grows faster than the drive force",
        answers=(
            "driven wheels slip under drive force by {slip_per_accel}, and more than in proportion to it",
            "driven wheels slip against the drag, by {slip_per_speed2} times speed squared",
        ),
        distinguished_by="accelerate gently and as firmly as the road allows, ten times each",
    )
    confounding = Confounding(limit="longitudinal_slip", widened_by=("load_transfer_longitudinal",))
    nonlinear = replace(
        DriveSlip.nonlinear,
        # Snow, a wet road, a dry one.
        grid=Grid(
            "saturation_mps2",
            values=(1.3, 2.6, 5.2),
            middle=2.6,
            range=(0.8, 12.0),
            penalty=lambda most: 2.0 + 0.5 * (math.log(most / 5.0) / 0.7) ** 2,
            step=1.4,
        ),
    )
    parameters = (
        Parameter(
            "slip_per_accel",
            "s2/m",
            2e-3,
            -0.1,
            0.1,
            "c, slip per m/s2 where the force is small",
            probe=1e-5,
            prior=DRIVE_SLIP_S2PM,
            fitted=(0.0, 0.1),
        ),
        SLIP_BY_DRAG,
        Parameter(
            "saturation_mps2",
            "m/s2",
            5.0,
            0.5,
            20.0,
            "A, specific force at which the driven wheels have no more grip",
            prior=Prior(5.0, 2.5, "mu * g * share of the load: 1.3 on snow, 5 on a dry road"),
        ),
    )
    slip_per_accel: float
    slip_per_speed2: float = 0.0
    saturation_mps2: float = 5.0

    @classmethod
    def observable(cls, motion: Motion, car: Car) -> bool:
        """Return whether the driving is lively enough for a bend in the curve."""
        force = np.abs(motion.specific_force_long_mps2[motion.speed_mps > MOVING_MPS])
        return bool(force.size) and float(np.quantile(force, 0.99)) > LIVELY_MPS2

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) the curve and the drag's share on the driven wheels, zero on the others."""
        share = np.clip(motion.specific_force_long_mps2 / self.saturation_mps2, -MOST, MOST)
        bent = np.sign(share) / (4.0 * (1.0 - np.abs(share)))
        slip = self.slip_per_accel * self.saturation_mps2 * np.where(np.abs(share) < 0.5, share, bent)
        slip = slip + self.slip_per_speed2 * motion.speed_mps**2
        return np.asarray(slip[:, None] * car.driven.astype(np.float64))
