"""A car and situations that the tests share."""

from __future__ import annotations

import numpy as np

from tpmsd.car.vehicle_state.car import CarDynamics
from tpmsd.car.vehicle_state.kalman import GaussianState
from tpmsd.car.vehicle_state.model import StepInputs

PAPER_CAR = CarDynamics(
    mass_kg=1558.0,
    yaw_inertia_kgm2=2538.0,
    front_m=1.48,
    rear_m=1.08,
    height_m=0.432,
    track_front_m=1.51,
    track_rear_m=1.55,
    cornering_front_n=45_000.0,
    cornering_rear_n=75_000.0,
    longitudinal_n=80_000.0,
    friction=0.9,
    drive_front_share=1.0,
)
"""Table 1 of Liu et al. (2022); the stiffnesses are ours, the table has none."""
START = GaussianState(np.array([0.0, 20.0, 0.0]), np.diag([0.1, 0.2, 0.01]) ** 2)


def steering(steer_rad: float, accel_long_mps2: float = 0.0, dt_s: float = 0.01) -> StepInputs:
    return StepInputs(dt_s, accel_long_mps2, steer_rad)
