"""The car as a baseline of vehicle dynamics knows it: the configured values of `[vehicle]` and `[dynamics]`.

In: numbers. Out: `DynamicCar`. Stiffnesses of `cornering_*` are those of an axle, `longitudinal_n` that of a
wheel.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DynamicCar:
    """Constants of a car; SI units, lengths from the centre of gravity."""

    mass_kg: float
    yaw_inertia_kgm2: float
    front_m: float
    """Centre of gravity to front axle."""
    rear_m: float
    """Centre of gravity to rear axle."""
    cornering_front_n: float
    """Cornering stiffness of the front axle, N/rad."""
    cornering_rear_n: float
    """Cornering stiffness of the rear axle, N/rad."""
    height_m: float = 0.5
    """Centre of gravity above the road."""
    track_front_m: float = 1.5
    track_rear_m: float = 1.5
    longitudinal_n: float = 80_000.0
    """Force of one wheel per unit of longitudinal slip."""
    friction: float = 1.0
    drive_front_share: float = 1.0
    """Share of the drive force at the front axle."""
    brake_front_share: float = 0.65
    """Share of the brake force at the front axle."""
    drag_area_m2: float = 0.0
    """Drag coefficient times frontal area; 0 leaves drag out."""
    rolling_resistance: float = 0.0
    """Force per load; 0 leaves it out."""
    steering_ratio: float = 1.0
    """Steering-wheel angle over road-wheel angle; 1 where the road wheels are recorded."""

    def __post_init__(self) -> None:
        for name in ("mass_kg", "yaw_inertia_kgm2", "front_m", "rear_m", "cornering_front_n"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} = {getattr(self, name)!r} is not above 0")

    @property
    def wheelbase_m(self) -> float:
        """Front to rear axle."""
        return self.front_m + self.rear_m
