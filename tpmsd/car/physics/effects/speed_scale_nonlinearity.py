"""Wheel speeds are scaled by a factor that changes with speed."""

from __future__ import annotations

from dataclasses import dataclass, replace

from tpmsd.car.physics.effect import Parameter, Prior
from tpmsd.car.physics.kinematics import wheel_speeds
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.physics.priors import tail_nats
from tpmsd.car.physics.speed_signal import SpeedSignalFault
from tpmsd.foundation.wheels import FloatArray

TYPICAL = Prior(0.0, 5e-5, "capture units are late by some microseconds")


@dataclass(frozen=True)
class SpeedScaleNonlinearity(SpeedSignalFault):
    """The bus shows v * (1 + k * v): a control unit that corrects speeds by a table, or by time stamps of
    edges that are late by a constant share of a tooth.

    Source: a latency t of the capture unit at an edge rate f makes a relative error f * t: 10 us at 500 Hz
    is 5e-3 at 33 m/s, k of 1.5e-4 s/m.
    """

    name = "speed_scale_nonlinearity"
    wording = replace(
        SpeedSignalFault.wording,
        formula="speed shown = v * (1 + k * v) on all wheels",
        sentence="the scale of the bus's wheel speeds changes with speed",
        noun="a bent scale of the bus's wheel speeds",
        answers=("the scale of the bus's wheel speeds changes with speed, by {per_mps}",),
    )
    parameters = (
        Parameter(
            "per_mps",
            "s/m",
            5e-5,
            -2e-3,
            2e-3,
            "k, relative error per speed",
            probe=1e-7,
            prior=TYPICAL,
        ),
    )
    per_mps: float

    @classmethod
    def penalty(cls, value: float) -> float:
        """Return nats against values beyond the delay of capture units: growth with speed reads the same."""
        return super().penalty(value) + tail_nats(value, TYPICAL)

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) k * v, v of each wheel."""
        return self.per_mps * wheel_speeds(motion.speed_mps, motion.yaw_rate_radps, car.geometry)
