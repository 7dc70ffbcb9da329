"""What wheel sensors, gyro and receiver saw of a leg.

In: the course, the wheels' turning rates, the surface. Out: a `Drive` as the writer of folders takes it.
"""

from __future__ import annotations

import numpy as np

from bench.worlds.course import Course, antenna, gyro_reading, summed
from bench.worlds.instruments import Drive, felt, markov
from bench.worlds.magic_tyre import Array
from bench.worlds.spec import Spec
from bench.worlds.surfaces import Surface

PLACE_TAU_S = 4.0
"""Reflections come and go as houses pass by."""


def observe(
    course: Course,
    spec: Spec,
    rate: Array,
    surface: Surface,
    rng: np.random.Generator,
    seed: int,
    start_s: float,
) -> Drive:
    """Let the instruments see it."""
    t, speed = course.time_s, np.abs(course.speed)
    n, step = len(t), float(t[1] - t[0])
    jolts = spec.rough * surface.rough * np.sqrt(speed * step)
    rough = np.cumsum(rng.standard_normal((n, 4)) * (jolts / spec.radius_m)[:, None] * surface.turns, axis=0)
    angle = summed(rate, t) + rough + rng.uniform(0.0, 6.0, 4)
    if spec.frame_jitter_s > 0.0 and spec.wheel_signal == "counts":
        angle = angle - rate * rng.exponential(spec.frame_jitter_s, n)[:, None]
    gyro = gyro_reading(course, spec) + rng.normal(0.0, spec.gyro_std, n)
    gyro = gyro + np.cumsum(rng.normal(0.0, spec.gyro_drift * step**0.5, n))
    seen = _received(course, spec, surface, rng)
    return Drive(
        spec=spec,
        shown_rad=angle,
        gyro=gyro,
        **felt(course, spec, rng),
        fix_age_s=0.0,
        seed=seed,
        start_s=start_s,
        **seen,
    )


def _received(course: Course, spec: Spec, surface: Surface, rng: np.random.Generator) -> dict[str, Array]:
    t, antenna_path = course.time_s, antenna(course, spec)
    period = 1.0 / spec.receiver_hz
    fix = np.arange(0.5, t[-1] - 0.5, period)
    m = len(fix)
    noisy, off, has = (
        surface.sky[np.minimum((fix / (t[1] - t[0])).astype(int), len(t) - 1), k] for k in range(3)
    )
    place = [
        markov(rng, m, period, spec.position_slow_m * f, spec.position_tau_s)
        + rng.normal(0.0, spec.position_white_m, m)
        + off * markov(rng, m, period, 1.0, PLACE_TAU_S)
        for f in (1.0, 1.0, 1.8)
    ]
    when = fix - spec.doppler_age_s
    east, north = (
        np.interp(when, t, values) + noisy * markov(rng, m, period, spec.doppler_mps, spec.doppler_tau_s)
        for values in (antenna_path.east_mps, antenna_path.north_mps)
    )
    fast = np.hypot(east, north)
    course_math = np.arctan2(north, east)
    course_math[(fast < 1.0) | (not spec.with_course)] = np.nan
    lag = rng.exponential(spec.arrival_jitter_s, m) if spec.arrival_jitter_s > 0.0 else np.zeros(m)
    kept = has > 0.5
    tracks = {"fix_east": antenna_path.east, "fix_north": antenna_path.north, "fix_up": antenna_path.up}
    seen = {name: np.interp(fix, t, track) + place[k] for k, (name, track) in enumerate(tracks.items())}
    seen |= {"fix_true_s": fix, "fix_speed": fast, "fix_course_math": course_math, "fix_lag_s": lag}
    return {name: np.asarray(values[kept]) for name, values in seen.items()}
