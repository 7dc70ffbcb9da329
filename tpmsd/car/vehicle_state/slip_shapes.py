"""Slips of a car's wheels as functions of its motion: shapes whose values a drive can determine.

In: a `Motion` and the `Car`. Out: per axle the slip of its wheels under drive and under brakes, and the slips
of a typical car. Closed forms over the whole drive, no filter. What is left to be fitted is how stiff the
tyres are and how the force is shared out.
"""

from __future__ import annotations

import numpy as np

from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.vehicle_state.car import CarDynamics, typical
from tpmsd.car.vehicle_state.loads import wheel_loads
from tpmsd.car.vehicle_state.settings import SETTINGS
from tpmsd.car.vehicle_state.slips import SlipTraces, slip_traces
from tpmsd.foundation.wheels import FloatArray

AXLES: dict[str, tuple[int, int]] = {"front": (0, 1), "rear": (2, 3)}


def wheel_slip_shapes(motion: Motion, car: Car) -> dict[str, FloatArray]:
    """Return name (`front_drive`, `rear_brake`, ...) -> (n, 4) slip of an axle's wheels per unit of its
    value.

    A value is the slip per acceleration while nothing slides. The tyre model gives how much more it takes
    where a tyre carries side force as well, or is near its limit. A tyre's slip stiffness goes with its load
    (Pacejka, Tyre and Vehicle Dynamics, 2012, section 4.3), so that the same force needs less slip on the
    axle to which braking moves the weight. Wheels without drive are spun up by the road, and slip a little
    the other way.
    """
    dynamics = dynamics_of(car)
    softer = _rest_load_ratio(dynamics, motion)
    slip = typical_slips(motion, car).wheel_slip * softer
    small = np.array([SETTINGS.probe_mps2, -SETTINGS.probe_mps2])
    slopes = slip_traces(dynamics, small, np.zeros(2)).wheel_slip / small[:, None]
    out = {}
    for axle, wheels in AXLES.items():
        for sign, how in enumerate(("drive", "brake")):
            if slopes[sign, wheels[0]] > 0.0:
                acting = np.maximum(slip, 0.0) if how == "drive" else np.minimum(slip, 0.0)
                shape = np.zeros_like(slip)
                shape[:, wheels] = acting[:, wheels] / slopes[sign, wheels[0]]
                if how == "drive" and np.count_nonzero(slopes[sign]) == 2:
                    free = slopes[sign] == 0.0
                    pull = np.maximum(motion.specific_force_long_mps2, 0.0)[:, None]
                    shape[:, free] = -SETTINGS.free_wheels * pull * softer[:, free]
                out[f"{axle}_{how}"] = shape
    return out


def dynamics_of(car: Car) -> CarDynamics:
    """Return a typical car with the geometry and the driven axle of this one."""
    front, rear = bool(car.driven[:2].any()), bool(car.driven[2:].any())
    driven = "all" if front and rear else "front" if front else "rear"
    geometry = car.geometry
    return typical(geometry.wheelbase_m, geometry.track_front_m, geometry.track_rear_m, driven)


def typical_slips(motion: Motion, car: Car) -> SlipTraces:
    """Return the slips of a typical car in the motion of this one."""
    steering = motion.measured.get("steering")
    return slip_traces(
        dynamics_of(car),
        motion.specific_force_long_mps2,
        motion.accel_lat_mps2,
        np.gradient(motion.yaw_rate_radps, motion.time_s),
        motion.steering_rad if steering is None else steering / car.steering_ratio,
    )


def _rest_load_ratio(car: CarDynamics, motion: Motion) -> FloatArray:
    """Return the (n, 4) ratio of a wheel's load at rest to its load, limited to 0.5 to 2."""
    load = wheel_loads(car, motion.specific_force_long_mps2, motion.accel_lat_mps2)
    rest = wheel_loads(car, np.zeros(1), np.zeros(1))
    return np.asarray(np.clip(rest / np.maximum(load, 1.0), 0.5, 2.0))
