"""The rear wheels are steered: against the front ones at low speed, with them at high speed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Grid, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Nonlinear, Wording
from tpmsd.car.physics.kinematics import rear_steer_ratio
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import IS_FRONT, FloatArray

BEND_RADPS = 0.03
"""Yaw rate of a bend."""
TYPICAL_CROSSOVER_MPS = 15.0
LEAST_CHANGE = 0.1
"""Change of the ratio over a drive's bends, with a typical crossover: with less the angle of a usual gain
changes by 1 % of d, as a receiver's course errs in a bend of 30 m."""


@dataclass(frozen=True)
class RearAxleSteering(Effect):
    """beta = k * d at the rear axle, k = gain * (v^2 - v0^2) / (v^2 + v0^2): the car's body leaves its path
    by the angle of the rear wheels, which is -gain times d at walking pace, none at v0, and +gain times d at
    high speed; d = atan(wheelbase * curvature).

    The rear wheels roll along the path, 1 / cos(beta) times as far as the body moves forward. A share of d
    alone is what an antenna farther ahead reads, one that grows with the lateral acceleration a negative
    side slip: the change of sign is its own. Source: the steer ratio of no side slip, which goes from -1 at
    rest to a positive value over the speed squared (Sano, Furukawa and Shiraishi, SAE 860625, 1986);
    rear wheels are turned by 3 to 10 degrees at most, a tenth to a quarter of the front ones, and with them
    from 50 to 60 km/h on. One car in fifty has it.
    """

    name = "rear_axle_steering"
    wording = Wording(
        formula="beta = gain * (v^2 - crossover_mps^2) / (v^2 + crossover_mps^2) *"
        " atan(wheelbase * curvature)"
        " at the rear axle, whose wheels roll 1 / cos(beta) times as far",
        sentence="the rear wheels are steered",
        noun="steered rear wheels",
        answers=("the rear wheels are steered, by {gain:just %} of the front ones' angle",),
        distinguished_by="drive the same bends slowly and fast, to both sides",
    )
    identification = Identification(shows_in=("gnss_course", "accel_lat"), needs=("gnss",))
    confounding = Confounding(rare=True)
    nonlinear = Nonlinear(
        # 40 to 80 km/h.
        grid=Grid(
            "crossover_mps",
            values=(10.0, 16.0),
            middle=16.0,
            range=(5.0, 30.0),
            penalty=lambda speed: 0.7 + 0.5 * (math.log(speed / 15.0) / 0.3) ** 2,
            step=1.4,
        )
    )
    one_sign = True
    parameters = (
        Parameter(
            "gain",
            "1",
            0.15,
            -1.0,
            1.0,
            "angle of the rear wheels over d, far from crossover_mps",
            probe=1e-3,
            prior=Prior(0.0, 0.1, "3 to 10 degrees, where front wheels have 35"),
            fitted=(0.0, 0.5),
        ),
        Parameter(
            "crossover_mps",
            "m/s",
            TYPICAL_CROSSOVER_MPS,
            1.0,
            60.0,
            "speed at which the rear wheels are straight",
            prior=Prior(15.0, 3.0, "50 to 60 km/h: makers"),
        ),
    )
    gain: float
    crossover_mps: float = 15.0

    @classmethod
    def observable(cls, motion: Motion, car: Car) -> bool:
        """Return whether the ratio changes over the bends that are driven, on either side of the crossover.

        Without a change it is an antenna's position; a side slip changes as the speed squared, and is told
        from it by the drive.
        """
        bends = motion.speed_mps[np.abs(motion.yaw_rate_radps) > BEND_RADPS]
        if not bends.size:
            return False
        low, high = np.quantile(rear_steer_ratio(bends, TYPICAL_CROSSOVER_MPS), [0.05, 0.95])
        return bool(high - low > LEAST_CHANGE)

    def axle_course_rad(self, motion: Motion) -> FloatArray:
        """(n,) the angle of the rear wheels."""
        ratio = rear_steer_ratio(motion.speed_mps, self.crossover_mps)
        return np.asarray(self.gain * ratio * motion.steering_rad)

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) 1 / cos(beta) - 1 on the rear wheels, which roll along the path."""
        longer = 1.0 / np.cos(self.axle_course_rad(motion)) - 1.0
        return longer[:, None] * (~IS_FRONT).astype(np.float64)
