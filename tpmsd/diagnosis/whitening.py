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

from tpmsd.diagnosis.channels import CHANNELS, COURSE, EAST, GYRO, NORTH, SPEED, WINDOW_S, Windows
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
    here = np.isfinite(columns[:, :, 0])
    v = np.maximum(windows.covariates["speed"], 1.0)
    reading = _measurement_rows(windows, v)
    variance = _variances(windows, noise, v)
    jump = np.ones(count)
    if inflate is not None:
        variance = variance * inflate
        # A position that is far off may be the first of many: the slow error has jumped.
        jump = np.minimum(inflate[:, EAST:].max(axis=1), 100.0)
    read_var = np.square(noise.reading_m)[None, :] + (noise.stamp_s * v[:, None]) ** 2
    P = np.diag(_start_variances(noise, read_var[0]))
    M = np.zeros((STATES, width))
    F, Qm = np.zeros((STATES, STATES)), np.zeros((STATES, STATES))
    F[[PSI, PE, PN], [PSI, PE, PN]] = 1.0
    F[GB, GB] = 1.0
    slow = math.exp(-WINDOW_S / noise.slow_tau_s)
    clock = math.exp(-WINDOW_S / noise.clock_tau_s)
    wander = math.exp(-WINDOW_S / noise.wander_tau_s)
    wheels = np.arange(R, R + 4)
    log_variance = 0.0
    fresh = True
    diag = np.arange(STATES)
    eye4 = np.eye(4)
    places = [np.flatnonzero(row) for row in here]
    for k in range(count):
        gap = 1 if k == 0 else int(windows.index[k] - windows.index[k - 1])
        fresh = gap > 1
        # to the window's end: fresh speed and yaw errors, then heading and position
        grow = windows.to_east_north[k]
        F[PE, PSI], F[PN, PSI] = grow[0, 2], grow[1, 2]
        decay_b, decay_d = slow**gap, noise.speed_memory**gap
        F[BE, BE] = F[BN, BN] = decay_b
        F[DS, DS] = F[DC, DC] = decay_d
        decay_c = clock**gap
        decay_r = wander**gap
        F[wheels, wheels] = decay_r
        F[CK, CK] = decay_c
        F[QOLD : QOLD + 4, Q : Q + 4] = 0.0 if fresh else eye4
        M = F @ M
        P = F @ P @ F.T
        Qm[:] = 0.0
        qd = np.zeros(STATES)
        qd[Q : Q + 4] = read_var[k]
        if fresh:
            qd[QOLD : QOLD + 4] = read_var[k]
            qd[PSI], qd[PE], qd[PN] = 0.1**2, 20.0**2, 20.0**2
        qd[BE] = qd[BN] = noise.slow_m**2 * (1.0 - decay_b**2)
        qd[DS] = noise.speed_mps**2 * (1.0 - decay_d**2)
        qd[DC] = noise.cross_mps**2 * (1.0 - decay_d**2)
        if jump[k] > 1.0:
            qd[BE] += noise.slow_m**2 * jump[k]
            qd[BN] += noise.slow_m**2 * jump[k]
        qd[CK] = noise.clock_s**2 * (1.0 - decay_c**2)
        qd[wheels] = noise.wander**2 * (1.0 - decay_r**2)
        qd[GB] = noise.gyro_drift_radps**2 * gap
        Qm[diag, diag] = qd
        g = np.zeros((STATES, 2))  # the fresh errors of speed and yaw rate
        g[V, 0] = _SPEED_STD
        g[W, 1] = _YAW_STD
        g[PSI, 1] = WINDOW_S * _YAW_STD
        g[PE], g[PN] = grow[0, :2] * (_SPEED_STD, _YAW_STD), grow[1, :2] * (_SPEED_STD, _YAW_STD)
        P += Qm + g @ g.T
        use = places[k]
        if use.size == 0:
            continue
        H = reading[k][use]
        S = H @ P @ H.T
        S[diag[: use.size], diag[: use.size]] += variance[k][use]
        L, failed = dpotrf(S, lower=1)
        if failed:
            raise ValueError("the noise model is not positive definite")
        white, _ = dtrtrs(L, np.concatenate([columns[k][use] - H @ M, H @ P], axis=1), lower=1)
        Z, B = white[:, :width], white[:, width:]
        out[k][use] = Z
        M = M + B.T @ Z
        P = P - B.T @ B
        P = 0.5 * (P + P.T)
        log_variance += 2.0 * float(np.log(L[diag[: use.size], diag[: use.size]]).sum())
    return out, log_variance


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
