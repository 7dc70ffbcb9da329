"""Small drives for the tests of this package."""

from __future__ import annotations

import numpy as np

from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.motion import Car, Motion, driven_mask
from tpmsd.offline.simulator.world import World, make_world


def straight(speed_mps: float, duration_s: float, heading_rad: float = 0.0, yaw: float = 0.0) -> Motion:
    """Constant speed and yaw rate at 100 Hz on the level."""
    time = np.arange(round(100 * duration_s) + 1) / 100.0
    return Motion.from_profiles(
        time,
        np.full_like(time, speed_mps),
        np.full_like(time, yaw),
        wheelbase_m=2.63,
        heading_start_rad=heading_rad,
    )


def world_of(motion: Motion, model: ExtendedModel | None = None, roughness_std_m: float = 0.0) -> World:
    """The plain car on this motion, on a smooth road unless told otherwise."""
    car = Car(np.full(4, 0.316), WheelPositions(1.53, 1.52, 2.63), driven_mask("front"))
    return make_world(
        motion, car, model or ExtendedModel(), np.random.default_rng(1), roughness_std_m=roughness_std_m
    )
