"""The steering's ratio is not the configured one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray

TOLERANCE = 0.06
"""Up to which a relative error is usual: racks of variable ratio, and front wheels that slip sideways."""


@dataclass(frozen=True)
class SteeringRatioError(Effect):
    """reading = ratio * configured ratio * road-wheel angle; `ratio` is the true one over the configured one.

    Source: makers state ratios of 12 to 20 for one model by engine and steering; variable racks change by a
    tenth to a third over the lock ([Gillespie 1992], ch. 8).
    """

    name = "steering_ratio_error"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="steering wheel read = ratio * configured ratio * atan(wheelbase * curvature)",
        sentence="the steering's ratio is not the configured one",
        noun="an error of the steering's ratio",
        answers=("the steering's ratio is {ratio:just %} {ratio:larger|smaller} than configured ({ratio})",),
        distinguished_by="drive full circles slowly, to both sides: nothing slips sideways there",
    )
    identification = Identification(shows_in=("steering", "steering"), reads=("steering",))
    stays = "no estimate depends on the steering wheel"
    parameters = (
        Parameter(
            "ratio",
            "1",
            1.2,
            0.3,
            3.0,
            "true ratio divided by the configured one",
            probe=0.01,
            neutral=1.0,
            prior=Prior(1.0, 0.1, "12 to 20 for one model: makers"),
        ),
    )
    ratio: float

    @classmethod
    def tolerance_note(cls, value: float, std: float, speeds: bool) -> str:
        """Return the note on a ratio within the tolerance of racks, else empty; `value` is ratio - 1."""
        if abs(value) - 2.0 * std > TOLERANCE:
            return ""
        return f"the steering's ratio is {1.0 + value:.3f} +- {std:.3f} of the configured one"

    def steering_error_rad(self, motion: Motion, car: Car) -> FloatArray:
        """(n,) the difference that the ratio makes."""
        return np.asarray((self.ratio - 1.0) * car.steering_ratio * motion.steering_rad)
