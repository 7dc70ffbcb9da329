"""Braked wheels turn slower than they roll for a while, or stand."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.effect import GroupParameter, Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Identification, Nonlinear, Wording
from tpmsd.car.physics.slip_event import LONGEST_S, MIN_SLIP, SHORTEST_S, SlipEvent


@dataclass(frozen=True)
class WheelLock(SlipEvent):
    """Wheels turn slower than they roll, by a constant share (-1: they stand), from the onset on for so long.

    Source: a brake's force beyond what the ground gives; anti-lock systems hold slips of -0.05 to -0.2, and a
    brake that drags on ice less ([Pacejka 2012], chapter 1).
    """

    name = "wheel_lock"
    kind = Kind.EVENT
    wording = Wording(
        formula="omega * r = v * (1 + slip) on its wheels, onset_s <= t < onset_s + duration_s",
        sentence="braked wheels turn slower than they roll for a while, or stand",
        noun="locked wheels",
        answers=("{wheels} turned by {slip:just %} {slip:faster|slower} than they roll for {duration_s}",),
        distinguished_by="brake gently on the stretch, and look whether a brake drags",
    )
    identification = Identification(shows_in=("wheel_ratio", "time"))
    nonlinear = Nonlinear(span=True)
    own_per_drive = True
    parameters = (
        GroupParameter("wheels", "rear", "wheels that slip, by name, or front, rear"),
        Parameter(
            "slip",
            "1",
            -0.05,
            -1.0,
            0.0,
            "share by which the wheels turn faster than they roll",
            prior=Prior(0.0, 0.1, "anti-lock systems hold -0.05 to -0.2: Pacejka 2012, ch. 1"),
        ),
        Parameter("onset_s", "s", 300.0, -1e6, 1e6, "when it begins, from the drive's start"),
        Parameter("duration_s", "s", 20.0, 0.0, 1e7, "how long it lasts"),
    )

    @classmethod
    def fits_span(cls, slip: float, duration_s: float, driven: bool, axle: bool) -> bool:
        """Return whether wheels turn slower by more than ordinary force makes them."""
        return slip <= -MIN_SLIP and SHORTEST_S <= duration_s <= LONGEST_S
