"""The table `[dynamics]` as a plain record.

In: nothing. Out: `DynamicsConfig`, with the defaults.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DynamicsConfig:
    """Masses and tyres of the car as configured; None where a value is not stated."""

    mass_kg: float | None = None
    yaw_inertia_kgm2: float | None = None
    cg_to_front_m: float | None = None
    cg_to_rear_m: float | None = None
    cg_height_m: float = 0.5
    """Centre of gravity above the road."""
    cornering_stiffness_front_n_per_rad: float | None = None
    """Cornering stiffness of the front axle, N/rad."""
    cornering_stiffness_rear_n_per_rad: float | None = None
    """Cornering stiffness of the rear axle, N/rad."""
    longitudinal_stiffness_n: float = 80_000.0
    """Force of one wheel per unit of longitudinal slip."""
    friction: float = 1.0
    brake_front_share: float = 0.65
    drag_area_m2: float = 0.0
    """Drag coefficient times frontal area; 0 leaves drag out."""
    rolling_resistance: float = 0.0
    """Force per load; 0 leaves it out."""
