"""The body rolls in bends and cambers the wheels, which turn on a smaller radius."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Parameter, Prior
from tpmsd.car.physics.effect_records import Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True)
class CamberRoll(Effect):
    """delta_r = -c * a_y^2 on all wheels: camber goes with the roll angle, and a cambered tyre rests on its
    shoulder.

    Source: camber of 0.5 degrees per m/s2 on simple axles, and a loss of radius in proportion to its square
    ([Pacejka 2012], section 4.3): 0.1 mm at 5 m/s2 is 4e-6 s4/m.
    """

    name = "camber_roll"
    wording = Wording(
        formula="delta_r = -c * a_y^2 on all wheels",
        sentence="in bends the body's roll cambers the wheels, which turn on a smaller radius",
        noun="camber by the body's roll",
        answers=(
            "in bends the body's roll cambers the wheels, which turn on a smaller radius, by {coefficient}",
        ),
        distinguished_by="drive the same bend slowly and fast, to both sides",
    )
    identification = Identification(shows_in=("wheel", "accel_lat"))
    one_sign = True
    parameters = (
        Parameter(
            "coefficient",
            "s4/m",
            4e-6,
            -1e-3,
            1e-3,
            "c, metres of radius per squared lateral acceleration",
            probe=1e-7,
            prior=Prior(4e-6, 4e-6, "0.1 mm at 5 m/s2"),
        ),
    )
    coefficient: float

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) -c * a_y^2 on every wheel."""
        return np.repeat(-self.coefficient * motion.accel_lat_mps2[:, None] ** 2, 4, axis=1)
