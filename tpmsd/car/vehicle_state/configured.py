"""The car of a configuration as the filters of the vehicle state take it.

In: `[dynamics]`, tracks, driven axle. Out: `CarDynamics`; ConfigError where a value is missing.
"""

from __future__ import annotations

from tpmsd.car.config.dynamics import NEEDED
from tpmsd.car.config.dynamics_record import DynamicsConfig
from tpmsd.car.vehicle_state.car import CarDynamics
from tpmsd.foundation.errors import ConfigError

DRIVE_SHARES = {"front": 1.0, "rear": 0.0, "all": 0.5}
"""Share of the drive force at the front axle."""


def configured_car(
    dynamics: DynamicsConfig, track_front_m: float, track_rear_m: float, driven_axle: str
) -> CarDynamics:
    """Return the car, each wheel with half of its axle's cornering stiffness; ConfigError if a key is
    missing."""
    given = {name: getattr(dynamics, name) for name in NEEDED}
    if missing := [name for name, value in given.items() if value is None]:
        raise ConfigError(f"[dynamics] {' '.join(missing)}: missing; the vehicle state needs it")
    return CarDynamics(
        mass_kg=given["mass_kg"],
        yaw_inertia_kgm2=given["yaw_inertia_kgm2"],
        front_m=given["cg_to_front_m"],
        rear_m=given["cg_to_rear_m"],
        height_m=dynamics.cg_height_m,
        track_front_m=track_front_m,
        track_rear_m=track_rear_m,
        cornering_front_n=given["cornering_stiffness_front_n_per_rad"] / 2,
        cornering_rear_n=given["cornering_stiffness_rear_n_per_rad"] / 2,
        longitudinal_n=dynamics.longitudinal_stiffness_n,
        friction=dynamics.friction,
        drive_front_share=DRIVE_SHARES[driven_axle],
        brake_front_share=dynamics.brake_front_share,
    )
