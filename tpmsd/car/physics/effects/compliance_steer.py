"""In bends the front wheels give way, and the steering wheel is turned further."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Parameter, Prior
from tpmsd.car.physics.effect_records import Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray

TOLERANCE_RAD_S2PM = (-5e-4, 5e-3)
"""Between which it is every car's own: neutral to 3 degrees per g of understeer."""


@dataclass(frozen=True)
class ComplianceSteer(Effect):
    """The road wheels must point c * a_y further into the bend than atan(wheelbase * curvature), so that the
    steering wheel reads ratio * c * a_y more.

    c is the understeer gradient: what rack and bushings give way by, and what the front tyres slip sideways
    more than the rear ones; the two are one number in all that a car records. Source: understeer gradients of
    1 to 3 degrees per g, 1.8e-3 to 5e-3 rad per m/s2, on ordinary cars ([Gillespie 1992], ch. 6); more with a
    loaded nose or worn bushings, less than zero where the tail breaks away.
    """

    name = "compliance_steer"
    wording = Wording(
        formula="steering wheel read = ratio * (atan(wheelbase * curvature) + c * a_y)",
        sentence="the steering gives way in bends by more or less than a car's does",
        noun="give in the steering",
        answers=("the steering gives way in bends, by {coefficient} beside that of a usual car",),
        distinguished_by="drive the same bend slowly and fast, to both sides",
    )
    identification = Identification(shows_in=("steering", "accel_lat"), reads=("steering",))
    stays = "no estimate depends on the steering wheel"
    parameters = (
        Parameter(
            "coefficient",
            "rad.s2/m",
            8e-3,
            -0.1,
            0.1,
            "c, angle of the road wheels per lateral acceleration",
            probe=1e-4,
            prior=Prior(3e-3, 2e-3, "1 to 3 degrees per g: Gillespie, ch. 6"),
        ),
    )
    coefficient: float

    @classmethod
    def tolerance_note(cls, value: float, std: float, speeds: bool) -> str:
        """Return the note on an understeer that is usual for cars; empty for another."""
        low, high = TOLERANCE_RAD_S2PM
        if value + 2.0 * std < low or value - 2.0 * std > high:
            return ""
        return f"the car understeers by {value:.4f} +- {std:.4f} rad per m/s2, as cars do"

    def steering_error_rad(self, motion: Motion, car: Car) -> FloatArray:
        """(n,) ratio * c * a_y."""
        return np.asarray(car.steering_ratio * self.coefficient * motion.accel_lat_mps2)
