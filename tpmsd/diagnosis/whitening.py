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

from tpmsd.diagnosis.channels import CHANNELS, COURSE, EAST, GYRO, NORTH, SPEED, Windows
from tpmsd.diagnosis.motion import WINDOW_S
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
    here, reading, variance = made.here, made.rows, made.variance
    decay, fresh_var, motion_var = made.decay, made.fresh, made.motion
    grow_e, grow_n, shift = made.grow_e, made.grow_n, made.shift
    whole = np.asarray(here.all(axis=1))
    number = here.sum(axis=1)
    scale = np.ones((count, CHANNELS))
    P = np.diag(made.start)
    M = np.zeros((STATES, width))
    both = np.empty((CHANNELS, width + STATES))
    for k in range(count):
        # To the window's end: what was the reading at the end is the one at the start; old errors fade,
        # heading moves the position, and new errors of speed and yaw rate come in.
        d = decay[k]
        M = M.take(shift, axis=0)
        M *= d[:, None]
        M[PE] += grow_e[k] * M[PSI]
        M[PN] += grow_n[k] * M[PSI]
        P = P.take(shift, axis=0).take(shift, axis=1)
        P *= d
        P *= d[:, None]
        P[PE] += grow_e[k] * P[PSI]
        P[PN] += grow_n[k] * P[PSI]
        P[:, PE] += grow_e[k] * P[:, PSI]
        P[:, PN] += grow_n[k] * P[:, PSI]
        P.flat[:: STATES + 1] += fresh_var[k]
        P[V : PN + 1, V : PN + 1] += motion_var[k]
        n = number[k]
        if n == 0:
            continue
        use = here[k]
        H, y, r = reading[k], columns[k], variance[k]
        if not whole[k]:
            H, y, r = H[use], y[use], r[use]
        rows = both[:n]
        HP = np.matmul(H, P, out=rows[:, width:])
        S = HP @ H.T
        S.flat[:: n + 1] += r
        np.subtract(y, H @ M, out=rows[:, :width])
        L, failed = dpotrf(S, lower=1)
        if failed:
            raise ValueError("the noise model is not positive definite")
        white, _ = dtrtrs(L, rows, lower=1)
        Z, B = white[:, :width], white[:, width:]
        if whole[k]:
            out[k] = Z
        else:
            out[k][use] = Z
        M += B.T @ Z
        P -= B.T @ B
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
    shift: np.ndarray
    """(STATES,) which state each becomes from."""
    decay: FloatArray
    """(w, STATES)"""
    fresh: FloatArray
    """(w, STATES) variances that come in."""
    motion: FloatArray
    """(w, 5, 5) covariance of the new errors of the motion."""
    grow_e: FloatArray
    """(w,) growth of the position's error by an error of the heading."""
    grow_n: FloatArray


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
        shift=_shift(),
        decay=decay,
        fresh=fresh,
        motion=_motion_variances(windows),
        grow_e=windows.to_east_north[:, 0, 2],
        grow_n=windows.to_east_north[:, 1, 2],
    )


def _shift() -> np.ndarray:
    """(STATES,) which state each becomes from: a reading at a window's end is one at the next one's start."""
    out = np.arange(STATES)
    out[QOLD : QOLD + 4] = np.arange(Q, Q + 4)
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
