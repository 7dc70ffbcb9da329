"""A drive of the kinematic world as the `Recording` that its folder would be read into.

Reading frames and sentences is tested elsewhere; this keeps the statistical tests quick.
"""

from __future__ import annotations

import math

import numpy as np

from bench.worlds.kinematic import Array, Drive
from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.car.physics.motion import Car, driven_mask
from tpmsd.offline.inference.recording import Recording

PER_TICK = 5


def recording_of(drive: Drive, counted: bool = True) -> Recording:
    """Ticks of 0.1 s from samples of 20 ms; `counted` rounds the wheels' angles down to counts."""
    spec = drive.spec
    angle = (drive.counts() * (2 * math.pi / spec.teeth) if counted else drive.shown_rad)[::PER_TICK]
    rotation = np.diff(angle, axis=0)
    n = len(rotation)

    def mean(values: Array) -> Array:
        return values[1 : n * PER_TICK + 1].reshape(n, PER_TICK).mean(axis=1)

    unknown = np.full(n, math.nan)
    return Recording(
        car=Car(
            radius_m=np.full(4, spec.radius_m),
            geometry=WheelPositions(spec.track_front_m, spec.track_rear_m, spec.wheelbase_m),
            driven=driven_mask(spec.driven),
            teeth_per_rev=spec.teeth,
            antenna_forward_m=spec.antenna_forward_m,
            antenna_left_m=spec.antenna_left_m,
        ),
        dt_s=0.1,
        start_s=0.0,
        rotation_rad=rotation,
        quantum_rad=np.full(4, 2 * math.pi / spec.teeth / math.sqrt(6)),
        inertial={
            "yaw_rate_radps": mean(drive.gyro),
            "accel_long_mps2": mean(drive.accel_long),
            "accel_lat_mps2": mean(drive.accel_lat),
            "steering_wheel_angle_rad": mean(drive.steering_wheel),
            "drive_torque_nm": unknown,
            "ambient_temp_k": unknown,
        },
        fix_time_s=drive.fix_true_s + drive.fix_age_s,
        east_m=drive.fix_east,
        north_m=drive.fix_north,
        up_m=drive.fix_up,
        speed_mps=drive.fix_speed,
        course_rad=drive.fix_course_math,
    )
