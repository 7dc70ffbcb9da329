"""The accelerometers read a constant more than acts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray

TOLERANCE_MPS2 = 0.25
"""Up to which a constant is usual: zero level of 10 mg, a crown of the road of 1.5 %."""


@dataclass(frozen=True)
class AccelerometerBias(Effect):
    """reading = truth + (long_mps2, lat_mps2): the zero levels of the accelerometers forward and to the left.

    On the level a sensor that is pitched or rolled in its mount reads the same, and so does a road that
    always falls to one side. Source: zero-g level of automotive accelerometers, 10 to 50 mg over temperature
    and life (data sheets).
    """

    name = "accelerometer_bias"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="accelerations read = accelerations + (long_mps2, lat_mps2)",
        sentence="the accelerometers read a constant more than acts",
        noun="an offset of the accelerometers",
        answers=(
            "the accelerometers read {long_mps2:size} {long_mps2:too much|too little} forward",
            "the accelerometers read {lat_mps2:size} {lat_mps2:too much|too little} to the left",
        ),
        distinguished_by="drive the same road there and back: a bank and a slope change their signs",
    )
    identification = Identification(shows_in=("accel_lat", "time"), reads=("accel_long", "accel_lat"))
    confounding = Confounding(confounded=("accelerometer_tilt", "road_bank"))
    stays = "no estimate depends on the accelerometers' zero"
    parameters = (
        Parameter(
            "long_mps2",
            "m/s2",
            0.4,
            -5.0,
            5.0,
            "reading minus truth, forward",
            probe=0.1,
            prior=Prior(0.0, 0.2, "10 to 50 mg: data sheets"),
        ),
        Parameter(
            "lat_mps2",
            "m/s2",
            0.4,
            -5.0,
            5.0,
            "reading minus truth, to the left",
            probe=0.1,
            prior=Prior(0.0, 0.2, "10 to 50 mg: data sheets"),
        ),
    )
    long_mps2: float = 0.0
    lat_mps2: float = 0.0

    @classmethod
    def tolerance_note(cls, value: float, std: float, speeds: bool) -> str:
        """Return the note on a bias within a sensor's usual zero offset; empty for a larger one."""
        if abs(value) - 2.0 * std > TOLERANCE_MPS2:
            return ""
        return f"an accelerometer reads {value:.2f} +- {std:.2f} m/s2 more than acts, as they do"

    def accel_error_mps2(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 2) the constants."""
        return np.tile([self.long_mps2, self.lat_mps2], (len(motion), 1))
