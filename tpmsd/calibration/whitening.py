"""Takes the unknown motion and the correlated noise out of the equations of a drive, by a Kalman filter.

In: `Windows` and settings of the `Noise`. Out: residual and parameter columns as whitened innovations:
independent, of unit variance where the noise is as said. Least squares on them is generalised least squares
with the true motion eliminated (de Jong, Annals of Statistics 19, 1991: regressors are filtered along with
the data). Several settings of the noise are run at once, which is how the noise is fitted.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from tpmsd.calibration.windows import (
    BE,
    BETA,
    BN,
    CHANNELS,
    COURSE,
    DC,
    DS,
    EAST,
    GB,
    GYRO,
    LATE,
    LEAN,
    NORTH,
    PE,
    PN,
    PSI,
    QOLD,
    SPEED,
    STATES,
    WINDOW_S,
    Q,
    V,
    W,
    Windows,
)
from tpmsd.wheels import FloatArray

_SPEED_STD, _YAW_STD, _HEADING_STD, _PLACE_STD, _GYRO_STD, _AGE_STD = 1.0, 0.1, 0.3, 200.0, 0.05, 1e-3


@dataclass(frozen=True)
class Noise:
    """Standard deviations of what instruments and road add."""

    rough_m: float = 5e-4
    """Of a wheel's way per square root of a metre."""
    floor_m: float = 5e-4
    """Of a wheel's way per window, whatever the speed."""
    stamp_s: float = 2e-4
    """Of the time stamps of one wheel against the others."""
    gyro_radps: float = 2e-3
    gyro_drift_radps: float = 1e-5
    """Growth of the gyro's bias per square root of a window."""
    speed_white_mps: float = 0.03
    speed_mps: float = 0.05
    """Slow part of the receiver's speed error."""
    cross_white_mps: float = 0.03
    cross_mps: float = 0.05
    """Slow part of its velocity error across the course."""
    velocity_tau_s: float = 1.0
    crab_rad: float = 2e-3
    """Wandering angle between the axle's course and its heading."""
    crab_tau_s: float = 8.0
    white_m: float = 0.2
    slow_m: float = 1.0
    slow_tau_s: float = 30.0
    lean: float = 3e-5
    """Slow difference of left and right radii, relative: slant of the road, side wind."""
    lean_tau_s: float = 15.0
    age_s: float = 5e-4
    """Drift of the GNSS latency per square root of a window."""


NAMES = tuple(field.name for field in fields(Noise))


def table(noises: list[Noise]) -> dict[str, FloatArray]:
    """Settings as arrays (b,) by name."""
    return {name: np.array([getattr(noise, name) for noise in noises]) for name in NAMES}


def whiten(
    windows: Windows, noises: list[Noise], inflate: FloatArray, columns: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Whiten [y | X] under each of b settings: (b, k, 9, 1 + p), zero where not measured; sums of log
    variances (b,).

    `inflate` (k, 9) multiplies the variances of single readings that were found to be outliers. `columns`
    (k, 9, c) takes the place of [y | X].
    """
    n = table(noises)
    b, k = len(noises), len(windows)
    here = np.isfinite(windows.y)
    data = (
        np.concatenate([np.nan_to_num(windows.y)[:, :, None], windows.X], axis=2)
        if columns is None
        else columns
    )
    out = np.zeros((b, *data.shape))
    read, fresh = _variances(windows, n, inflate, here)
    P = _start(n, read[:, 0])
    M = np.zeros((b, STATES, data.shape[2]))
    F = np.zeros((b, STATES, STATES))
    for place in (PSI, PE, PN, GB, LATE):
        F[:, place, place] = 1.0
    slow, fast = np.exp(-WINDOW_S / n["slow_tau_s"]), np.exp(-WINDOW_S / n["velocity_tau_s"])
    crab = np.exp(-WINDOW_S / n["crab_tau_s"])
    lean = np.exp(-WINDOW_S / n["lean_tau_s"])
    F[:, LEAN, LEAN] = lean
    F[:, BE, BE] = F[:, BN, BN] = slow
    F[:, DS, DS] = F[:, DC, DC] = fast
    F[:, BETA, BETA] = crab
    for wheel in range(4):
        F[:, QOLD + wheel, Q + wheel] = 1.0
    steady = np.zeros((b, STATES))
    steady[:, BE] = steady[:, BN] = n["slow_m"] ** 2 * (1 - slow**2)
    steady[:, DS] = n["speed_mps"] ** 2 * (1 - fast**2)
    steady[:, DC] = n["cross_mps"] ** 2 * (1 - fast**2)
    steady[:, LEAN] = n["lean"] ** 2 * (1 - lean**2)
    steady[:, GB], steady[:, LATE] = n["gyro_drift_radps"] ** 2, n["age_s"] ** 2
    crab_step = n["crab_rad"] * np.sqrt(1 - crab**2)
    gain = np.zeros((b, STATES, 3))  # fresh errors of speed, yaw rate and crab angle
    gain[:, V, 0], gain[:, W, 1], gain[:, PSI, 1] = _SPEED_STD, _YAW_STD, WINDOW_S * _YAW_STD
    gain[:, BETA, 2] = crab_step
    diagonal, channels = np.arange(STATES), np.arange(CHANNELS)
    log_variance = np.zeros(b)
    Ht = windows.H.transpose(0, 2, 1)
    for i in range(k):
        grow = windows.grow[i]
        F[:, PE : PN + 1, PSI] = grow[:, 2]
        F[:, PE : PN + 1, BETA] = crab[:, None] * grow[:, 2]
        gain[:, PE : PN + 1, 0] = _SPEED_STD * grow[:, 0]
        gain[:, PE : PN + 1, 1] = _YAW_STD * grow[:, 1]
        gain[:, PE : PN + 1, 2] = crab_step[:, None] * grow[:, 2]
        M = F @ M
        P = F @ P @ F.transpose(0, 2, 1) + gain @ gain.transpose(0, 2, 1)
        P[:, diagonal, diagonal] += steady
        P[:, diagonal[Q : Q + 4], diagonal[Q : Q + 4]] += read[:, i]
        if not here[i].any():
            continue
        PH = P @ Ht[i]
        S = windows.H[i] @ PH
        S[:, channels, channels] += fresh[:, i]
        L = np.linalg.cholesky(S)
        white = np.linalg.solve(
            L, np.concatenate([data[i] - windows.H[i] @ M, PH.transpose(0, 2, 1)], axis=2)
        )
        Z, B = white[:, :, : data.shape[2]], white[:, :, data.shape[2] :]
        out[:, i] = Z
        Bt = B.transpose(0, 2, 1)
        M = M + Bt @ Z
        P = P - Bt @ B
        P = 0.5 * (P + P.transpose(0, 2, 1))
        log_variance += 2.0 * np.log(L[:, channels, channels]).sum(axis=1)
    return out, log_variance


def _start(n: dict[str, FloatArray], read: FloatArray) -> FloatArray:
    variances = np.zeros((len(read), STATES))
    variances[:, Q : Q + 4] = read
    variances[:, PSI], variances[:, PE], variances[:, PN] = _HEADING_STD**2, _PLACE_STD**2, _PLACE_STD**2
    variances[:, BETA] = n["crab_rad"] ** 2
    variances[:, BE] = variances[:, BN] = n["slow_m"] ** 2
    variances[:, DS], variances[:, DC] = n["speed_mps"] ** 2, n["cross_mps"] ** 2
    variances[:, LEAN] = n["lean"] ** 2
    variances[:, GB], variances[:, LATE] = _GYRO_STD**2, _AGE_STD**2
    return np.asarray(variances[:, :, None] * np.eye(STATES))


def _variances(
    windows: Windows, n: dict[str, FloatArray], inflate: FloatArray, here: np.ndarray
) -> tuple[FloatArray, FloatArray]:
    """Variances of the readings at the windows' edges (b, k, 4), and of what is new in each channel (b, k,
    9)."""
    v = np.maximum(windows.speed_mps, 1.0)
    number = np.maximum(windows.fixes, 1.0)
    read = np.square(windows.reading_m)[None, None, :] + np.square(n["stamp_s"][:, None] * v)[:, :, None]
    fresh = np.ones((len(n["rough_m"]), len(windows), CHANNELS))
    road = np.square(n["rough_m"])[:, None] * v * WINDOW_S + np.square(n["floor_m"])[:, None]
    fresh[:, :, :4] = (road + windows.extra_m2)[:, :, None]
    fresh[:, :, GYRO] = np.square(n["gyro_radps"])[:, None]
    fresh[:, :, SPEED] = np.square(n["speed_white_mps"])[:, None] / number[:, 0]
    fresh[:, :, COURSE] = np.square(n["cross_white_mps"][:, None] / v) / number[:, 1]
    fresh[:, :, EAST] = fresh[:, :, NORTH] = np.square(n["white_m"])[:, None] / number[:, 2]
    return read, np.where(here, fresh * inflate, 1.0)
