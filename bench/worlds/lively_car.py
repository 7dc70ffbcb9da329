"""Cars of vehicle dynamics with concealed physics: the worlds that the diagnosis of vehicle dynamics is held
against.

In: `CarSpec`, what is concealed, a generator. Out: columns of a `signals.csv` and the tables of a
`vehicle.toml`. Scalar equations in steps of a millisecond (Heun's rule), written from the text books
without any code of the program: the linear single-track car, and four wheels with Dugoff's tyres whose slip
carries the forces.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bench.worlds.lively_body import STEP_S, Array, Body, CarSpec, Concealed, SensorSpec

__all__ = ["CarSpec", "Concealed", "Drive", "SensorSpec", "course", "drive", "vehicle_tables"]


@dataclass(frozen=True)
class Drive:
    """Columns by name, and what was concealed."""

    columns: dict[str, Array]
    truth: dict[str, dict[str, float]]


def course(duration_s: float, rng: np.random.Generator, max_lat: float = 7.0) -> tuple[Array, Array]:
    """Return road-wheel angle and speed every millisecond: bends, lane changes, weaving, braking, pulling
    away."""
    n = round(duration_s / STEP_S)
    t = np.arange(n) * STEP_S
    knots = np.arange(0.0, duration_s + 12.0, 6.0)
    target = rng.uniform(9.0, 31.0, len(knots))
    speed = np.interp(t, knots, target)
    speed = _smooth(_smooth(speed, 1.5), 1.5)
    lat = np.zeros(n)
    at = 1.0
    while at < duration_s - 4.0:
        kind = rng.integers(4)
        size = rng.uniform(0.3, 1.0) * max_lat * rng.choice([-1.0, 1.0])
        length = rng.uniform(1.5, 5.0)
        rows = (t >= at) & (t < at + length)
        phase = (t[rows] - at) / length
        if kind == 0:
            lat[rows] += size * np.sin(math.pi * phase) ** 2
        elif kind == 1:
            lat[rows] += size * np.sin(2.0 * math.pi * phase)
        elif kind == 2:
            lat[rows] += 0.5 * size * np.sin(2.0 * math.pi * phase * rng.integers(2, 5))
        at += length + rng.exponential(0.7)
    lat = _smooth(lat, 0.12)
    steer = lat * (2.64 / np.maximum(speed, 5.0) ** 2 + 0.0012) + 0.0006 * _smooth(
        rng.standard_normal(n) * 20, 0.3
    )
    return steer, speed


def _smooth(x: Array, time_s: float) -> Array:
    """Return x through a moving mean of second order."""
    k = max(round(time_s / STEP_S), 1)
    kernel = np.ones(k) / k
    for _ in range(2):
        x = np.convolve(np.pad(x, (k, k), mode="edge"), kernel, mode="same")[k:-k]
    return x


def drive(
    car: CarSpec,
    concealed: Concealed,
    rng: np.random.Generator,
    model: str = "single-track",
    duration_s: float = 300.0,
    sensors: SensorSpec | None = None,
    forces: bool = False,
    max_lat: float = 7.0,
) -> Drive:
    """Return a recorded drive of `model` (single-track or three-dof) with these effects."""
    sensors = SensorSpec() if sensors is None else sensors
    steer, speed = course(duration_s, rng, max_lat)
    delay = round(concealed.get("steering_delay", "delay_s") / STEP_S)
    ratio = concealed.get("steering_ratio_error", "ratio", 1.0)
    zero = concealed.get("steering_offset", "offset_rad")
    # what is read is planned; what the wheels do follows from it
    acting = np.roll(steer, delay) if delay else steer
    acting = (acting - zero / car.ratio) / ratio
    body = Body(car, concealed, model, forces)
    truth = body.run(acting, speed)
    return Drive(
        _recorded(car, concealed, sensors, steer, truth, forces, rng),
        {k: dict(v) for k, v in concealed.values.items()},
    )


def _recorded(
    car: CarSpec,
    concealed: Concealed,
    sensors: SensorSpec,
    steer: Array,
    truth: Mapping[str, Array],
    forces: bool,
    rng: np.random.Generator,
) -> dict[str, Array]:
    """Return what the instruments write down."""
    every = round(1.0 / (sensors.rate_hz * STEP_S))
    n = len(steer)
    late = round(concealed.get("gyro_delay", "delay_s") / STEP_S)
    yaw = np.roll(truth["r"], late) * concealed.get("yaw_rate_scale", "scale", 1.0)
    yaw = yaw + concealed.get("yaw_rate_bias", "bias")
    ahead = concealed.get("accelerometer_position", "forward_m")
    turn = concealed.get("accelerometer_tilt", "yaw_rad")
    across = truth["ay"] + ahead * truth["r_rate"]
    along = truth["ax"] - ahead * truth["r"] ** 2
    ay = across - turn * along + concealed.get("accelerometer_bias", "lat_mps2")
    ax = along + turn * across + concealed.get("accelerometer_bias", "long_mps2")
    rows = np.arange(max(late, 0), n, every)

    def noisy(values: Array, std: float) -> Array:
        return values[rows] + std * rng.standard_normal(len(rows))

    columns = {
        "time_s": rows * STEP_S,
        "steering_wheel_angle_rad": car.ratio * steer[rows],
        "yaw_rate_radps": noisy(yaw, sensors.yaw),
        "accel_lat_mps2": noisy(ay, sensors.ay),
        "velocity_lat_mps": noisy(truth["v"], sensors.v),
        "accel_long_mps2": noisy(ax, sensors.ax),
        "speed_mps": noisy(truth["u"], sensors.u),
    }
    if not forces:
        columns["speed_mps"] = truth["u"][rows]
    else:
        columns["drive_force_n"] = truth["drive"][rows]
        columns["brake_force_n"] = truth["brake"][rows]
    return columns


def vehicle_tables(car: CarSpec) -> str:
    """Return the text of the car's vehicle.toml."""
    return f"""[vehicle]
wheel_radius_m = 0.316
track_front_m = {car.tf}
track_rear_m = {car.tr}
wheelbase_m = {car.a + car.b}
driven_axle = "{car.driven}"
steering_ratio = {car.ratio}

[dynamics]
mass_kg = {car.m}
yaw_inertia_kgm2 = {car.iz}
cg_to_front_m = {car.a}
cg_to_rear_m = {car.b}
cg_height_m = {car.h}
cornering_stiffness_front_n_per_rad = {car.cf}
cornering_stiffness_rear_n_per_rad = {car.cr}
longitudinal_stiffness_n = {car.cx}
friction = {car.mu}
brake_front_share = {car.brake_front}
"""
