"""A wheel's radius is not the configured one: what a calibration takes up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Kind, Parameter, Prior, WheelParameter
from tpmsd.car.physics.effect_records import Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import WHEELS, FloatArray


@dataclass(frozen=True)
class RadiusConstant(Effect):
    """delta_r = offset on one wheel, for the whole drive.

    A constant offset against the nominal radius is calibration and no finding. Source: tolerances of make,
    tread and pressure, one per cent.
    """

    name = "radius_constant"
    kind = Kind.NUISANCE
    wording = Wording(
        formula="delta_r = offset_m on one wheel", sentence="a wheel's radius is not the configured one"
    )
    identification = Identification(shows_in=("wheel", "speed"), wheel_patterns=WHEELS, always_fitted=True)
    own_per_drive = True
    parameters = (
        WheelParameter(),
        Parameter(
            "offset_m",
            "m",
            1e-3,
            -0.1,
            0.1,
            "true radius minus configured one",
            probe=1e-5,
            prior=Prior(0.0, 3e-3, "one per cent: make, tread, pressure"),
        ),
    )
    wheel: str
    offset_m: float

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) the offset on its wheel."""
        out = np.zeros((len(motion), 4))
        out[:, WHEELS.index(self.wheel)] = self.offset_m
        return out
