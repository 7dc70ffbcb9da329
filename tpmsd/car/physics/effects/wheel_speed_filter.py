"""The control unit smooths the wheel speeds that it sends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.first_order import low_passed
from tpmsd.car.physics.kinematics import wheel_speeds
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray

MIN_MPS = 1.0
"""Below, the share is that at this speed."""
TOLERANCE_S, OWN = 0.1, 6.0
"""Up to which time constant smoothing is a control unit's own, and the nats that such a one costs: it can
hardly be distinguished from the age of a fix."""


@dataclass(frozen=True)
class WheelSpeedFilter(Effect):
    """Every wheel speed is that of a first-order low-pass: dy/dt = (x - y) / time_constant_s, x the speed of
    its hub.

    For slow changes that is a lag, as of fixes that arrive before they are valid; a low-pass rounds the ends
    of an acceleration and a lag shifts them, and differences between wheels come late against a gyro, too.
    Source: control units smooth speeds for the dashboard over 0.1 to 0.5 s, and for their own controllers
    over 5 to 40 ms, which is the bus's usual age (linear response of a first-order filter).
    """

    name = "wheel_speed_filter"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="wheel speeds shown = first-order low-pass of time_constant_s of the speeds of the hubs",
        sentence="the control unit smooths the wheel speeds",
        noun="smoothing of the wheel speeds",
        answers=("the control unit smooths the wheel speeds over {time_constant_s}",),
        distinguished_by="accelerate and brake as hard as the traffic allows, ten times",
    )
    identification = Identification(shows_in=("wheel", "accel_long"), needs=("speeds", "gnss"))
    confounding = Confounding(
        rare=True,
        tested_jointly_with=("velocity_lag", "gnss_latency"),
        estimated_jointly_with=("gnss_latency", "velocity_lag"),
    )
    one_sign = True
    stays = "what a low-pass took away cannot be given back"
    parameters = (
        Parameter(
            "time_constant_s",
            "s",
            0.3,
            0.0,
            10.0,
            "of the low-pass",
            probe=0.2,
            prior=Prior(0.0, 0.1, "0.1 to 0.5 s for a dashboard, next to none for a controller"),
            fitted=(0.0, 3.0),
        ),
    )
    time_constant_s: float

    @classmethod
    def penalty(cls, value: float) -> float:
        """Return a penalty on a short constant: a lag has the better known name."""
        return super().penalty(value) + (OWN if value < TOLERANCE_S else 0.0)

    @classmethod
    def tolerance_note(cls, value: float, std: float, speeds: bool) -> str:
        """Return the note on a low-pass as short as control units have; empty for a longer one."""
        if value - 2.0 * std > TOLERANCE_S:
            return ""
        return f"the bus smooths its wheel speeds over {value:.2f} +- {std:.2f} s; taken into account"

    def wheels_time_constant_s(self) -> float:
        """Return the time constant."""
        return self.time_constant_s

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) smoothed minus true speed of each hub, over the true one."""
        hubs = wheel_speeds(motion.speed_mps, motion.yaw_rate_radps, car.geometry)
        shown = [low_passed(one, motion.time_s, self.time_constant_s) for one in hubs.T]
        return np.asarray((np.stack(shown, axis=1) - hubs) / np.maximum(np.abs(hubs), MIN_MPS))
