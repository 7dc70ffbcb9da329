"""A drive of a multi-body car with slipping tyres on a course of 2.2 km with a dozen bends at 60 km/h.

In: nothing. Out: `CourseTruth`. The car is the multi-body model of CommonRoad (`commonroad-vehicle-models`,
vehicle 2: 29 states, Magic Formula tyres, roll and pitch), which shares no line with tpmsd's own physics.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2

from bench.worlds.commonroad_car import KEEP_EVERY, SPINS, STEP_S, advance, at_rest_on_springs, hub_speeds
from tpmsd.foundation.wheels import FloatArray

SPEED_MPS = 60 / 3.6
# (length of the straight before it, angle in degrees, radius): a dozen bends, left positive.
BENDS = (
    (105, 75, 75), (40, -40, 90), (55, 90, 70), (65, -55, 85), (50, 95, 70), (75, 50, 120),
    (40, -75, 75), (55, 70, 80), (85, 30, 150), (50, -65, 80), (40, 80, 70), (65, 35, 110),
)  # fmt: skip


@dataclass(frozen=True)
class CourseTruth:
    """At 100 Hz; arrays (n,) or (n, 4)."""

    time_s: FloatArray
    east_m: FloatArray
    """Middle of the rear axle."""
    north_m: FloatArray
    heading_rad: FloatArray
    yaw_rate_radps: FloatArray
    accel_long_mps2: FloatArray
    accel_lat_mps2: FloatArray
    angle_rad: FloatArray
    """(n, 4) turned by fl, fr, rl, rr."""
    hub_path_m: FloatArray
    """(n, 4) rolled by each wheel's hub."""
    track_front_m: float
    track_rear_m: float
    wheelbase_m: float
    radius_m: float


def drive(length_m: float = 2200.0) -> CourseTruth:
    """Drive the course once: steering by preview, speed held."""
    p = parameters_vehicle2()
    curvature = _curvature(length_m)
    x = at_rest_on_springs(SPEED_MPS, p)
    rows: list[list[float]] = []
    angle, path = np.zeros(4), np.zeros(4)
    distance = heading_error = 0.0
    target_heading = 0.0
    step = 0
    while distance < length_m:
        speed = math.hypot(x[3], x[10])
        kappa = float(np.interp(distance + 0.35 * speed, curvature[0], curvature[1]))
        target_heading += float(np.interp(distance, curvature[0], curvature[1])) * speed * STEP_S
        heading_error = target_heading - (x[4] + math.atan2(x[10], x[3]))
        wanted = math.atan((p.a + p.b) * kappa) + 0.0012 * kappa * speed**2 + 0.35 * heading_error
        steer_rate = float(np.clip(12.0 * (wanted - x[2]), -0.4, 0.4))
        pull = float(np.clip(1.5 * (SPEED_MPS - x[3]) + 0.15, -3.0, 3.0))
        before = x
        x, rates = advance(before, [steer_rate, pull], STEP_S, p)
        if step % KEEP_EVERY == 0:
            rows.append(_row(step * STEP_S, before, rates, angle, path, p))
        angle = angle + STEP_S * np.array([x[k] for k in SPINS])
        path = path + STEP_S * hub_speeds(x[2], x[3], x[10], x[5], p)
        distance += speed * STEP_S
        step += 1
    table = np.array(rows)
    return CourseTruth(*table[:, :7].T, table[:, 7:11], table[:, 11:15], p.T_f, p.T_r, p.a + p.b, p.R_w)


def _row(
    time_s: float, x: list[float], rates: list[float], angle: FloatArray, path: FloatArray, p: Any
) -> list[float]:
    back = p.b
    accel_long = rates[3] - x[10] * x[5]
    accel_lat = rates[10] + x[3] * x[5]
    place = (x[0] - back * math.cos(x[4]), x[1] - back * math.sin(x[4]))
    return [time_s, *place, x[4], x[5], accel_long, accel_lat, *angle, *path]


def _curvature(length_m: float) -> tuple[FloatArray, FloatArray]:
    """Knots of way and curvature, clothoids of 25 m at both ends of a bend."""
    knots, values, at = [0.0], [0.0], 0.0
    for straight, degrees, radius in BENDS:
        arc = math.radians(abs(degrees)) * radius
        ramp = min(25.0, arc / 2)
        kappa = math.copysign(1 / radius, degrees)
        knots += [at + straight, at + straight + ramp, at + straight + arc, at + straight + arc + ramp]
        values += [0.0, kappa, kappa, 0.0]
        at += straight + arc + ramp
    knots.append(max(at, length_m) + 500.0)
    values.append(0.0)
    return np.array(knots), np.array(values)
