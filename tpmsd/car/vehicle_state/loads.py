"""Wheel loads of a car.

In: accelerations. Out: loads of the four wheels. [Liu 2022, eq. 8], with the division by the wheelbase.
"""

from __future__ import annotations

import numpy as np

from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.car.vehicle_state.car import CarDynamics
from tpmsd.foundation.wheels import FloatArray


def wheel_loads(car: CarDynamics, accel_long_mps2: FloatArray, accel_lat_mps2: FloatArray) -> FloatArray:
    """Return (..., 4) loads in N, whose sum is m g for any acceleration; negative where a wheel would lift.

    Eq. (8) with the division by the wheelbase: each axle takes the lateral transfer of the mass it carries,
    and braking moves load to the front.
    """
    base = car.wheelbase_m
    rest = (
        car.mass_kg * GRAVITY_MPS2 / (2 * base) * np.array([car.rear_m, car.rear_m, car.front_m, car.front_m])
    )
    pitch = car.mass_kg * car.height_m / (2 * base) * np.array([-1.0, -1.0, 1.0, 1.0])
    front = car.height_m * car.mass_kg * car.rear_m / (base * car.track_front_m)
    rear = car.height_m * car.mass_kg * car.front_m / (base * car.track_rear_m)
    roll = np.array([-front, front, -rear, rear])
    along, across = np.asarray(accel_long_mps2)[..., None], np.asarray(accel_lat_mps2)[..., None]
    return np.asarray(rest + along * pitch + across * roll)
