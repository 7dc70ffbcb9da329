"""What each channel shows of a course without any noise, over windows of a second.

In: `Course`, `Spec`, which fixes there were. Out: `Windows` and the channels (w, 9) of any concealed
physics: ways of the four wheels (m), yaw rate (rad/s), GNSS speed (m/s), course (rad), east and north (m).
The difference of two such tables is what the physics does; it is written with the equations of
`bench/worlds` alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.worlds.course import (
    Array,
    Course,
    antenna,
    gyro_reading,
    hub_speeds,
    summed,
    uncatalogued_speed_error,
    wheel_rates,
)
from bench.worlds.instruments import Drive
from bench.worlds.spec import Spec

PER_S = 10
CHANNELS = 9
MIN_SPEED_MPS = 5.0
MAX_YAW_RADPS = 0.4
Physics = Mapping[str, dict[str, Any]]


@dataclass(frozen=True)
class Windows:
    """One-second windows of a drive: where it was, and what was read at all."""

    course: Course
    """At 10 Hz."""
    spec: Spec
    read: np.ndarray
    """(w, 9) whether a channel was read."""
    fixes: Array
    """(w,) number of fixes."""
    covariates: dict[str, Array]
    """(w,) each."""
    yaw_of_distance: Array
    """(w, 4) answer of each wheel's way to the yaw rate."""
    sin: Array
    cos: Array
    """(w,) of the heading."""

    def __len__(self) -> int:
        return len(self.fixes)

    @property
    def speed(self) -> Array:
        """(w,)"""
        return self.covariates["speed"]

    def rigid(self) -> Windows:
        """The same motion by a car whose tyres neither slip nor creep."""
        bare = replace(self.course, hubs=None, spin=None, beta=np.zeros_like(self.course.beta))
        return replace(self, course=bare)

    def channels(self, physics: Physics) -> Array:
        """(w, 9) without noise, with this physics over the world's own."""
        spec = replace(self.spec, physics=dict(physics))
        course, count = self.course, len(self)
        end = count * PER_S + 1
        out = np.empty((count, CHANNELS))
        angle = summed(wheel_rates(course, spec), course.time_s)
        out[:, :4] = np.diff(angle[:end:PER_S], axis=0) * spec.radius_m
        out[:, 4] = window_means(gyro_reading(course, spec), count)
        antenna_path = antenna(course, spec)
        at_fix = _fix_times(spec, course)
        when = at_fix - float(spec.physics.get("gnss_latency", {}).get("latency_s", 0.0))
        window = np.floor(at_fix).astype(int)
        number = np.maximum(np.bincount(window, minlength=count)[:count], 1)

        def mean(values: Array) -> Array:
            return np.asarray(np.bincount(window, values, count)[:count] / number)

        def at(values: Array) -> Array:
            return np.interp(when, course.time_s, values)

        ve, vn, heading = at(antenna_path.east_mps), at(antenna_path.north_mps), at(course.heading)
        out[:, 5] = mean(np.hypot(ve, vn) + at(uncatalogued_speed_error(course, spec)))
        turned = np.remainder(np.arctan2(vn, ve) - heading + np.pi, 2 * np.pi) - np.pi
        out[:, 6] = mean(np.where(np.hypot(ve, vn) > 0.5, heading + turned, heading))
        out[:, 7], out[:, 8] = mean(at(antenna_path.east)), mean(at(antenna_path.north))
        return out


def window_means(values: Array, count: int) -> Array:
    """(count,) by trapezoids over each window."""
    middle = 0.5 * (values[1:] + values[:-1])
    return np.asarray(middle[: count * PER_S].reshape(count, PER_S).mean(axis=1))


def _fix_times(spec: Spec, course: Course) -> Array:
    return np.arange(0.5, float(np.floor(course.time_s[-1])), 1.0 / spec.receiver_hz)


def windows_of(course: Course, drive: Drive) -> Windows:
    """The windows of a drive along this course (at 50 Hz)."""
    spec, slow = drive.spec, course.every(5)
    count = int((len(slow.time_s) - 1) // PER_S)

    def mean(values: Array) -> Array:
        return window_means(values, count)

    covariates = {
        "speed": mean(slow.speed),
        "accel_long": mean(slow.force),
        "accel_lat": mean(slow.a_lat),
        "yaw_rate": mean(slow.yaw),
        "steering": mean(15.0 * np.arctan(spec.wheelbase_m * slow.bend)),
        "grade": mean(slow.grade),
        "time": np.arange(count) + 0.5,
        "distance": mean(summed(slow.speed, slow.time_s)),
    }
    covariates["steering_rate"] = np.gradient(covariates["steering"])
    fixes = np.bincount(np.floor(drive.fix_true_s).astype(int), minlength=count)[:count].astype(float)
    usable = (covariates["speed"] > MIN_SPEED_MPS) & (mean(np.abs(slow.yaw)) < MAX_YAW_RADPS)
    read = np.repeat(usable[:, None], CHANNELS, axis=1)
    read[:, 4] &= spec.with_gyro
    read[:, 5:] &= (fixes > 0)[:, None]
    read[:, 6] &= spec.with_course
    plain = replace(spec, physics={})
    # at standstill the front wheels' geometry is singular; those windows are not read
    moving = replace(slow, speed=np.maximum(slow.speed, 1.0))
    more = replace(moving, yaw=slow.yaw + 1e-4, hubs=None)
    per_yaw = (hub_speeds(more, plain) - hub_speeds(replace(moving, hubs=None), plain)) / 1e-4
    return Windows(
        course=slow,
        spec=spec,
        read=read,
        fixes=fixes,
        covariates=covariates,
        yaw_of_distance=np.stack([mean(per_yaw[:, k]) for k in range(4)], axis=1),
        sin=mean(np.sin(slow.heading)),
        cos=mean(np.cos(slow.heading)),
    )
