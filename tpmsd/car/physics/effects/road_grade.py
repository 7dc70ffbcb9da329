"""Slopes: the wheels roll along them, the receiver reports the horizontal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, NoiseResemblance
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray

FACTORS = (0.5, 2.0)
"""Factors of its response that a fit may find: it has no parameter, so that it is one, up to the errors of
slopes by heights or accelerometer."""


@dataclass(frozen=True)
class RoadGrade(Effect):
    """Horizontal distance = cos(grade) times the distance rolled; no parameters.

    Source: geometry. NMEA's RMC speed and position are horizontal. 5 % of slope shortens by 0.125 %, which
    looks like 0.4 mm of radius.
    """

    name = "road_grade"
    wording = Wording(
        formula="horizontal way = cos(grade) * way rolled",
        sentence="wheels roll along slopes, the receiver reports the horizontal",
        noun="slopes",
        answers=("wheels roll along slopes, of which the receiver reports the horizontal",),
        distinguished_by="drive up and down a long slope of 5 % or more at constant speed",
    )
    identification = Identification(shows_in=("wheel", "grade"), needs=("gnss", "slopes"))
    confounding = Confounding(resembles=NoiseResemblance.COMMON)
    common_to_all_drives = True
    shortens = True
    one_sign = True

    def horizontal_factor(self, motion: Motion) -> FloatArray:
        """(n,) cos(grade)."""
        return np.asarray(np.cos(motion.grade_rad))

    @classmethod
    def limits(cls, car: Car) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of the factor, keyed by the empty name."""
        return {"": FACTORS}
