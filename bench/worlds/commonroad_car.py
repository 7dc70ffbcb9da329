"""The multi-body car of CommonRoad, driven by a function: the truth that the vehicle-state benchmark uses.

In: a driver, called a hundred times a second. Out: `Run`, at 100 Hz. The cars are those of
`commonroad-vehicle-models` (29 states, roll and pitch, load transfer, compliant axles, Magic Formula tyres
with combined slip, spinning wheels): 1 a Ford Escort (front-driven), 2 a BMW 320i and 3 a VW Vanagon (both
rear-driven). They share no line with tpmsd's own physics.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from vehiclemodels.init_mb import init_mb
from vehiclemodels.parameters_vehicle1 import parameters_vehicle1
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.parameters_vehicle3 import parameters_vehicle3
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

from tpmsd.foundation.wheels import FloatArray

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


def at_rest_on_springs(speed_mps: float, p: Any) -> list[float]:
    """The library's state of a car that drives straight at a speed."""
    return [float(value) for value in init_mb([0.0, 0.0, 0.0, speed_mps, 0.0, 0.0, 0.0], p)]


def advance(
    state: list[float], control: list[float], step_s: float, p: Any
) -> tuple[list[float], list[float]]:
    """State after a step by the midpoint rule, and its rate before; control: steering rate, acceleration."""
    first = vehicle_dynamics_mb(list(state), list(control), p)
    middle = [x + 0.5 * step_s * f for x, f in zip(state, first, strict=True)]
    rate = vehicle_dynamics_mb(middle, list(control), p)
    return [x + step_s * f for x, f in zip(state, rate, strict=True)], first


def hub_speeds(steer: Any, forward: Any, across: Any, yaw: Any, p: Any) -> FloatArray:
    """(..., 4) speeds of the hubs of fl, fr, rl, rr along their rolling direction.

    The library's axes have z down, y right and "left" wheels on the left; here they are read as z up, y
    left, so that its left wheels are ours of the right. The car is symmetric.
    """
    front = (across + p.a * yaw) * np.sin(steer)
    out = [(forward + side * yaw * p.T_f / 2) * np.cos(steer) + front for side in (-1.0, 1.0)]
    return np.stack([*out, forward - yaw * p.T_r / 2, forward + yaw * p.T_r / 2], axis=-1)


SPINS = [24, 23, 26, 25]
"""Where the wheels' turning rates stand in the library's state, in the order fl, fr, rl, rr."""


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
    x = at_rest_on_springs(speed_mps, p)
    angle, path = np.zeros(4), np.zeros(4)
    rows = []
    steer = pull = 0.0
    for step in range(round(duration_s / STEP_S) + 1):
        if step % KEEP_EVERY == 0:
            steer, pull = driver(Now(step * STEP_S, x[0], x[1], x[4], x[3], x[10], x[5]))
        before = x
        x, rate = advance(before, [STEER_SERVO_PER_S * (steer - before[2]), pull], STEP_S, p)
        if step % KEEP_EVERY == 0:
            accel_long, accel_lat = rate[3] - before[10] * before[5], rate[10] + before[3] * before[5]
            head = [step * STEP_S, *(before[k] for k in (0, 1, 4, 10, 3, 5, 2))]
            rows.append([*head, accel_long, accel_lat, -before[6], before[8], *angle, *path])
        angle = angle + STEP_S * np.array([x[k] for k in SPINS])
        path = path + STEP_S * hub_speeds(x[2], x[3], x[10], x[5], p)
    table = np.array(rows)
    plain = len(fields(Run)) - 2
    return Run(*table[:, :plain].T, table[:, plain : plain + 4], table[:, plain + 4 :])
