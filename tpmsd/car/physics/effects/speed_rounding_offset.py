"""Wheel speeds are rounded down or up: a constant offset."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tpmsd.car.physics.effect import Parameter, Prior
from tpmsd.car.physics.kinematics import wheel_speeds
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.physics.speed_signal import SpeedSignalFault
from tpmsd.foundation.wheels import FloatArray

MIN_MPS = 1.0
"""Below, the share is that at this speed."""


@dataclass(frozen=True)
class SpeedRoundingOffset(SpeedSignalFault):
    """The bus shows v + offset: a control unit that cuts off digits shows half a step too little in the mean.

    Source: truncation to a step q has a mean error of -q / 2; steps of 0.01 to 1 km/h are met on buses.
    """

    name = "speed_rounding_offset"
    wording = replace(
        SpeedSignalFault.wording,
        formula="speed shown = speed + offset_mps on all wheels",
        sentence="the bus's wheel speeds have a constant offset",
        noun="an offset of the bus's wheel speeds",
        answers=("the bus's wheel speeds are {offset_mps:size cm/s} too {offset_mps:high|low}",),
    )
    parameters = (
        Parameter(
            "offset_mps",
            "m/s",
            -0.05,
            -1.0,
            1.0,
            "shown minus true speed",
            probe=0.001,
            prior=Prior(0.0, 0.05, "half a step of 0.01 to 1 km/h"),
        ),
    )
    offset_mps: float

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) the offset over each wheel's own speed."""
        speeds = wheel_speeds(motion.speed_mps, motion.yaw_rate_radps, car.geometry)
        return np.asarray(self.offset_mps / np.maximum(speeds, MIN_MPS))
