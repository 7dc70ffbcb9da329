"""Takes the unknown motion and the correlated noise out of residuals, by a Kalman filter.

In: `Windows`, a `Noise`, and any number of residual columns (recording minus prediction, responses of
effects). Out: the same columns as whitened innovations: independent, of unit variance where the noise is
as said. Least squares on them is generalised least squares with the car's true speed, yaw rate, heading
and position eliminated, which is what lets one channel be judged by all others with none trusted alone
(de Jong, Annals of Statistics 19, 1991, "The diffuse Kalman filter": regressors are filtered alongside
the data).

State: reading errors of the wheels' angles at the window's end and start (a count's error at an edge
enters two windows, with opposite signs), errors of the reference's speed and yaw rate (new in every
window), heading, position, the receiver's slow position error, its speed and cross-speed error (first-
order Gauss-Markov), the gyro's wandering bias.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtrs

from tpmsd.inference.trajectory import WINDOW_S
from tpmsd.inference.windows import CHANNELS, COURSE, EAST, GYRO, NORTH, SPEED, Windows
from tpmsd.wheels import FloatArray

Q, QOLD, V, W, PSI, PE, PN, BE, BN = 0, 4, 8, 9, 10, 11, 12, 13, 14
DS, DC, GB, CK, R, STATES = 15, 16, 17, 18, 19, 23
_SPEED_STD, _YAW_STD, _HEADING_STD, _PLACE_STD = 1.0, 0.1, 0.5, 300.0


@dataclass(frozen=True)
class Noise:
    """Standard deviations of what the instruments and the road add."""

    reading_m: tuple[float, float, float, float]
    """Of a wheel's way at an instant: quantisation and time stamps."""
    rough_m: float = 4e-4
    """Of a wheel's way per square root of a metre: the road."""
    floor_m: float = 1e-4
    """Of a wheel's way per window, whatever the speed."""
    stamp_s: float = 2e-4
    """Of the time stamps between wheels."""
    gyro_radps: float = 1e-3
    gyro_drift_radps: float = 2e-6
    """Growth of the gyro's bias per square root of a second."""
    speed_white_mps: float = 0.02
    speed_mps: float = 0.05
    speed_memory: float = 0.4
    """Correlation of the receiver's speed error from window to window."""
    cross_white_mps: float = 0.02
    cross_mps: float = 0.05
    course_floor_rad: float = 5e-4
    white_m: float = 0.2
    slow_m: float = 1.5
    slow_tau_s: float = 30.0
    clock_s: float = 2e-3
    """Wander of the receiver's clock against the bus's, which a constant latency does not hold."""
    clock_tau_s: float = 8.0
    wander: float = 2e-5
    """Of a tyre's radius, relative: load, temperature and the road's crossfall change it slowly."""
    wander_tau_s: float = 60.0


def whiten(
    windows: Windows, noise: Noise, columns: FloatArray, inflate: FloatArray | None = None
) -> tuple[FloatArray, float]:
    """Whiten `columns` (w, 9, p): returns (w, 9, p), zero where not measured, and the sum of log variances.

    A channel is missing where column 0 is NaN. `inflate` (w, 9) multiplies the variances of single
    readings that were found to be outliers.
    """
    count, _, width = columns.shape
    out = np.zeros_like(columns)
    made = system(windows, noise, np.isfinite(columns[:, :, 0]), inflate)
    whole = np.asarray(made.here.all(axis=1))
    number = made.here.sum(axis=1)
    scale = np.ones((count, CHANNELS))
    # What is expected of each column, and the covariance beside it: moved and corrected by one product.
    joint = np.concatenate([np.zeros((STATES, width)), np.diag(made.start)], axis=1)
    other = np.empty_like(joint)
    both = np.empty((CHANNELS, width + STATES))
    for k in range(count):
        joint[:, width:] = joint[:, width:] @ made.transition[k].T
        np.matmul(made.transition[k], joint, out=other)
        joint, other = other, joint
        joint[:, width:] += made.fresh[k]
        n = number[k]
        if n == 0:
            continue
        use = slice(None) if whole[k] else made.here[k]
        H = made.rows[k, use]
        rows = np.matmul(H, joint, out=both[:n])
        S = rows[:, width:] @ H.T
        S.flat[:: n + 1] += made.variance[k, use]
        rows[:, :width] -= columns[k, use]
        L, failed = dpotrf(S, lower=1)
        if failed:
            raise ValueError("the noise model is not positive definite")
        white, _ = dtrtrs(L, rows, lower=1)
        out[k, use] = -white[:, :width]
        joint -= np.matmul(white[:, width:].T, white, out=other)
        scale[k, :n] = L.diagonal()
    return out, 2.0 * float(np.log(scale).sum())


@dataclass(frozen=True)
class System:
    """How the states move, and what the channels see of them, window by window."""

    here: np.ndarray
    """(w, 9) what was measured."""
    rows: FloatArray
    """(w, 9, STATES)"""
    variance: FloatArray
    """(w, 9) of what is new in every window."""
    start: FloatArray
    """(STATES,) variances at the beginning."""
    transition: FloatArray
    """(w, STATES, STATES) from the window before."""
    fresh: FloatArray
    """(w, STATES, STATES) covariance of the new errors that come in."""


def system(windows: Windows, noise: Noise, here: np.ndarray, inflate: FloatArray | None) -> System:
    """The linear system of a drive under a noise; `here` (w, 9) says what was measured."""
    v = np.maximum(windows.covariates["speed"], 1.0)
    variance = _variances(windows, noise, v)
    jump = np.ones(len(v))
    if inflate is not None:
        variance = variance * inflate
        # A position that is far off may be the first of many: the slow error has jumped.
        jump = np.minimum(inflate[:, EAST:].max(axis=1), 100.0)
    gap = np.diff(windows.index, prepend=windows.index[:1] - 1)
    read_var = np.square(noise.reading_m)[None, :] + (noise.stamp_s * v[:, None]) ** 2
    decay, fresh = _steps(noise, gap, jump, read_var)
    return System(
        here=here,
        rows=_measurement_rows(windows, v),
        variance=variance,
        start=_start_variances(noise, read_var[0]),
        transition=_transitions(windows, decay),
        fresh=_fresh(windows, fresh),
    )


def _transitions(windows: Windows, decay: FloatArray) -> FloatArray:
    """(w, STATES, STATES): a reading at a window's end is one at the next one's start, old errors fade, and
    an error of the heading moves the position."""
    out = np.zeros((len(decay), STATES, STATES))
    came_from = np.arange(STATES)
    came_from[QOLD : QOLD + 4] = np.arange(Q, Q + 4)
    out[:, np.arange(STATES), came_from] = decay
    out[:, PE, PSI] = windows.to_east_north[:, 0, 2] * decay[:, PSI]
    out[:, PN, PSI] = windows.to_east_north[:, 1, 2] * decay[:, PSI]
    return out


def _fresh(windows: Windows, variances: FloatArray) -> FloatArray:
    """(w, STATES, STATES) from the states' own new variances, and new errors of speed and yaw rate, which
    move heading and position."""
    out = np.zeros((*variances.shape, STATES))
    out[:, np.arange(STATES), np.arange(STATES)] = variances
    out[:, V : PN + 1, V : PN + 1] += _motion_variances(windows)
    return out


def _steps(
    noise: Noise, gap: np.ndarray, jump: FloatArray, read_var: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(w, STATES) factors by which the states fade into each window, and the variances that come in."""
    decay = np.zeros((len(gap), STATES))
    fresh = np.zeros((len(gap), STATES))
    broken = gap > 1
    decay[:, QOLD : QOLD + 4] = ~broken[:, None]
    decay[:, [PSI, PE, PN, GB]] = 1.0
    fresh[:, Q : Q + 4] = read_var
    fresh[:, QOLD : QOLD + 4] = np.where(broken[:, None], read_var, 0.0)
    fresh[:, PSI] = np.where(broken, 0.1**2, 0.0)
    fresh[:, [PE, PN]] = np.where(broken, 20.0**2, 0.0)[:, None]
    for states, size, per_window in (
        ([BE, BN], noise.slow_m, math.exp(-WINDOW_S / noise.slow_tau_s)),
        ([DS], noise.speed_mps, noise.speed_memory),
        ([DC], noise.cross_mps, noise.speed_memory),
        ([CK], noise.clock_s, math.exp(-WINDOW_S / noise.clock_tau_s)),
        (list(range(R, R + 4)), noise.wander, math.exp(-WINDOW_S / noise.wander_tau_s)),
    ):
        faded = per_window ** gap.astype(np.float64)
        decay[:, states] = faded[:, None]
        fresh[:, states] = (size**2 * (1.0 - faded**2))[:, None]
    fresh[:, [BE, BN]] += np.where(jump > 1.0, noise.slow_m**2 * jump, 0.0)[:, None]
    fresh[:, GB] = noise.gyro_drift_radps**2 * gap
    return decay, fresh


def _motion_variances(windows: Windows) -> FloatArray:
    """(w, 5, 5) covariance of the new errors of speed, yaw rate, heading, east and north."""
    g = np.zeros((len(windows), 5, 2))
    g[:, V - V, 0] = _SPEED_STD
    g[:, W - V, 1] = _YAW_STD
    g[:, PSI - V, 1] = WINDOW_S * _YAW_STD
    g[:, PE - V :] = windows.to_east_north[:, :, :2] * (_SPEED_STD, _YAW_STD)
    return np.asarray(g @ g.transpose(0, 2, 1))


def _start_variances(noise: Noise, reading: FloatArray) -> FloatArray:
    out = np.zeros(STATES)
    out[Q : Q + 4] = reading
    out[PSI] = _HEADING_STD**2
    out[PE] = out[PN] = _PLACE_STD**2
    out[BE] = out[BN] = noise.slow_m**2
    out[DS], out[DC] = noise.speed_mps**2, noise.cross_mps**2
    out[CK] = noise.clock_s**2
    out[R : R + 4] = noise.wander**2
    return out


def _measurement_rows(windows: Windows, v: FloatArray) -> FloatArray:
    """(w, 9, 23) what the channels see of the state."""
    rows = np.zeros((len(windows), CHANNELS, STATES))
    rows[:, :, [V, W, PSI]] = windows.design
    for wheel in range(4):
        rows[:, wheel, Q + wheel] = 1.0
        rows[:, wheel, QOLD + wheel] = -1.0
        rows[:, wheel, R + wheel] = -v * WINDOW_S
    rows[:, GYRO, GB] = 1.0
    rows[:, SPEED, DS] = 1.0
    rows[:, COURSE, W] -= WINDOW_S / 2  # the window's mean heading lies half a turn behind its end
    rows[:, COURSE, DC] = 1.0 / v
    for axis, (channel, place, slow) in enumerate(((EAST, PE, BE), (NORTH, PN, BN))):
        rows[:, channel, place] = rows[:, channel, slow] = 1.0
        rows[:, channel, V] = -0.5 * windows.to_east_north[:, axis, 0]
        rows[:, channel, PSI] = -0.5 * windows.to_east_north[:, axis, 2]
        rows[:, channel, CK] = -windows.to_east_north[:, axis, 0] / WINDOW_S * v
    rows[:, SPEED, CK] = -windows.covariates["accel_kinematic"]
    rows[:, COURSE, CK] = -windows.covariates["yaw_rate"]
    return rows


def _variances(windows: Windows, noise: Noise, v: FloatArray) -> FloatArray:
    """(w, 9) of what is new in every window."""
    out = np.empty((len(windows), CHANNELS))
    number = np.maximum(windows.fixes, 1.0)
    out[:, :4] = (noise.rough_m**2 * v * WINDOW_S + noise.floor_m**2)[:, None]
    out[:, GYRO] = noise.gyro_radps**2
    out[:, SPEED] = noise.speed_white_mps**2 / number[:, 0]
    out[:, COURSE] = noise.cross_white_mps**2 / v**2 / number[:, 1] + noise.course_floor_rad**2
    out[:, EAST] = out[:, NORTH] = noise.white_m**2 / number[:, 2]
    return out
