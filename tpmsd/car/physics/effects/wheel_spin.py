"""Driven wheels spin for a while: too much drive for ice, gravel or a lifted wheel."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.effect import GroupParameter, Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Identification, Nonlinear, Wording
from tpmsd.car.physics.slip_event import LONGEST_S, MIN_SLIP, SHORTEST_S, SlipEvent


@dataclass(frozen=True)
class WheelSpin(SlipEvent):
    """Driven wheels turn faster than they roll, by a constant share, from the onset on for so long.

    Source: beyond the peak of the tyre's force (at a slip of 0.02 to 0.05 on ice, 0.1 on a dry road) the slip
    is held by driver or traction control ([Pacejka 2012], chapter 1).
    """

    name = "wheel_spin"
    kind = Kind.EVENT
    wording = Wording(
        formula="omega * r = v * (1 + slip) on its wheels, onset_s <= t < onset_s + duration_s",
        sentence="driven wheels spin for a while",
        noun="spinning wheels",
        answers=("{wheels} turned by {slip:just %} {slip:faster|slower} than they roll for {duration_s}",),
        distinguished_by="drive the stretch again with less drive",
    )
    identification = Identification(shows_in=("wheel_ratio", "time"))
    nonlinear = Nonlinear(span=True)
    own_per_drive = True
    parameters = (
        GroupParameter("wheels", "front", "wheels that slip, by name, or front, rear"),
        Parameter(
            "slip",
            "1",
            0.02,
            0.0,
            50.0,
            "share by which the wheels turn faster than they roll",
            prior=Prior(0.0, 0.05, "peak of the force on ice at 0.02 to 0.05: Pacejka 2012, ch. 1"),
        ),
        Parameter("onset_s", "s", 300.0, -1e6, 1e6, "when it begins, from the drive's start"),
        Parameter("duration_s", "s", 20.0, 0.0, 1e7, "how long it lasts"),
    )

    @classmethod
    def fits_span(cls, slip: float, duration_s: float, driven: bool, axle: bool) -> bool:
        """Return whether driven wheels turn faster by more than ordinary force makes them."""
        return driven and slip >= MIN_SLIP and SHORTEST_S <= duration_s <= LONGEST_S
