"""Common part of the two laws of slip under drive force.

In: nothing. Out: their base class, and the parameter of the drag's share.
"""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.effect import Effect, Parameter
from tpmsd.car.physics.effect_records import Identification, Nonlinear
from tpmsd.car.physics.motion import Car
from tpmsd.car.physics.priors import DRAG_SLIP_S2PM2
from tpmsd.foundation.wheels import WHEELS

SLIP_BY_DRAG = Parameter(
    "slip_per_speed2",
    "s2/m2",
    5e-7,
    -1e-4,
    1e-4,
    "d, slip per speed squared, from drag",
    probe=1e-8,
    prior=DRAG_SLIP_S2PM2,
)
AS_OF_FRAMES_S2PM = 1e-4
"""Up to this slip per m/s2 it may be no slip but frames of front and rear wheels that were read at once and
are stamped up to 1 ms apart, at 10 m/s: a tenth of what the stiffest tyres have."""


@dataclass(frozen=True)
class DriveSlip(Effect):
    """Driven wheels turn faster under the force that drives the car, the more the greater its drag is."""

    identification = Identification(shows_in=("wheel_ratio", "accel_long"))
    nonlinear = Nonlinear(
        # One tyre under two forces: d/c is half a rho c_d A / m, 3e-4 /m for a car, 1e-3 for a tall one.
        ratio_limits=(0.0, 5e-3)
    )
    one_sign = True

    @classmethod
    def acting_wheels(cls, car: Car, fitted: tuple[str, ...]) -> tuple[str, ...]:
        """Return the driven ones."""
        return tuple(wheel for wheel, drives in zip(WHEELS, car.driven, strict=True) if drives)

    @classmethod
    def tolerance_note(cls, value: float, std: float, speeds: bool) -> str:
        """Return the note on a slip that is none of a tyre (`AS_OF_FRAMES_S2PM`); empty beyond it.

        How far the load transfer moves a slip is in `std`, and says nothing of where this one comes from.
        """
        if abs(value) > AS_OF_FRAMES_S2PM:
            return ""
        return (
            f"driven wheels turn by {value:.1e} +- {std:.1e} per m/s2 more than the others, as where their"
            " frames are stamped at another instant; taken into account"
        )
