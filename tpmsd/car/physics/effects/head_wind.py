"""Wind from one direction: against it the driven wheels push harder, and slip more at the same speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, NoiseResemblance, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.physics.priors import DRIVE_SLIP_S2PM
from tpmsd.foundation.wheels import WHEELS, FloatArray

DRAG_PER_M = 2.7e-4
"""Half rho c_d A / m."""


@dataclass(frozen=True)
class HeadWind(Effect):
    """omega * r = v * (1 + slip_per_accel * 2.7e-4 /m * (u * abs(u) - v^2)) on driven wheels, u = v +
    east_mps * cos(heading) + north_mps * sin(heading) the speed of the air along the car.

    The wind comes from the east, or from the north, where its part is positive. What it does in calm air is
    slip by drag; it can be identified where the car goes in several directions, and free wheels are read
    beside the driven ones. Source: drag of half rho c_d A / m = 2.7e-4 /m ([Gillespie 1992], ch. 4) on linear
    slip stiffness (Gustafsson, Automatica 33(6), 1997); at 30 m/s 8 m/s against the car are 0.15 m/s2 and a
    slip of 6e-4. Beaufort 3 to 6 are 4 to 12 m/s.
    """

    name = "head_wind"
    wording = Wording(
        formula="omega * r = v * (1 + slip_per_accel * 2.7e-4 /m * (u * abs(u) - v^2)) on driven wheels, "
        "u = v + east_mps * cos(heading) + north_mps * sin(heading)",
        sentence="driven wheels slip more against the wind than with it",
        noun="wind",
        answers=(
            "the wind blows from the east at {east_mps}",
            "the wind blows from the north at {north_mps}",
        ),
        distinguished_by="drive the same fast road there and back in the wind",
    )
    identification = Identification(shows_in=("wheel_ratio", "time"), needs=("gnss", "both_axles"))
    confounding = Confounding(rare=True, resembles=NoiseResemblance.WHEEL)
    own_per_drive = True
    stays = "it belongs to the drive on which it was found"
    parameters = (
        Parameter(
            "east_mps",
            "m/s",
            6.0,
            -40.0,
            40.0,
            "of the wind, from the east",
            probe=1e-2,
            prior=Prior(0.0, 4.0, "4 to 12 m/s: Beaufort 3 to 6"),
            fitted=(-20.0, 20.0),
        ),
        Parameter(
            "north_mps",
            "m/s",
            6.0,
            -40.0,
            40.0,
            "of the wind, from the north",
            probe=1e-2,
            prior=Prior(0.0, 4.0, "4 to 12 m/s: Beaufort 3 to 6"),
            fitted=(-20.0, 20.0),
        ),
        Parameter(
            "slip_per_accel",
            "s2/m",
            4e-3,
            0.0,
            0.1,
            "slip of the driven wheels per m/s2; not fitted",
            prior=DRIVE_SLIP_S2PM,
        ),
    )
    east_mps: float = 0.0
    north_mps: float = 0.0
    slip_per_accel: float = 4e-3

    @classmethod
    def observable(cls, motion: Motion, car: Car) -> bool:
        """Return whether one axle is driven and the other is not."""
        return not car.driven.all()

    @classmethod
    def acting_wheels(cls, car: Car, fitted: tuple[str, ...]) -> tuple[str, ...]:
        """Return the driven wheels."""
        return tuple(wheel for wheel, drives in zip(WHEELS, car.driven, strict=True) if drives)

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) slip by the drag beyond that in calm air, on the driven wheels."""
        ahead = self.east_mps * np.cos(motion.heading_rad) + self.north_mps * np.sin(motion.heading_rad)
        air = motion.speed_mps + ahead
        more = DRAG_PER_M * (air * np.abs(air) - motion.speed_mps**2)
        return np.asarray(self.slip_per_accel * more[:, None] * car.driven)
