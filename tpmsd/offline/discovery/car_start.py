"""A configuration to start from, by an entry of the car library.

In: `CarPlatform`. Out: what `text` writes: roles whose fields are the entry's facts.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tpmsd.offline.discovery.library import CarPlatform, field_of
from tpmsd.offline.discovery.result import BusDiscovery, Estimate, FoundRole, Undecided
from tpmsd.offline.discovery.settings import SETTINGS

_MEASURE = "tpmsd discover on ten minutes of mixed driving"


def discovery_of_car(car: CarPlatform) -> BusDiscovery:
    """Return the car library's entry in the form of a discovery; measures that no library knows are listed as
    undecided.
    """
    roles = {role: _role_of_entry(role, entry) for role, entry in car.signals.items()}
    counts = any(role.startswith("wheel_count_") for role in roles)
    keys = ["wheel_radius_m", "track_rear_m", "wheelbase_m", "driven_axle"]
    if counts and car.teeth_per_rev is None:
        keys.append("teeth_per_rev")
    undecided = tuple(Undecided(f"vehicle.{key}", "a usual value is written", _MEASURE) for key in keys)
    teeth = car.teeth_per_rev or 48.0
    return BusDiscovery(
        "counts" if counts else "speeds",
        roles,
        counts_per_rev=Estimate(teeth, 0.0) if counts else None,
        counts_probability=1.0 if car.teeth_per_rev else 0.0,
        geometry={"wheel_radius_m": Estimate(SETTINGS.radius_m, SETTINGS.radius_std_m)},
        undecided=undecided,
        car=car.name,
    )


def _role_of_entry(role: str, entry: Mapping[str, Any]) -> FoundRole:
    return FoundRole(role, field_of(entry), SETTINGS.max_probability, modulus=int(entry.get("modulus", 0)))
