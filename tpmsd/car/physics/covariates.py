"""Covariates that an effect may depend on, by name: those of the catalogue and of the diagnosis.

In: `Motion`, `Car`, a name. Out: its values over time in SI units. One definition, so that a shape found
over a covariate acts over the same one in simulator and daemon.
"""

from __future__ import annotations

import numpy as np

from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray

COVARIATES: dict[str, str] = {
    "speed": "m/s",
    "accel_long": "m/s2",
    "accel_lat": "m/s2",
    "yaw_rate": "rad/s",
    "steering": "rad",
    "steering_rate": "rad/s",
    "grade": "rad",
    "time": "s",
    "distance": "m",
    "temperature": "K",
    "torque": "Nm",
}
"""Name and unit. `accel_long` is the specific force, `steering` the angle of the steering wheel."""
ROLES: dict[str, str] = {"temperature": "ambient_temp", "torque": "drive_torque"}
"""Covariates that the motion does not determine, and the bus signal that states each."""


def covariate(motion: Motion, car: Car, name: str) -> FloatArray:
    """(n,) values of a covariate; NaN where neither the motion nor a measurement determines them.

    What was measured (`Motion.measured`) stands before what follows from the motion: the steering wheel's
    angle is else that of a car that does not slip sideways.
    """
    if name in motion.measured:
        return motion.measured[name]
    if name == "speed":
        return motion.speed_mps
    if name == "accel_long":
        return motion.specific_force_long_mps2
    if name == "accel_lat":
        return motion.accel_lat_mps2
    if name == "yaw_rate":
        return motion.yaw_rate_radps
    if name == "steering":
        return motion.steering_rad * car.steering_ratio
    if name == "steering_rate" and len(motion) > 1:
        return np.asarray(np.gradient(motion.steering_rad * car.steering_ratio, motion.time_s))
    if name == "grade":
        return motion.grade_rad
    if name == "time":
        return motion.time_s
    if name == "distance":
        return motion.distance_m
    if name not in COVARIATES:
        raise ValueError(f"no such covariate: {name}")
    return np.full(len(motion), np.nan)
