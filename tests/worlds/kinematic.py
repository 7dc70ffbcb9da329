"""A world of its own: a car on a road, with physics written apart from the program it tests.

In: a `Spec` (car, road, receiver, concealed physics) and a seed. Out: `Drive`: what counters, gyro,
accelerometers and receiver saw. It imports nothing of the program: equations, noise and file formats are
written anew from the public description of the formats, so that a shared mistake cannot hide.

Frames: x forward, y left, z up; yaw rate and lateral acceleration positive to the left. Wheels: fl fr rl
rr.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
G = 9.80665
STEP_S = 0.02
WHEEL_NAMES = ("fl", "fr", "rl", "rr")
LEFT = np.array([1.0, -1.0, 1.0, -1.0])
FRONT = np.array([1.0, 1.0, -1.0, -1.0])


@dataclass
class Spec:
    """What is drawn for a drive."""

    duration_s: float = 1200.0
    road: str = "mixed"
    radius_m: float = 0.31
    radius_spread_m: float = 8e-4
    track_front_m: float = 1.55
    track_rear_m: float = 1.53
    wheelbase_m: float = 2.7
    driven: str = "front"
    teeth: float = 48.0
    frame_jitter_s: float = 0.0003
    receiver_hz: float = 5.0
    position_slow_m: float = 1.2
    position_tau_s: float = 40.0
    position_white_m: float = 0.2
    doppler_mps: float = 0.05
    doppler_tau_s: float = 1.0
    gyro_std: float = 0.0015
    gyro_drift: float = 2e-6
    accel_std: float = 0.04
    rough: float = 3.0e-4
    """Standard deviation of a wheel's way in metres per square root of a metre."""
    hilly: float = 0.0
    """Standard deviation of the slope."""
    antenna_forward_m: float = 0.0
    antenna_left_m: float = 0.0
    rising_speed: bool = False
    """A driver who goes faster and faster: speed is tied to time."""
    steady: bool = False
    physics: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Concealed physics by name."""


@dataclass
class Drive:
    """What the instruments saw, and the truth; arrays over n samples of 20 ms or over m fixes."""

    spec: Spec
    time_s: Array
    speed: Array
    yaw_rate: Array
    grade: Array
    shown_rad: Array
    """(n, 4) angles that the rings have shown, not yet rounded to counts."""
    gyro: Array
    accel_long: Array
    accel_lat: Array
    steering_wheel: Array
    fix_true_s: Array
    fix_age_s: float
    fix_east: Array
    fix_north: Array
    fix_up: Array
    fix_speed: Array
    fix_course_math: Array
    radius_m: Array = field(default_factory=lambda: np.full(4, math.nan))
    """(4,) the wheels' true radii, but for what `Spec.physics` adds."""

    def counts(self) -> NDArray[np.int64]:
        """(n, 4) edges counted by each wheel at the bus's samples."""
        return np.floor(self.shown_rad * self.spec.teeth / (2 * math.pi)).astype(np.int64)


def markov(rng: np.random.Generator, n: int, dt: float, std: float, tau: float) -> Array:
    """A stationary first-order process."""
    a = math.exp(-dt / tau)
    kicks = rng.standard_normal(n) * std * math.sqrt(1 - a * a)
    kicks[0] = rng.standard_normal() * std
    out = np.empty(n)
    value = 0.0
    for k in range(n):
        value = a * value + kicks[k]
        out[k] = value
    return out


def summed(rate: Array) -> Array:
    """Integral over time by trapezoids, zero at the start; along the first axis."""
    out = np.zeros_like(rate)
    out[1:] = np.cumsum(0.5 * (rate[1:] + rate[:-1]) * STEP_S, axis=0)
    return out


def draw_spec(rng: np.random.Generator, **fixed: Any) -> Spec:
    """A car, a road, a receiver and a bus drawn anew."""
    drawn: dict[str, Any] = {
        "duration_s": float(rng.uniform(900, 1500)),
        "road": str(rng.choice(["mixed", "rural", "motorway"])),
        "radius_m": float(rng.uniform(0.29, 0.35)),
        "track_front_m": float(rng.uniform(1.45, 1.65)),
        "track_rear_m": float(rng.uniform(1.45, 1.65)),
        "wheelbase_m": float(rng.uniform(2.4, 3.0)),
        "driven": str(rng.choice(["front", "rear"])),
        "teeth": float(rng.choice([44, 48, 48, 96])),
        "receiver_hz": float(rng.choice([1, 5, 10])),
        "position_slow_m": float(rng.uniform(0.6, 2.0)),
        "doppler_mps": float(rng.uniform(0.03, 0.07)),
        "doppler_tau_s": float(rng.uniform(0.5, 1.5)),
        "gyro_std": float(rng.uniform(0.001, 0.003)),
        "rough": float(rng.uniform(2e-4, 6e-4)),
    }
    return Spec(**{**drawn, **fixed})


def _profile(spec: Spec, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Speed, curvature and slope along a made-up road, over time."""
    n = round(spec.duration_s / STEP_S)
    legs = {"mixed": (9, 33), "rural": (12, 27), "motorway": (20, 38), "city": (5, 15)}[spec.road]
    target = np.empty(n)
    bend = np.zeros(n)
    k = 0
    while k < n:
        length = round(float(rng.uniform(12, 45)) / STEP_S)
        v = float(rng.uniform(*legs))
        if spec.rising_speed:
            v = legs[0] + (legs[1] - legs[0]) * k / n + float(rng.normal(0, 1.5))
        if spec.steady:
            v = 0.5 * sum(legs)
        target[k : k + length] = max(v, 4.0)
        k += length
    k = 0
    while k < n:
        length = round(float(rng.uniform(4, 18)) / STEP_S)
        if rng.random() < 0.6:
            # lateral acceleration up to 2 m/s2 at the leg's speed
            a_lat = float(rng.uniform(0.3, 2.2)) * float(rng.choice([-1, 1]))
            shape = np.sin(np.linspace(0, math.pi, min(length, n - k))) ** 2
            bend[k : k + length] = a_lat * shape / max(target[k], 6.0) ** 2
        k += length
    # a car follows its target speed with bounded acceleration and smooth jerk
    speed = np.empty(n)
    v, a = 0.0, 0.0
    up, down = float(rng.uniform(1.0, 2.0)), float(rng.uniform(1.2, 2.5))
    for k in range(n):
        want = min(max((target[k] - v) * 0.35, -down), up * max(0.15, 1 - v / 55))
        a += (want - a) * STEP_S / 0.6
        v = max(v + a * STEP_S, 0.0)
        speed[k] = v
    slope = np.zeros(n)
    if spec.hilly > 0:
        way = np.cumsum(speed) * STEP_S
        knots = np.arange(0.0, way[-1] + 800.0, 300.0)
        from scipy.interpolate import CubicSpline

        slope = np.clip(CubicSpline(knots, rng.normal(0, spec.hilly, len(knots)))(way), -0.15, 0.15)
    return speed, bend, slope


def drive(spec: Spec, seed: int) -> Drive:
    """Drive it."""
    rng = np.random.default_rng(seed)
    speed, bend, slope = _profile(spec, rng)
    n = len(speed)
    t = np.arange(n) * STEP_S
    grade = np.arctan(slope)
    # the driver never drives quite straight
    bend = bend + markov(rng, n, STEP_S, 2e-4, 3.0)
    tight = 3.2 / np.maximum(speed, 7.3) ** 2
    bend = np.clip(bend, -tight, tight)
    yaw = speed * bend
    a_x = np.gradient(speed, STEP_S)
    a_lat = speed * yaw
    force = a_x + G * np.sin(grade)
    heading = float(rng.uniform(-3, 3)) + summed(yaw)
    physics = spec.physics
    offset = spec.radius_spread_m * rng.standard_normal(4)

    def get(name: str, key: str, default: float = 0.0) -> float:
        return float(physics.get(name, {}).get(key, default))

    front_track = spec.track_front_m + get("track_width_error", "front_m")
    rear_track = spec.track_rear_m + get("track_width_error", "rear_m")
    beta = -get("lateral_slip", "coefficient") * a_lat
    sideways = speed * np.tan(beta)
    ground = np.empty((n, 4))
    ground[:, 2] = speed - 0.5 * rear_track * yaw
    ground[:, 3] = speed + 0.5 * rear_track * yaw
    for k, side in ((0, -0.5), (1, 0.5)):
        ground[:, k] = np.hypot(speed + side * front_track * yaw, sideways + spec.wheelbase_m * yaw)
    radius = np.tile(spec.radius_m + offset, (n, 1))
    radius += get("centrifugal_growth", "coefficient") * speed[:, None] ** 2
    if "thermal_growth" in physics:
        tau = get("thermal_growth", "time_constant_s", 600.0)
        radius += get("thermal_growth", "amplitude_m") * (1 - np.exp(-t / tau))[:, None]
    radius += get("load_transfer_longitudinal", "coefficient") * force[:, None] * FRONT
    radius += get("load_transfer_lateral", "coefficient") * a_lat[:, None] * LEFT
    for name in ("radius_change", "radius_change_2"):
        if name in physics:
            p = physics[name]
            long = max(float(p.get("duration_s", 0.0)), 1e-9)
            share = np.clip((t - float(p["onset_s"])) / long, 0.0, 1.0)
            radius[:, WHEEL_NAMES.index(p["wheel"])] += float(p["deviation_m"]) * share
    _strange(physics, radius, t, speed, force, a_lat, bend, spec)
    driven = {"front": [1, 1, 0, 0], "rear": [0, 0, 1, 1], "all": [1, 1, 1, 1]}[spec.driven]
    slip = get("longitudinal_slip", "slip_per_accel") * force
    slip = slip + get("longitudinal_slip", "slip_per_speed2") * speed**2
    rate = ground * (1 + slip[:, None] * np.array(driven)) / radius
    way_noise = rng.standard_normal((n, 4)) * spec.rough * np.sqrt(np.maximum(speed, 0.0) * STEP_S)[:, None]
    angle = summed(rate) + np.cumsum(way_noise / radius, axis=0) + rng.uniform(0, 6, 4)
    if "tone_ring_error" in physics:
        k = WHEEL_NAMES.index(physics["tone_ring_error"]["wheel"])
        angle[:, k] += get("tone_ring_error", "amplitude_rad") * np.sin(angle[:, k] + 0.7)
    if spec.frame_jitter_s > 0:
        late = rng.exponential(spec.frame_jitter_s, n)
        angle = angle - rate * late[:, None]  # the stamp is later than the sample
    gyro = yaw * get("yaw_rate_scale", "scale", 1.0) + get("yaw_rate_bias", "bias")
    gyro = gyro + rng.normal(0, spec.gyro_std, n) + np.cumsum(rng.normal(0, spec.gyro_drift * STEP_S**0.5, n))
    found = _receive(spec, rng, t, speed, yaw, grade, heading, beta, angle, gyro, force, a_lat, bend)
    found.radius_m = spec.radius_m + offset
    return found


def _strange(
    physics: dict[str, dict[str, Any]],
    radius: Array,
    t: Array,
    v: Array,
    a_x: Array,
    a_y: Array,
    bend: Array,
    s: Spec,
) -> None:
    """Physics of no catalogue, added to the radii in place."""
    if "strange_speed_hump" in physics:  # a resonance: one axle shrinks around a certain speed
        p = physics["strange_speed_hump"]
        hump = np.exp(-0.5 * ((v - p["at_mps"]) / p["width_mps"]) ** 2)
        radius[:, p["wheels"]] += p["size_m"] * hump[:, None]
    if "strange_camber" in physics:  # one wheel answers to the size of the steering, not its sign
        p = physics["strange_camber"]
        radius[:, p["wheels"]] += (p["size_m"] * np.minimum(np.abs(a_y) / 2.0, 1.5))[:, None]
    if "strange_span" in physics:  # a wheel that is off for a while and comes back
        p = physics["strange_span"]
        inside = (t > p["from_s"]) & (t < p["to_s"])
        radius[:, p["wheels"]] += p["size_m"] * inside[:, None]


def _receive(
    spec: Spec,
    rng: np.random.Generator,
    t: Array,
    speed: Array,
    yaw: Array,
    grade: Array,
    heading: Array,
    beta: Array,
    angle: Array,
    gyro: Array,
    force: Array,
    a_lat: Array,
    bend: Array,
) -> Drive:
    physics = spec.physics
    arm = physics.get("antenna_lever_arm", {})
    ahead = spec.antenna_forward_m + float(arm.get("forward_m", 0.0))
    left = spec.antenna_left_m + float(arm.get("left_m", 0.0))
    along = speed if "no_shortening" in physics else speed * np.cos(grade)
    vx = along - yaw * left
    vy = along * np.tan(beta) + yaw * ahead
    cos, sin = np.cos(heading), np.sin(heading)
    axle_e = summed(along * cos - along * np.tan(beta) * sin)
    axle_n = summed(along * sin + along * np.tan(beta) * cos)
    east, north = axle_e + ahead * cos - left * sin, axle_n + ahead * sin + left * cos
    ve, vn = vx * cos - vy * sin, vx * sin + vy * cos
    up = summed(speed * np.sin(grade))
    period = 1.0 / spec.receiver_hz
    fix = np.arange(0.5, t[-1] - 0.5, period)
    m = len(fix)
    slow = [markov(rng, m, period, spec.position_slow_m * f, spec.position_tau_s) for f in (1.0, 1.0, 1.8)]
    white = rng.normal(0, spec.position_white_m, (m, 3))
    doppler = [markov(rng, m, period, spec.doppler_mps, spec.doppler_tau_s) for _ in range(2)]

    def at(values: Array) -> Array:
        return np.interp(fix, t, values)

    me, mn = at(ve) + doppler[0], at(vn) + doppler[1]
    course = np.arctan2(mn, me)
    fast = np.hypot(me, mn)
    course[fast < 1.0] = np.nan
    return Drive(
        spec=spec,
        time_s=t,
        speed=speed,
        yaw_rate=yaw,
        grade=grade,
        shown_rad=angle,
        gyro=gyro,
        accel_long=force + rng.normal(0, spec.accel_std, len(t)),
        accel_lat=a_lat + rng.normal(0, spec.accel_std, len(t)),
        steering_wheel=15.0 * np.arctan(spec.wheelbase_m * bend) + rng.normal(0, 0.01, len(t)),
        fix_true_s=fix,
        fix_age_s=float(physics.get("gnss_latency", {}).get("latency_s", 0.0)),
        fix_east=at(east) + slow[0] + white[:, 0],
        fix_north=at(north) + slow[1] + white[:, 1],
        fix_up=at(up) + slow[2] + white[:, 2],
        fix_speed=fast,
        fix_course_math=course,
    )
