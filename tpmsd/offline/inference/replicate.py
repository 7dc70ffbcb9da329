"""A drive again, drawn from a fitted model: the parametric bootstrap's recordings.

In: the `Reader` of a drive, a model that acts in it, a `Noise`, a generator. Out: a `Recording` of the same
motion in which nothing acts but that model, with errors of wheels, gyro and receiver drawn again (Davison and
Hinkley, Bootstrap Methods and their Application, 1997, section 2.2). It goes through the whole analysis like
any other: what smoothing, whitening and selection make of shared errors shows in it.

Errors are drawn at the ticks and the fixes, by the same states as in `state_space`. What the bus tells beside
(accelerometer, steering wheel, heights) is kept as recorded.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tpmsd.car.physics.first_order import accumulated
from tpmsd.car.physics.forward import antenna_truth, gyro_rates, wheel_angles
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import WINDOW_S
from tpmsd.offline.inference.windows import Reader


def replicate(reader: Reader, model: ExtendedModel, noise: Noise, rng: np.random.Generator) -> Recording:
    """Return a recording drawn from the model and the noise, with gaps where the original has them."""
    recording = reader.recording
    rotation = _draw_rotation(reader, model, noise, rng)
    gyro = _draw_gyro(reader, model, noise, rng)
    fixes = _draw_fixes(reader, model, noise, rng)
    return replace(
        recording,
        rotation_rad=rotation,
        inertial={**recording.inertial, "yaw_rate_radps": gyro},
        east_m=fixes["east_m"],
        north_m=fixes["north_m"],
        speed_mps=fixes["speed_mps"],
        course_rad=fixes["course_rad"],
    )


def gauss_markov(rng: np.random.Generator, count: int, std: float, keep: float) -> FloatArray:
    """Return (count,) of a stationary first-order Gauss-Markov sequence of this standard deviation and
    correlation."""
    steps = std * rng.standard_normal(count)
    steps[1:] *= math.sqrt(1.0 - keep**2)
    return accumulated(steps, keep)


def _step_correlation(tau_s: float, step_s: float) -> float:
    """Return the correlation over one step of a time constant."""
    return math.exp(-step_s / tau_s)


def _memory_s(correlation: float) -> float:
    """Return the time constant (s) of a correlation from window to window."""
    return -WINDOW_S / math.log(correlation)


def _draw_rotation(
    reader: Reader, model: ExtendedModel, noise: Noise, rng: np.random.Generator
) -> FloatArray:
    """Return the (n, 4) turn (rad) of each wheel in each tick; NaN where it was not read."""
    recording, motion, car = reader.recording, reader.felt(model), reader.reference.car
    dt, n = recording.dt_s, recording.ticks
    speed = np.maximum(motion.speed_mps, 0.0)
    distance_m = 0.5 * (speed[1:] + speed[:-1]) * dt
    out = np.full((n, 4), math.nan)
    angles = wheel_angles(motion, car, model)
    for wheel in recording.wheels:
        angle = angles[:, wheel] + model.tooth_angle_error_rad(angles[:, wheel], wheel)
        angle = angle * model.true_teeth_per_rev(wheel, car.teeth_per_rev) / car.teeth_per_rev
        drift = gauss_markov(rng, n, noise.radius_drift, _step_correlation(noise.radius_drift_tau_s, dt))
        road = np.sqrt(
            noise.rough_m**2 * distance_m + noise.floor_m**2 * dt / WINDOW_S
        ) * rng.standard_normal(n)
        off_m = np.concatenate([[0.0], np.cumsum(road - drift * distance_m)])
        stamps = noise.stamp_s * np.maximum(speed, 1.0) * rng.standard_normal(n + 1)
        angle = angle + (off_m + stamps) / car.radius_m[wheel]
        step = recording.quantum_rad[wheel] * math.sqrt(6.0)
        if step > 0.0:
            angle = np.floor(angle / step + rng.random()) * step
        else:
            angle = angle + noise.reading_m[wheel] / car.radius_m[wheel] * rng.standard_normal(n + 1)
        out[:, wheel] = np.diff(angle)
    return np.where(np.isfinite(recording.rotation_rad), out, math.nan)


def _draw_gyro(reader: Reader, model: ExtendedModel, noise: Noise, rng: np.random.Generator) -> FloatArray:
    """Return the (n,) yaw rate of the gyro (rad/s); NaN where it was not read."""
    recording, motion, car = reader.recording, reader.felt(model), reader.reference.car
    dt, n = recording.dt_s, recording.ticks
    edges = gyro_rates(motion, car, model)
    bias = np.cumsum(noise.gyro_drift_radps * math.sqrt(dt / WINDOW_S) * rng.standard_normal(n))
    white = noise.gyro_radps * math.sqrt(WINDOW_S / dt) * rng.standard_normal(n)
    drawn = 0.5 * (edges[1:] + edges[:-1]) + bias + white
    return np.where(np.isfinite(recording.inertial["yaw_rate_radps"]), drawn, math.nan)


def _draw_fixes(
    reader: Reader, model: ExtendedModel, noise: Noise, rng: np.random.Generator
) -> dict[str, FloatArray]:
    """Return positions, speeds and courses (m,) each; NaN where the receiver gave none."""
    recording, motion, car = reader.recording, reader.felt(model), reader.reference.car
    dt, n = recording.dt_s, recording.ticks
    time_s, count = recording.fix_time_s, len(recording.fix_time_s)

    def slow(std: float, tau_s: float) -> FloatArray:
        return np.interp(time_s, motion.time_s[1:], gauss_markov(rng, n, std, _step_correlation(tau_s, dt)))

    def white(std: float) -> FloatArray:
        return std * rng.standard_normal(count)

    memory_s = _memory_s(noise.speed_memory)
    when = time_s - model.fix_age_s() - slow(noise.clock_s, noise.clock_tau_s)
    antenna = antenna_truth(motion, car, model)

    def at(values: FloatArray, older_s: float = 0.0) -> FloatArray:
        return np.interp(when - older_s, motion.time_s, values)

    lag = model.velocity_age_s()
    ve, vn = at(antenna.shown_east_mps, lag), at(antenna.shown_north_mps, lag)
    speed = np.hypot(ve, vn)
    course = np.arctan2(vn, ve)
    across = slow(noise.cross_mps, memory_s) + white(noise.cross_white_mps)
    floor = slow(noise.course_floor_rad, 0.5 * WINDOW_S)
    drawn = {
        "east_m": at(antenna.east_m) + slow(noise.slow_m, noise.slow_tau_s) + white(noise.white_m),
        "north_m": at(antenna.north_m) + slow(noise.slow_m, noise.slow_tau_s) + white(noise.white_m),
        "speed_mps": np.maximum(speed + slow(noise.speed_mps, memory_s) + white(noise.speed_white_mps), 0.0),
        "course_rad": course + across / np.maximum(speed, 1.0) + floor,
    }
    return {
        name: np.where(np.isfinite(getattr(recording, name)), values, math.nan)
        for name, values in drawn.items()
    }
