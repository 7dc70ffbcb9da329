"""A drive of the worlds as the recording that calibration would read from its folder.

Reading files is tested elsewhere; this keeps statistical tests and the coverage of `calibrate` quick.
"""

from __future__ import annotations

import math

import numpy as np

from bench.worlds.kinematic import STEP_S, Array, Drive, Spec
from tpmsd.car.config.model import VehicleConfig
from tpmsd.car.physics.motion import Car
from tpmsd.offline.calibration.nominal import vehicle_of
from tpmsd.offline.inference.recording import Recording

PER_TICK = 5


def configured(spec: Spec) -> VehicleConfig:
    """Configuration by the operator of the world's car."""
    return VehicleConfig(
        wheel_radius_m=(spec.radius_m,) * 4,
        track_front_m=spec.track_front_m,
        track_rear_m=spec.track_rear_m,
        wheelbase_m=spec.wheelbase_m,
        driven_axle=spec.driven,  # type: ignore[arg-type]
        steering_ratio=15.0,
        teeth_per_rev=spec.teeth,
    )


def recording_of(world: Drive, bus: str = "counts", wheels: int = 4, rounding_kmh: float = 0.01) -> Recording:
    """Ticks of 0.1 s from samples of 20 ms, of all wheels or the rear pair; speeds are rounded."""
    spec = world.spec
    angle = world.counts() * (2 * math.pi / spec.teeth)
    quantum_rad = 2 * math.pi / spec.teeth / math.sqrt(6)
    if bus == "speeds":
        unit = rounding_kmh / 3.6 * STEP_S / spec.radius_m
        turned = np.diff(world.shown_rad, axis=0, prepend=world.shown_rad[:1])
        angle, quantum_rad = np.cumsum(np.round(turned / unit) * unit, axis=0), 0.0
    rotation = np.diff(angle[::PER_TICK], axis=0)
    rotation[:, : 4 - wheels] = math.nan
    n = len(rotation)

    def mean(values: Array) -> Array:
        between = 0.5 * (values[1:] + values[:-1])
        return between[: n * PER_TICK].reshape(n, PER_TICK).mean(axis=1)

    start = vehicle_of(configured(spec))
    return Recording(
        name="world",
        car=Car(
            start.radius_m,
            start.geometry,
            start.driven,
            spec.teeth,
            antenna_forward_m=spec.antenna_forward_m,
            antenna_left_m=spec.antenna_left_m,
        ),
        dt_s=PER_TICK * STEP_S,
        start_s=0.0,
        rotation_rad=rotation,
        quantum_rad=np.full(4, quantum_rad),
        inertial={
            "yaw_rate_radps": mean(world.gyro),
            "accel_long_mps2": mean(world.accel_long),
            "accel_lat_mps2": mean(world.accel_lat),
        },
        fix_time_s=world.fix_true_s + world.fix_age_s,
        east_m=world.fix_east,
        north_m=world.fix_north,
        up_m=world.fix_up,
        speed_mps=world.fix_speed,
        course_rad=world.fix_course_math,
    )
