"""What counters, gyro, accelerometers and receiver saw of a course.

In: `Course`, `Spec`, a seed. Out: `Drive`. All noise is added here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from bench.worlds import causes
from bench.worlds.course import Course, antenna, gyro_reading, summed, uncatalogued_speed_error, wheel_rates
from bench.worlds.spec import Spec

Array = NDArray[np.float64]
WHEELS = ("fl", "fr", "rl", "rr")
START_S = 1_719_820_800.0
STEERING_RATIO = 15.0


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
    temperature_k: Array
    fix_true_s: Array
    fix_age_s: float
    fix_east: Array
    fix_north: Array
    fix_up: Array
    fix_speed: Array
    fix_course_math: Array
    radius_m: Array = field(default_factory=lambda: np.full(4, math.nan))
    """(4,) the wheels' true radii, but for what `Spec.physics` adds."""
    fix_lag_s: Array = field(default_factory=lambda: np.zeros(0))
    """(m,) delay of each sentence on its way, beyond the age."""
    seed: int = 0
    start_s: float = START_S
    """UTC of the drive's beginning."""

    def counts(self) -> NDArray[np.int64]:
        """(n, 4) edges counted by each wheel at the samples of 20 ms."""
        return self.counted(self.shown_rad)

    def counted(self, shown_rad: Array) -> NDArray[np.int64]:
        """Edges counted at other instants."""
        return np.floor(shown_rad * self.spec.teeth / (2 * math.pi)).astype(np.int64)


def markov(rng: np.random.Generator, n: int, dt: float, std: float, tau: float) -> Array:
    """A stationary first-order process."""
    a = math.exp(-dt / tau)
    kicks = rng.standard_normal(n) * std * math.sqrt(1 - a * a)
    kicks[0] = rng.standard_normal() * std
    return np.asarray(lfilter([1.0], [1.0, -a], kicks))


@dataclass(frozen=True)
class Errors:
    """Where an instrument's errors come from, instead of the first-order processes of `observe`."""

    receiver: Callable[[Array, Array, Array, np.random.Generator], tuple[Array, Array]] | None = None
    """Times, speeds and headings of fixes (m,) to errors (m, 2) of east and north and of their rates."""
    gyro: Callable[[int, float, np.random.Generator], Array] | None = None
    """Number of samples and step to errors of the yaw rate."""


PLAIN = Errors()


def observe(course: Course, spec: Spec, rng: np.random.Generator, seed: int, errors: Errors = PLAIN) -> Drive:
    """Let the instruments see it. `seed` is of the noise that was not always there."""
    more = np.random.default_rng([seed, 2])
    t, speed = course.time_s, course.speed
    n, step = len(t), float(t[1] - t[0])
    offset = spec.radius_spread_m * rng.standard_normal(4)
    radius_drift = np.zeros((n, 4))
    if spec.radius_drift > 0.0:
        for k in range(4):
            radius_drift[:, k] = spec.radius_m * markov(
                more, n, step, spec.radius_drift, spec.radius_drift_tau_s
            )
    rate = wheel_rates(course, spec, offset + radius_drift)
    distance_noise = (
        rng.standard_normal((n, 4)) * spec.rough * np.sqrt(np.maximum(speed, 0.0) * step)[:, None]
    )
    angle = summed(rate, t) + np.cumsum(distance_noise / spec.radius_m, axis=0) + rng.uniform(0, 6, 4)
    if "tone_ring_error" in spec.physics:
        p = spec.physics["tone_ring_error"]
        k = WHEELS.index(p["wheel"])
        angle[:, k] += float(p["amplitude_rad"]) * np.sin(angle[:, k] + float(p.get("phase_rad", 0.7)))
    angle = angle + causes.ring_error(angle, spec) + causes.pulse_scatter(course, spec, more)
    if spec.frame_jitter_s > 0:
        late = rng.exponential(spec.frame_jitter_s, n)
        if spec.wheel_signal == "counts":  # speeds are made of edges, before the frame is late
            angle = angle - rate * late[:, None]  # the stamp is later than the sample
    gyro = gyro_reading(course, spec) + rng.normal(0, spec.gyro_std, n)
    gyro = gyro + np.cumsum(rng.normal(0, spec.gyro_drift * step**0.5, n))
    if errors.gyro is not None:
        gyro = gyro_reading(course, spec) + errors.gyro(n, step, more)
    if spec.blind_below_mps > 0.0:
        blind = np.abs(rate) * spec.radius_m < spec.blind_below_mps
        moved = np.diff(angle, axis=0, prepend=angle[:1])
        angle = angle[0] + np.cumsum(np.where(blind, 0.0, moved), axis=0)
    return _received(course, spec, rng, more, angle, gyro, spec.radius_m + offset, seed, errors)


def felt(course: Course, spec: Spec, rng: np.random.Generator) -> dict[str, Array]:
    """The motion itself, and what accelerometers and the steering wheel's sensor make of it."""
    n = len(course.time_s)
    along, across = causes.accelerations(course, spec)
    return {
        "time_s": course.time_s,
        "speed": course.speed,
        "yaw_rate": course.yaw,
        "grade": course.grade,
        "accel_long": along + rng.normal(0, spec.accel_std, n),
        "accel_lat": across + rng.normal(0, spec.accel_std, n),
        "temperature_k": causes.ambient_k(course, spec),
        "steering_wheel": causes.steering_wheel(course, spec, STEERING_RATIO) + rng.normal(0, 0.01, n),
    }


def _received(
    course: Course,
    spec: Spec,
    rng: np.random.Generator,
    more: np.random.Generator,
    angle: Array,
    gyro: Array,
    radius_m: Array,
    seed: int,
    errors: Errors,
) -> Drive:
    t, antenna_path = course.time_s, antenna(course, spec)
    period = 1.0 / spec.receiver_hz
    fix = np.arange(0.5, t[-1] - 0.5, period)
    m = len(fix)
    slow = [markov(rng, m, period, spec.position_slow_m * f, spec.position_tau_s) for f in (1.0, 1.0, 1.8)]
    white = rng.normal(0, spec.position_white_m, (m, 3))
    doppler = [markov(rng, m, period, spec.doppler_mps, spec.doppler_tau_s) for _ in range(2)]
    noisy, place = bursts(spec, fix, more)
    when = fix - spec.doppler_age_s

    def at(values: Array, times: Array) -> Array:
        return np.interp(times, t, values)

    shaken = np.stack([doppler[0] * noisy, doppler[1] * noisy], axis=1)
    if errors.receiver is not None:
        jumps, shaken = errors.receiver(fix, at(course.speed, fix), at(course.heading, fix), more)
        white[:, :2] = jumps
    me = at(antenna_path.east_mps, when) + shaken[:, 0]
    mn = at(antenna_path.north_mps, when) + shaken[:, 1]
    course_math = np.arctan2(mn, me)
    fast = np.hypot(me, mn)
    course_math[fast < 1.0] = np.nan
    if not spec.with_course:
        course_math[:] = np.nan
    kept = np.ones(m, dtype=bool)
    for begin in _moments(spec.outages_per_hour, t[-1], more):
        kept &= ~((fix > begin) & (fix < begin + float(more.uniform(5.0, spec.longest_outage_s))))
    lag = more.exponential(spec.arrival_jitter_s, m) if spec.arrival_jitter_s > 0 else np.zeros(m)
    return Drive(
        spec=spec,
        shown_rad=angle,
        gyro=gyro,
        **felt(course, spec, rng),
        fix_true_s=fix[kept],
        fix_age_s=float(spec.physics.get("gnss_latency", {}).get("latency_s", 0.0)),
        fix_east=(at(antenna_path.east, fix) + slow[0] + white[:, 0] + place[:, 0])[kept],
        fix_north=(at(antenna_path.north, fix) + slow[1] + white[:, 1] + place[:, 1])[kept],
        fix_up=(at(antenna_path.up, fix) + slow[2] + white[:, 2])[kept],
        fix_speed=np.maximum(fast + at(uncatalogued_speed_error(course, spec), when), 0.0)[kept],
        fix_course_math=course_math[kept],
        radius_m=radius_m,
        fix_lag_s=lag[kept],
        seed=seed,
    )


def bursts(spec: Spec, fix: Array, more: np.random.Generator) -> tuple[Array, Array]:
    """(m,) factor on the Doppler noise and (m, 2) error of the place, by reflections."""
    noisy, place = np.ones(len(fix)), np.zeros((len(fix), 2))
    for begin in _moments(spec.bursts_per_hour, float(fix[-1]), more):
        long = float(more.uniform(8.0, 30.0))
        inside = (fix > begin) & (fix < begin + long)
        noisy[inside] *= float(more.uniform(2.0, 5.0))
        swell = np.sin(np.pi * np.clip((fix - begin) / long, 0.0, 1.0)) ** 2
        place += swell[:, None] * more.normal(0.0, 4.0, 2)
    return noisy, place


def _moments(per_hour: float, end_s: float, more: np.random.Generator) -> list[float]:
    if per_hour <= 0.0:
        return []
    return sorted(float(t) for t in more.uniform(0.0, end_s, more.poisson(per_hour * end_s / 3600.0)))
