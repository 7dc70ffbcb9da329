"""One wheel has a tyre of another size from the start."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Parameter, Prior, WheelParameter
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import WHEELS, FloatArray


@dataclass(frozen=True)
class SpareOrMixedTyre(Effect):
    """delta_r = deviation_m on one wheel from the drive's start to its end.

    A constant radius is calibration, so that no drive names it: it is in the wheel's own radius. Whether that
    radius is a spare's, a soft tyre's or the configuration's is what a monitor weighs when it first meets a
    car. Source: temporary spares (UN R64) are 3 to 8 % smaller; tyres of one size and several makes keep
    their circumference within +1.5 and -2.5 % (ETRTO Standards Manual).
    """

    name = "spare_or_mixed_tyre"
    wording = Wording(
        formula="delta_r = deviation_m on one wheel, for the whole drive",
        sentence="one wheel has a tyre of another size",
        noun="a tyre of another size",
        answers=(
            "the tyre of {wheel} is {deviation_m:size mm} {deviation_m:larger|smaller} in"
            " radius than the others",
        ),
        distinguished_by="drive once with the spare and once without",
    )
    identification = Identification(shows_in=("wheel_ratio", "time"))
    confounding = Confounding(confounded=("radius_constant", "tone_ring_error"))
    own_per_drive = True
    parameters = (
        WheelParameter(),
        Parameter(
            "deviation_m",
            "m",
            -0.01,
            -0.1,
            0.1,
            "its radius minus that of the others",
            prior=Prior(0.0, 0.01, "spares are 3 to 8 % smaller, makes differ by 1.5 %"),
        ),
    )
    wheel: str
    deviation_m: float

    def not_compensated(self, signals: frozenset[str]) -> str | None:
        """Return the reason: calibration estimates the radius."""
        return f"the radius of {self.wheel} is what is calibrated"

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) the constant on its wheel."""
        out = np.zeros((len(motion), 4))
        out[:, WHEELS.index(self.wheel)] = self.deviation_m
        return out
