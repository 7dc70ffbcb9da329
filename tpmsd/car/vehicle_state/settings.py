"""The numbers of a typical car and of the slips that are made of them, each with its unit and reason.

In: nothing. Out: `SETTINGS`. Sources: Pacejka, Tyre and Vehicle Dynamics (2012), sections 1.3 and 4.3, for
stiffness over load; the parameter sets of the CommonRoad vehicle models for masses, heights and brakes.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class VehicleStateSettings:
    """A car of which only geometry and driven axle are known, and limits of the tyre model's inverse."""

    front_load_driven_front: float = 0.58
    """Share of the weight on the front axle where that is driven: engine and gearbox lie on it ..."""
    front_load_driven_rear: float = 0.52
    """... where the rear is ..."""
    front_load_driven_all: float = 0.55
    """... and where all are."""
    mass_kg: float = 1500.0
    """A middle-class car with a driver."""
    height_per_wheelbase: float = 0.21
    """Height of the centre of gravity over the wheelbase: 0.55 m at 2.6 m."""
    cornering_front_per_load: float = 12.0
    """Cornering stiffness over wheel load, 1/rad, with the compliance of steering and axle in it: less at the
    front than at the rear is what makes a passenger car understeer."""
    cornering_rear_per_load: float = 15.0
    """Cornering stiffness over wheel load at the rear, 1/rad."""
    longitudinal_per_load: float = 20.0
    """Slip stiffness over wheel load."""
    brake_front_share: float = 0.66
    """Share of the brake force at the front axle: ECE R13-H wants the front to lock first."""
    max_slip: float = 0.3
    """Forces beyond the tyre's reach are said to need this much longitudinal slip."""
    max_use: float = 0.9
    """Share of the friction limit up to which a force is turned into a slip angle: beyond, Dugoff's curve is
    too flat to be inverted."""
    probe_mps2: float = 0.01
    """An acceleration at which no tyre slides."""
    free_wheels: float = 0.02
    """Force that spins up an axle of wheels without drive, over the car's mass times its acceleration: two
    wheels of 1 kg m2 and 0.3 m against 1.1 t."""


SETTINGS = VehicleStateSettings()
"""The ones in use."""
