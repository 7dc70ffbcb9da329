"""The multi-body car of CommonRoad, driven by a function: the truth that the vehicle-state benchmark uses.

In: a driver, called a hundred times a second. Out: `Run`, at 100 Hz. The cars are those of
`commonroad-vehicle-models` (29 states, roll and pitch, load transfer, compliant axles, Magic Formula tyres
with combined slip, spinning wheels): 1 a Ford Escort (front-driven), 2 a BMW 320i and 3 a VW Vanagon (both
rear-driven). They share no line with tpmsd's own physics.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from vehiclemodels.init_mb import init_mb
from vehiclemodels.parameters_vehicle1 import parameters_vehicle1
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.parameters_vehicle3 import parameters_vehicle3
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

from tpmsd.wheels import FloatArray

STEP_S = 1e-3
KEEP_EVERY = 10
DT_S = STEP_S * KEEP_EVERY
GRAVITY_MPS2 = 9.81
STEER_SERVO_PER_S = 25.0
MAX_STEER_RATE_RADPS = 1.2


_CARS = {1: parameters_vehicle1, 2: parameters_vehicle2, 3: parameters_vehicle3}


def parameters(car: int = 2, friction: float = 1.0, slip_stiffness: float = 1.0) -> Any:
    """A car's parameters; the steering is let turn faster than the library's planner does (0.4 rad/s).

    `friction` scales the tyres' largest forces (0.6: a wet road), `slip_stiffness` their longitudinal slip
    stiffness: the library has one tyre for all its cars.
    """
    p = _CARS[car]()
    p.steering.v_min, p.steering.v_max = -MAX_STEER_RATE_RADPS, MAX_STEER_RATE_RADPS
    p.tire.p_dx1 *= friction
    p.tire.p_dy1 *= friction
    p.tire.p_kx1 *= slip_stiffness
    return p


def rolling_radius_m(p: Any) -> FloatArray:
    """(4,) hub path per angle of wheels at static load that carry no longitudinal force.

    The tyre formula's shifts make that a little more or less than its R_w.
    """
    front, rear = p.m_s * p.b / (p.a + p.b) + p.m_uf, p.m_s * p.a / (p.a + p.b) + p.m_ur
    load = GRAVITY_MPS2 / 2 * np.array([front, front, rear, rear])
    slip = p.tire.p_hx1 + p.tire.p_vx1 * load * p.tire.p_dx1 / p.tire.p_kx1
    return np.asarray(p.R_w / (1.0 - slip))


@dataclass(frozen=True)
class Now:
    """What a driver sees."""

    time_s: float
    east_m: float
    north_m: float
    heading_rad: float
    forward_mps: float
    left_mps: float
    yaw_rate_radps: float


Driver = Callable[[Now], tuple[float, float]]
"""Wanted angle of the road wheels and wanted longitudinal acceleration."""


@dataclass(frozen=True)
class Run:
    """The truth at 100 Hz; arrays (n,), those of wheels (n, 4) in the order fl fr rl rr."""

    time_s: FloatArray
    east_m: FloatArray
    """Centre of gravity."""
    north_m: FloatArray
    heading_rad: FloatArray
    left_mps: FloatArray
    """v"""
    forward_mps: FloatArray
    """u"""
    yaw_rate_radps: FloatArray
    steer_rad: FloatArray
    accel_long_mps2: FloatArray
    accel_lat_mps2: FloatArray
    roll_rad: FloatArray
    """Leaning out of the bend, as positive where lateral acceleration is."""
    pitch_rad: FloatArray
    """Nose up when speeding up, as positive where longitudinal acceleration is."""
    angle_rad: FloatArray
    path_m: FloatArray
    """Rolled by each hub."""


def run(driver: Driver, duration_s: float, speed_mps: float, car: Any = None) -> Run:
    """Drive for so long from a straight start; `car`: of `parameters`, the default one if None."""
    p = parameters() if car is None else car
    x = np.array(init_mb([0.0, 0.0, 0.0, speed_mps, 0.0, 0.0, 0.0], p))
    angle, path = np.zeros(4), np.zeros(4)
    rows = []
    steer = pull = 0.0
    for step in range(round(duration_s / STEP_S) + 1):
        if step % KEEP_EVERY == 0:
            steer, pull = driver(Now(step * STEP_S, x[0], x[1], x[4], x[3], x[10], x[5]))
        u = [STEER_SERVO_PER_S * (steer - x[2]), pull]
        first = np.array(vehicle_dynamics_mb(x.tolist(), u, p))
        middle = np.array(vehicle_dynamics_mb((x + STEP_S / 2 * first).tolist(), u, p))
        if step % KEEP_EVERY == 0:
            accel_long, accel_lat = first[3] - x[10] * x[5], first[10] + x[3] * x[5]
            head = [step * STEP_S, x[0], x[1], x[4], x[10], x[3], x[5], x[2]]
            rows.append([*head, accel_long, accel_lat, -x[6], x[8], *angle, *path])
        x = x + STEP_S * middle
        # The model calls left what lies to the right in a frame with z up: its "left" wheels are faster in a
        # left turn. They are ours of the right.
        angle = angle + STEP_S * x[[24, 23, 26, 25]]
        path = path + STEP_S * _hub_speeds(x, p)
    table = np.array(rows)
    plain = len(fields(Run)) - 2
    return Run(*table[:, :plain].T, table[:, plain : plain + 4], table[:, plain + 4 :])


def _hub_speeds(x: FloatArray, p: Any) -> FloatArray:
    """(4,) speed of the hubs along their rolling direction."""
    front = (x[10] + p.a * x[5]) * math.sin(x[2])
    half_front, half_rear = x[5] * p.T_f / 2, x[5] * p.T_r / 2
    cos = math.cos(x[2])
    return np.array(
        [
            (x[3] - half_front) * cos + front,
            (x[3] + half_front) * cos + front,
            x[3] - half_rear,
            x[3] + half_rear,
        ]
    )
