"""Snow chains are put on and taken off again: an axle rolls on a larger radius for a while."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.effect import GroupParameter, Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Identification, Nonlinear, Wording
from tpmsd.car.physics.slip_event import LONGEST_S, SlipEvent

THINNEST, THICKEST = 0.01, 0.06
"""Share by which a radius grows: cables of 4 mm, and chains for trucks."""


@dataclass(frozen=True)
class Chains(SlipEvent):
    """The wheels of a driven axle turn slower, omega * r = v * (1 + slip), slip = -d / r, from the onset on.

    Source: rings of 7 to 12 mm thickness (EN 16662-1) on a wheel of 0.3 m are a radius larger by 2 to 4 %;
    they stay on for minutes to hours, longer than wheels lock.
    """

    name = "chains"
    kind = Kind.EVENT
    wording = Wording(
        formula="omega * r = v * (1 + slip) on its wheels, onset_s <= t < onset_s + duration_s",
        sentence="an axle rolls on chains for a while",
        noun="chains",
        answers=("{wheels} rolled on chains for {duration_s:min}",),
        distinguished_by="drive the stretch again without chains",
    )
    identification = Identification(shows_in=("wheel_ratio", "time"))
    nonlinear = Nonlinear(span=True)
    own_per_drive = True
    parameters = (
        GroupParameter("wheels", "front", "wheels with chains, by name, or front, rear"),
        Parameter(
            "slip",
            "1",
            -0.03,
            -0.1,
            0.0,
            "share by which the wheels turn faster than they roll without chains",
            prior=Prior(-0.03, 0.01, "rings of 7 to 12 mm: EN 16662-1"),
            fitted=(-THICKEST, 0.0),
        ),
        Parameter("onset_s", "s", 300.0, -1e6, 1e6, "when they are put on, from the drive's start"),
        Parameter("duration_s", "s", 600.0, 0.0, 1e7, "how long they stay on"),
    )

    @classmethod
    def fits_span(cls, slip: float, duration_s: float, driven: bool, axle: bool) -> bool:
        """Return whether a driven axle turns slower by a chain's thickness, for longer than a wheel locks.

        A wheel alone bears no chain (it would pull the car aside).
        """
        return driven and axle and -THICKEST <= slip <= -THINNEST and duration_s > LONGEST_S
