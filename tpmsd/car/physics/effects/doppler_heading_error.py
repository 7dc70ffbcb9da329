"""The receiver's speed is off by heading: a velocity error that stands in the earth's frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Kind, NoiseResemblance, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray

MIN_MPS = 3.0
"""Below, a course is noise."""


@dataclass(frozen=True)
class DopplerHeadingError(Effect):
    """The reported velocity has a constant error (east, north): with it in the back the speed is too high.

    Source: multipath and clock drift of the satellites in view, 0.01 to 0.05 m/s for minutes (Misra and Enge,
    Global Positioning System, 2011, section 5.5).
    """

    name = "doppler_heading_error"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula=(
            "speed shown = speed + east_mps * cos(heading) + north_mps * sin(heading); course by the rest"
        ),
        sentence="the receiver's velocity has a constant error",
        noun="a constant error of the receiver's velocity",
        answers=(
            "the receiver's velocity is {east_mps:size cm/s} too much to the {east_mps:east|west}",
            "the receiver's velocity is {north_mps:size cm/s} too much to the {north_mps:north|south}",
        ),
        distinguished_by="drive the same road there and back",
    )
    identification = Identification(shows_in=("gnss_speed", "time"), needs=("gnss_speed",))
    confounding = Confounding(resembles=NoiseResemblance.VELOCITY)
    own_per_drive = True
    stays = "it belongs to the drive on which it was found"
    parameters = (
        Parameter(
            "east_mps",
            "m/s",
            0.03,
            -1.0,
            1.0,
            "error towards the east",
            probe=0.01,
            prior=Prior(0.0, 0.02, "0.01 to 0.05 m/s"),
        ),
        Parameter(
            "north_mps",
            "m/s",
            0.03,
            -1.0,
            1.0,
            "error towards the north",
            probe=0.01,
            prior=Prior(0.0, 0.02, "0.01 to 0.05 m/s"),
        ),
    )
    east_mps: float = 0.0
    north_mps: float = 0.0

    def gnss_speed_error_mps(self, motion: Motion, car: Car) -> FloatArray:
        """(n,) the part along the heading."""
        heading = motion.heading_rad
        return np.asarray(self.east_mps * np.cos(heading) + self.north_mps * np.sin(heading))

    def gnss_course_error_rad(self, motion: Motion, car: Car) -> FloatArray:
        """(n,) the part across it, over the speed."""
        heading = motion.heading_rad
        across = self.north_mps * np.cos(heading) - self.east_mps * np.sin(heading)
        return np.asarray(across / np.maximum(motion.speed_mps, MIN_MPS))
