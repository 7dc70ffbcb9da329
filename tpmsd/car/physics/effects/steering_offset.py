"""The steering wheel's sensor reads an angle on the straight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray

TOLERANCE_RAD = 0.05
"""Up to which an angle on the straight is usual: three degrees, by the crown of the road and the sensor."""


@dataclass(frozen=True)
class SteeringOffset(Effect):
    """reading = truth + offset_rad at the steering wheel.

    Source: zeros of steering angle sensors after work on the track rods, 1 to 5 degrees; makers' manuals for
    wheel alignment allow 1 to 3.
    """

    name = "steering_offset"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="steering wheel read = ratio * atan(wheelbase * curvature) + offset_rad",
        sentence="the steering wheel's sensor is off on the straight",
        noun="an offset of the steering wheel's sensor",
        answers=(
            "the steering wheel's sensor reads {offset_rad:size deg} {offset_rad:left|right} on the straight",
        ),
        distinguished_by="drive straight on for a minute there and back",
    )
    identification = Identification(shows_in=("steering", "time"), reads=("steering",))
    stays = "no estimate depends on the steering wheel"
    parameters = (
        Parameter(
            "offset_rad",
            "rad",
            0.1,
            -3.0,
            3.0,
            "reading minus truth, at the steering wheel",
            probe=0.01,
            prior=Prior(0.0, 0.04, "1 to 5 degrees after work on the track rods"),
        ),
    )
    offset_rad: float

    @classmethod
    def tolerance_note(cls, value: float, std: float, speeds: bool) -> str:
        """Return the note on an offset that is usual for steering wheels; empty for a larger one."""
        if abs(value) - 2.0 * std > TOLERANCE_RAD:
            return ""
        return f"the steering wheel reads {value:.3f} +- {std:.3f} rad on the straight, as they do"

    def steering_error_rad(self, motion: Motion, car: Car) -> FloatArray:
        """(n,) the offset."""
        return np.full(len(motion), self.offset_rad)
