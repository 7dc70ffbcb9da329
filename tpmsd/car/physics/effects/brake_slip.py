"""Under the brakes wheels turn slower than the ground passes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Grid, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Nonlinear, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import IS_FRONT, WHEELS, FloatArray


@dataclass(frozen=True)
class BrakeSlip(Effect):
    """omega * r = v * (1 - c * max(-a_x - from_mps2, 0)), c for each axle: brakes act on all wheels, in other
    shares than drive, or on one axle alone: a parking brake, or a motor that recuperates.

    a_x is the specific force. Drag and the rolling engine slow a car down before its brakes do: free wheels
    turn without force up to from_mps2. Slip under drive force acts for either sign of it: beside that, c of a
    driven axle is what the brakes make beyond it. Source: linear slip stiffness, F_x = C * s, and a brake
    balance of two thirds in front (Gustafsson, Automatica 33(6), 1997; Gillespie, ch. 3): 1e-3 to 5e-3 s2/m.
    Rolling resistance is 0.1 m/s2, drag 2.7e-4 /m * v^2, which is 0.24 m/s2 at 30 m/s (Gillespie, ch. 4).
    """

    name = "brake_slip"
    wording = Wording(
        formula="omega * r = v * (1 - c * max(-a_x - from_mps2, 0)), c = front or rear",
        sentence="wheels slip under the brakes",
        noun="slip under the brakes",
        answers=(
            "under the brakes the front wheels slip by {front} and the rear wheels by {rear}, "
            "beyond what they slip under drive force",
        ),
        distinguished_by="brake firmly and gently from the same speed on a straight, ten times",
    )
    identification = Identification(shows_in=("wheel_ratio", "accel_long"))
    confounding = Confounding(common=True, widened_by=("load_transfer_longitudinal",))
    nonlinear = Nonlinear(
        # No drag, and that at usual speeds.
        grid=Grid(
            "from_mps2",
            values=(0.02, 0.2),
            middle=0.02,
            range=(0.01, 0.8),
            penalty=lambda least: 0.7 + 0.5 * (math.log(least / 0.1) / 1.5) ** 2,
            step=2.0,
        ),
        # Both of one sign: either axle bears any share of the force, from none to all of it.
        ratio_limits=(0.0, math.inf),
    )
    one_sign = True
    parameters = (
        Parameter(
            "front",
            "s2/m",
            2e-3,
            -0.1,
            0.1,
            "c of the front wheels",
            probe=1e-5,
            prior=Prior(2e-3, 2e-3, "two thirds of the force in front"),
            fitted=(-1e-3, 0.1),  # none on an axle that does not brake, give or take what load shift adds
        ),
        Parameter(
            "rear",
            "s2/m",
            1e-3,
            -0.1,
            0.1,
            "c of the rear wheels",
            probe=1e-5,
            prior=Prior(1e-3, 1.5e-3, "one third of the force at the rear"),
            fitted=(-1e-3, 0.1),  # none on an axle that does not brake, give or take what load shift adds
        ),
        Parameter(
            "from_mps2",
            "m/s2",
            0.0,
            0.0,
            2.0,
            "deceleration without brakes",
            prior=Prior(0.2, 0.15, "rolling resistance and drag at usual speeds: Gillespie, ch. 4"),
        ),
    )
    front: float
    rear: float
    from_mps2: float = 0.0

    @classmethod
    def summed_with(cls, car: Car) -> Mapping[str, str]:
        """Return the slip of drive torque, which adds to that of the brakes on a driven axle."""
        axles = {"front": IS_FRONT, "rear": ~IS_FRONT}
        return {name: "slip_per_accel" for name, axle in axles.items() if car.driven[axle].all()}

    @classmethod
    def acting_wheels(cls, car: Car, fitted: tuple[str, ...]) -> tuple[str, ...]:
        """Return the wheels of the axles whose parameters were fitted."""
        axle = ("front", "front", "rear", "rear")
        return tuple(wheel for wheel, name in zip(WHEELS, axle, strict=True) if name in fitted)

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) -c times the deceleration by the brakes on each axle."""
        braking = np.maximum(-motion.specific_force_long_mps2 - self.from_mps2, 0.0)
        return -braking[:, None] * np.where(IS_FRONT, self.front, self.rear)
