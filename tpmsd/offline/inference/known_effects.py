"""Known effects taken out of a recording: the baseline model of a diagnosis that begins with them.

In: a `Recording`, an `ExtendedModel`. Out: the recording as it would be if these effects did not act. Pure.
Factors and differences are those of `tpmsd.car.physics.reading_change`, on the recording's own smoothed
motion; that motion is made again from what is left, so that a latency or a larger radius is not in it
twice. What cannot be inverted stays: a wheel that hardly turned, the ripple of a ring, whose phase is each
drive's own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.motion import Motion
from tpmsd.car.physics.reading_change import AntennaChange, FixChange, wheel_rotation_factors
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import ReferenceTrajectory, reference

ROUNDS = 2
"""Times that the motion is made: the second differs from the first by the effects, a third by less."""
MIN_FACTOR = 0.2
"""Factor on a wheel's turn below which it is not divided out: noise would be blown up five times."""
STATIONARY_MPS = 0.3
"""Speed (m/s) of a fix below which its course is none."""


def without_effects(recording: Recording, model: ExtendedModel) -> Recording:
    """Return the recording with the effects removed; it needs readings of both rear wheels, and fixes."""
    if not len(model):
        return recording
    left = recording
    for _ in range(ROUNDS):
        left = _remove_effects(recording, reference(left), model)
    return left


def _remove_effects(recording: Recording, about: ReferenceTrajectory, model: ExtendedModel) -> Recording:
    """Return the recording without the effects, which are evaluated on the reference motion `about`."""
    car = about.car
    motion = about.motion
    if (felt := model.grade_factor()) != 1.0:
        motion = replace(motion, grade_rad=felt * motion.grade_rad)
    factor = _middle(wheel_rotation_factors(motion, car, model))
    teeth = np.array([model.true_teeth_per_rev(k, car.teeth_per_rev) for k in range(4)])
    ratio = teeth / car.teeth_per_rev
    rotation = recording.rotation_rad / np.where(factor > MIN_FACTOR, factor, 1.0) / ratio
    when = recording.fix_time_s - model.fix_age_s()
    change = AntennaChange(motion, car, model).at(when)
    speed, course = _velocity_without(recording, change)
    clock = recording.host_minus_utc_s
    if len(clock):
        error = model.clock_error_s(recording.fix_time_s)
        clock = clock - (error - error[0])
    return replace(
        recording,
        rotation_rad=rotation,
        quantum_rad=recording.quantum_rad / ratio,
        inertial=_inertial_without(recording, motion, about, model),
        fix_time_s=when,
        east_m=recording.east_m - change.east_m,
        north_m=recording.north_m - change.north_m,
        speed_mps=speed,
        course_rad=course,
        host_minus_utc_s=clock,
    )


def _inertial_without(
    recording: Recording, motion: Motion, about: ReferenceTrajectory, model: ExtendedModel
) -> dict[str, FloatArray]:
    """Return the readings of gyro, accelerometers and steering wheel without the effects."""
    bias, one = model.read_yaw_rate(np.array([0.0, 1.0]))
    yaw_error = _middle(model.yaw_rate_error_radps(motion, about.car))
    accel_error = _middle(model.accel_error_mps2(motion, about.car))
    read = recording.inertial
    return {
        **read,
        "yaw_rate_radps": (read["yaw_rate_radps"] - yaw_error - bias) / (one - bias),
        "accel_long_mps2": read["accel_long_mps2"] - accel_error[:, 0],
        "accel_lat_mps2": read["accel_lat_mps2"] - accel_error[:, 1],
        "steering_wheel_angle_rad": read["steering_wheel_angle_rad"]
        - _middle(model.steering_error_rad(motion, about.car)),
    }


def _velocity_without(recording: Recording, change: FixChange) -> tuple[FloatArray, FloatArray]:
    """Return (m,) speed and course of the fixes without the effects; as vectors where both are known."""
    speed, course = recording.speed_mps, recording.course_rad
    more = change.acting_mps - change.plain_mps
    both = np.isfinite(speed) & np.isfinite(course) & (speed > STATIONARY_MPS)
    read = np.where(both, speed, 1.0) * np.exp(1j * np.where(both, course, 0.0))
    left = read - more
    slower = np.abs(change.acting_mps) - np.abs(change.plain_mps)
    turned = np.angle(left / read)
    return (
        np.where(both, np.abs(left), speed - slower),
        np.where(both, course + turned, course),
    )


def _middle(edges: FloatArray) -> FloatArray:
    """Return the (n, ...) means over the ticks of values at their edges (n + 1, ...)."""
    return np.asarray(0.5 * (edges[1:] + edges[:-1]))
