"""How a car moved, whatever world moved it.

In: arrays. Out: `Course`, and what concealed physics makes of it: turning rates of the wheels, the gyro's
reading, the antenna's trajectory. Equations are written from the public table of effects alone; noise is
added elsewhere.

Frames: x forward, y left, z up; yaw rate and lateral acceleration positive to the left. Wheels: fl fr rl
rr.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.worlds import causes
from bench.worlds.causes import DRIVEN, LEFT
from bench.worlds.motion import Array, Course, summed
from bench.worlds.spec import Spec

__all__ = ["Array", "Course", "summed"]

SPIN_RISE_S = 0.5
WHEEL_NAMES = ("fl", "fr", "rl", "rr")
FRONT = np.array([1.0, 1.0, -1.0, -1.0])


def rigid(
    time_s: Array, speed: Array, bend: Array, slope: Array, heading: float, side_slip: float = 0.0
) -> Course:
    """A rigid car on a road of that curvature and slope, from that heading; `side_slip` is minus the rear
    axle's course against the heading, per lateral acceleration."""
    yaw = speed * bend
    a_lat = speed * yaw
    return Course(
        time_s=time_s,
        speed=speed,
        yaw=yaw,
        grade=np.arctan(slope),
        heading=heading + summed(yaw, time_s),
        accel=np.gradient(speed, float(time_s[1] - time_s[0])),
        a_lat=a_lat,
        bend=bend,
        beta=-side_slip * a_lat,
    )


def value(spec: Spec, name: str, key: str, default: float = 0.0) -> float:
    """A number of the concealed physics."""
    return float(spec.physics.get(name, {}).get(key, default))


def axle_course(course: Course, spec: Spec) -> Array:
    """The rear axle's course minus the heading."""
    drift = course.beta - value(spec, "lateral_slip", "coefficient") * course.a_lat
    return np.asarray(drift + causes.rear_angle(course, spec))


def hub_speeds(course: Course, spec: Spec) -> Array:
    """(n, 4) of the hubs along the wheels' planes."""
    v, yaw = course.speed, course.yaw
    more = {side: value(spec, "track_width_error", side) for side in ("front_m", "rear_m")}
    if course.hubs is not None:
        wider = 0.5 * np.array([-more["front_m"], more["front_m"], -more["rear_m"], more["rear_m"]])
        return np.asarray(course.hubs + yaw[:, None] * wider)
    front, rear = spec.track_front_m + more["front_m"], spec.track_rear_m + more["rear_m"]
    sideways = v * np.tan(axle_course(course, spec))
    out = np.empty((len(v), 4))
    out[:, 2], out[:, 3] = v - 0.5 * rear * yaw, v + 0.5 * rear * yaw
    for k, side in ((0, -0.5), (1, 0.5)):
        out[:, k] = np.hypot(v + side * front * yaw, sideways + spec.wheelbase_m * yaw)
    return out


def radii(course: Course, spec: Spec) -> Array:
    """(n, 4) change of the rolling radii by the concealed physics."""
    t, v, a_lat = course.time_s, course.speed, course.a_lat
    out = causes.radius_change(course, spec)
    out += value(spec, "centrifugal_growth", "coefficient") * v[:, None] ** 2
    if "thermal_growth" in spec.physics:
        tau = value(spec, "thermal_growth", "time_constant_s", 600.0)
        out += value(spec, "thermal_growth", "amplitude_m") * (1 - np.exp(-t / tau))[:, None]
    out += value(spec, "load_transfer_longitudinal", "coefficient") * course.force[:, None] * FRONT
    out += value(spec, "load_transfer_lateral", "coefficient") * a_lat[:, None] * LEFT
    for name, p in spec.physics.items():
        if name.startswith("radius_change"):
            long = max(float(p.get("duration_s", 0.0)), 1e-9)
            share = np.clip((t - float(p["onset_s"])) / long, 0.0, 1.0)
            out[:, WHEEL_NAMES.index(p["wheel"])] += float(p["deviation_m"]) * share
        elif name.startswith("strange"):
            change = uncatalogued_radius_change(name, p, course)
            if change is not None:
                out[:, p["wheels"]] += change[:, None]
    return out


def uncatalogued_radius_change(name: str, p: dict[str, Any], course: Course) -> Array | None:
    """Change of radius by physics of no catalogue; None where it acts elsewhere."""
    t, v = course.time_s, course.speed
    if name == "strange_speed_hump":  # a resonance: one axle shrinks around a certain speed
        return np.asarray(p["size_m"] * np.exp(-0.5 * ((v - p["at_mps"]) / p["width_mps"]) ** 2))
    if name == "strange_speed_step":  # an axle that goes over from one radius to another at a certain speed
        return np.asarray(p["size_m"] * np.tanh((v - p["at_mps"]) / p["width_mps"]))
    if name == "strange_camber":  # one wheel answers to the size of the bend, not its sign
        return np.asarray(p["size_m"] * np.minimum(np.abs(course.a_lat) / 2.0, 1.5))
    if name == "strange_span":  # a wheel that is off for a while and comes back
        return np.asarray(p["size_m"] * ((t > p["from_s"]) & (t < p["to_s"])))
    if name == "strange_effort":  # an axle that answers to the square of the pull
        return np.asarray(p["size_m"] * np.minimum((course.force / 1.5) ** 2, 3.0))
    if name == "strange_brake_heat":  # brakes warm an axle, which cools down again
        step = float(t[1] - t[0])
        heat = decayed(np.maximum(-course.force, 0.0) * v, step / p["cooling_s"])
        return np.asarray(p["size_m"] * heat / max(float(heat.max()), 1e-9))
    return None


def decayed(values: Array, share: float) -> Array:
    """A leaky integral."""
    from scipy.signal import lfilter

    return np.asarray(lfilter([share], [1.0, share - 1.0], values))


def wheel_rates(course: Course, spec: Spec, own: Array | float = 0.0) -> Array:
    """(n, 4) turning rates in rad/s; `own` (n, 4) or (4,) is added to the radius of the specification."""
    slip = value(spec, "longitudinal_slip", "slip_per_accel") * course.force
    slip = slip + value(spec, "longitudinal_slip", "slip_per_speed2") * course.speed**2
    share = 1.0 + slip[:, None] * DRIVEN[spec.driven] + causes.slip(course, spec)
    share += 0.5 * value(spec, "drive_split", "difference") * course.force[:, None] * FRONT
    if course.spin is not None:
        share = share * (1.0 + course.spin)
    if "wheel_spin" in spec.physics:  # an axle on ice, for a while
        p = spec.physics["wheel_spin"]
        since = course.time_s - p["onset_s"]
        acting = np.clip(np.minimum(since, p["duration_s"] - since) / SPIN_RISE_S, 0.0, 1.0)
        wheels = np.isin(np.arange(4), p["wheels"])
        share = share * (1.0 + p["slip"] * acting[:, None] * wheels)
    rates = hub_speeds(course, spec) * share / (spec.radius_m + own + radii(course, spec))
    return causes.shown_rates(rates, course, spec)


def gyro_reading(course: Course, spec: Spec) -> Array:
    """(n,) what a gyro without noise reads."""
    out = course.yaw * value(spec, "yaw_rate_scale", "scale", 1.0) + value(spec, "yaw_rate_bias", "bias")
    if "strange_gyro_warming" in spec.physics:  # a bias that goes as the car warms up
        p = spec.physics["strange_gyro_warming"]
        out = out + p["size_radps"] * np.exp(-course.time_s / p["warming_s"])
    if "strange_gyro_square" in spec.physics:  # an element that gives way at high rates
        out = out + spec.physics["strange_gyro_square"]["per_rad"] * course.yaw**2
    return np.asarray(out + causes.gyro_error(course, spec))


@dataclass(frozen=True)
class Antenna:
    """The antenna's way and velocity over the course's instants."""

    east: Array
    north: Array
    up: Array
    east_mps: Array
    north_mps: Array


def antenna(course: Course, spec: Spec) -> Antenna:
    """Where the antenna went."""
    arm = spec.physics.get("antenna_lever_arm", {})
    ahead = spec.antenna_forward_m + float(arm.get("forward_m", 0.0))
    left = spec.antenna_left_m + float(arm.get("left_m", 0.0))
    along = course.speed if "no_shortening" in spec.physics else course.speed * np.cos(course.grade)
    across = along * np.tan(axle_course(course, spec))
    cos, sin = np.cos(course.heading), np.sin(course.heading)
    vx, vy = along - course.yaw * left, across + course.yaw * ahead
    t = course.time_s
    east_mps, north_mps = causes.received_velocity(vx * cos - vy * sin, vx * sin + vy * cos, course, spec)
    return Antenna(
        east=summed(along * cos - across * sin, t) + ahead * cos - left * sin,
        north=summed(along * sin + across * cos, t) + ahead * sin + left * cos,
        up=summed(course.speed * np.sin(course.grade), t),
        east_mps=east_mps,
        north_mps=north_mps,
    )


def uncatalogued_speed_error(course: Course, spec: Spec) -> Array:
    """(n,) error of the receiver's speed by physics of no catalogue."""
    out = np.zeros(len(course.time_s))
    if "strange_heading_glitch" in spec.physics:  # a receiver that errs while the car faces one way
        p = spec.physics["strange_heading_glitch"]
        out += p["size_mps"] * (np.cos(course.heading - p["towards_rad"]) > 0.3)
    if "strange_doppler_bend" in spec.physics:  # a loop that lags in bends
        p = spec.physics["strange_doppler_bend"]
        out += p["size_mps"] * np.minimum(np.abs(course.yaw) / 0.1, 2.0)
    return out
