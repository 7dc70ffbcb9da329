"""In bends the inner wheels, which carry less load, slip more under the same force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import IS_LEFT, WHEELS, FloatArray

DRAG_PER_M, ROLLING_MPS2 = 2.7e-4, 0.1
"""Half rho c_d A / m, and rolling resistance per mass."""


@dataclass(frozen=True)
class InnerWheelSlip(Effect):
    """omega * r = v * (1 +- q * f * a_y), plus on the left and minus on the right wheels: q of the driven
    wheels is one under drive force and another under the brakes, of which they carry a part; the other wheels
    have one under the brakes alone. f = a_x + 2.7e-4 /m * v^2 + 0.1 m/s2 is the force that the tyres bring
    up: that against drag and rolling resistance shifts between the wheels as well.

    A differential gives both wheels of an axle the same torque, and so do their brakes; a tyre's slip is s =
    F_x / (C * F_z), for its stiffness is in proportion to its load. In a left turn (a_y > 0) the left wheels
    are the inner ones: F_z = F_0 * (1 - k * a_y) there and F_0 * (1 + k * a_y) on the right, and with s = c *
    f at F_0 the difference is q = c * k. a_x is the specific force. Source: [Gillespie 1992], ch. 4
    (drag, rolling resistance) and 6 (load transfer), Pacejka, Tyre and Vehicle Dynamics, ch. 4 (stiffness by
    load): 270 N per m/s2 of 3,700 N are k = 0.07 s2/m, and c = 4e-3 s2/m makes q = 3e-4 s4/m2.
    """

    name = "inner_wheel_slip"
    wording = Wording(
        formula="omega * r = v * (1 +- q * f * a_y), + left, - right, f = a_x + 2.7e-4 /m * v^2 + 0.1 m/s2, "
        "q = driven (f > 0), braked, free",
        sentence="the inner wheels, which carry less load, slip more in bends",
        noun="slip of the inner wheels",
        answers=(
            "in bends the inner driven wheels slip more, by {driven}",
            "the inner driven wheels slip under the brakes, by {braked}",
            "the other inner wheels slip under the brakes, by {free}",
        ),
        distinguished_by="speed up and brake in bends to both sides, ten times each",
    )
    identification = Identification(shows_in=("wheel_ratio", "accel_lat"), contrast=True)
    confounding = Confounding(common=True)
    one_sign = True
    parameters = (
        Parameter(
            "driven",
            "s4/m2",
            3e-4,
            -1e-2,
            1e-2,
            "q of the driven wheels under drive force",
            probe=1e-6,
            prior=Prior(3e-4, 3e-4, "k = 0.07 s2/m times a slip of 1e-3 to 8e-3 s2/m"),
        ),
        Parameter(
            "braked",
            "s4/m2",
            1.5e-4,
            -1e-2,
            1e-2,
            "q of the driven wheels under the brakes",
            probe=1e-6,
            prior=Prior(1.5e-4, 2e-4, "the same with the slip under the brakes"),
        ),
        Parameter(
            "free",
            "s4/m2",
            1.5e-4,
            -1e-2,
            1e-2,
            "q of the others, under the brakes",
            probe=1e-6,
            prior=Prior(1.5e-4, 2e-4, "the same with the slip under the brakes"),
        ),
    )
    driven: float = 0.0
    braked: float = 0.0
    free: float = 0.0

    @classmethod
    def acting_wheels(cls, car: Car, fitted: tuple[str, ...]) -> tuple[str, ...]:
        """Return the driven wheels or the others, as they were fitted."""
        asked = {"driven", "braked"} & set(fitted), {"free"} & set(fitted)
        return tuple(
            wheel
            for wheel, drives in zip(WHEELS, car.driven, strict=True)
            if (asked[0] if drives else asked[1])
        )

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) q * f * a_y, with the sign of the side."""
        drag = DRAG_PER_M * motion.speed_mps**2 + ROLLING_MPS2
        force = (motion.specific_force_long_mps2 + drag)[:, None]
        brake = np.where(car.driven, self.braked, self.free) * np.minimum(force, 0.0)
        scaled = np.where(car.driven, self.driven * np.maximum(force, 0.0), 0.0) + brake
        return np.asarray(scaled * motion.accel_lat_mps2[:, None] * np.where(IS_LEFT, 1.0, -1.0))
